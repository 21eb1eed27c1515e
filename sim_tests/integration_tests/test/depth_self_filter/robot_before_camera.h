// SPDX-License-Identifier: BSD-3-Clause
// The simulated robot in any posture before its own camera, with or without a brick on the magnet, and what the simulator
// itself knows of each pixel. Postures are set, not driven to: physics has no part in what a camera sees.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <depth_self_filter/robot_mask.h>
#include <mp700_ur5e_description/robot_names.h>

#include "arm_distance.h"
#include "simulated_world/mujoco_model.h"
#include "simulated_world/offscreen_renderer.h"
#include "simulated_world/rgbd_camera.h"
#include "simulated_world/simulation.h"
#include "simulated_world/world.h"
#include "synthetic_depth/sensor.h"

namespace simulated_world {

namespace names = mp700_ur5e_description;

constexpr int kHeldBrick = 0;

/// As config/simulation.yaml has it.
inline synthetic_depth::SensorModel stereoSensor() {
  synthetic_depth::SensorModel sensor;
  sensor.min_range_m = 0.3;
  sensor.max_range_m = 6.0;
  sensor.axial_noise_a_m = 0.0005;
  sensor.axial_noise_c_per_m = 0.0038;
  sensor.baseline_m = 0.05;
  sensor.has_shadows = true;
  return sensor;
}

inline SimulationConfig worldConfig(const std::string& scene) {
  const std::string folder = MP700_UR5E_DESCRIPTION_DIR;
  SimulationConfig config;
  config.description = {folder + "/urdf/mp700_ur5e.urdf", folder + "/config/base_profile.yaml",
                        folder + "/config/bricks.yaml", folder + "/config/arm_poses/stowed.yaml"};
  config.scene = std::string(SIMULATED_WORLDS) + "/" + scene + ".yaml";
  config.camera_rate_hz = 0.0;
  config.camera.sensor = stereoSensor();
  return config;
}

/// Arm angles from base to tool [rad].
using ArmAngles = std::array<double, 6>;

class RobotBeforeCamera {
 public:
  /// The base stands at (x, 0) and looks along x, at a pile about the origin.
  RobotBeforeCamera(const std::string& scene, double base_x_m)
      : robot_(names::RobotModel::load(MP700_UR5E_DESCRIPTION_DIR "/urdf/mp700_ur5e.urdf")),
        simulation_(worldConfig(scene)),
        model_(simulation_.world().model()),
        data_(mj_copyData(nullptr, &model_, &simulation_.world().data())),
        renderer_(model_, rendererConfig()) {
    set("base_x", base_x_m);
    set("base_y", 0.0);
    set("base_yaw", 0.0);
    setSensor(stereoSensor());
    std::copy_n(data_->qpos + model_.jnt_qposadr[model_.body_jntadr[heldBody()]], brick_in_pile_.size(),
                brick_in_pile_.begin());
  }

  void setSensor(const synthetic_depth::SensorModel& sensor) {
    RgbdCameraConfig config = simulation_.config().camera;
    config.sensor = sensor;
    camera_ = std::make_unique<RgbdCamera>(renderer_, "rgbd", config);
  }

  /// The brick's pose on the magnet: hanging from the middle of its +z face, turned about the tool.
  static depth_self_filter::HeldBrick brickOnMagnet(double turn_rad) {
    depth_self_filter::HeldBrick brick;
    brick.frame = names::kToolFrame;
    brick.size_m << 0.3, 0.2, 0.2;
    brick.T_frame_brick = Eigen::Translation3d(0.0, 0.0, 0.1 + 0.1) *
                          Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitZ()) *
                          Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX());
    return brick;
  }

  void pose(const ArmAngles& arm_rad, const std::optional<depth_self_filter::HeldBrick>& brick) {
    positions_rad_ = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(robot_->joints().size()));
    for (std::size_t i = 0; i < arm_rad.size(); ++i) {
      set(names::kArmJoints[i], arm_rad[i]);
      positions_rad_[static_cast<Eigen::Index>(robot_->jointIndex(names::kArmJoints[i]))] = arm_rad[i];
    }
    brick_ = brick;
    mj_forward(&model_, data_.get());
    mjtNum* const qpos = data_->qpos + model_.jnt_qposadr[model_.body_jntadr[heldBody()]];
    if (!brick) {
      std::copy_n(brick_in_pile_.begin(), brick_in_pile_.size(), qpos);
      mj_forward(&model_, data_.get());
      return;
    }
    const Eigen::Isometry3d T_map_brick =
        bodyPose(*data_, requireId(model_, mjOBJ_BODY, brick->frame)) * brick->T_frame_brick;
    Eigen::Map<Eigen::Vector3d>{qpos} = T_map_brick.translation();
    quaternionTo(Eigen::Quaterniond(T_map_brick.linear()), qpos + 3);
    mj_forward(&model_, data_.get());
  }

  cv::Mat measure(std::uint64_t frame) { return camera_->capture(*data_, frame).depth_m; }

  /// What the simulator knows of a view that is wider by kMargin_px on all sides.
  struct Truth {
    cv::Mat is_robot;       // CV_8UC1: 255 where robot or held brick is seen
    double nearest_m{0.0};  // of them, along the optical axis
  };
  static constexpr int kMargin_px = 160;

  Truth truth() {
    synthetic_depth::CameraModel wide = simulation_.config().camera.camera;
    wide.width_px += 2 * kMargin_px;
    wide.height_px += 2 * kMargin_px;
    wide.cx_px += kMargin_px;
    wide.cy_px += kMargin_px;
    const RenderOptions& options = simulation_.config().camera.render;
    cv::Mat geom_ids;
    cv::Mat depth_m;
    renderer_.segmentation(*data_, T_map_camera(), wide, options, &geom_ids);
    renderer_.render(*data_, T_map_camera(), wide, options, nullptr, &depth_m);
    const int robot = requireId(model_, mjOBJ_BODY, names::kBaseFrame);
    Truth result;
    result.is_robot = cv::Mat(geom_ids.size(), CV_8UC1, cv::Scalar(0));
    result.nearest_m = std::numeric_limits<double>::infinity();
    for (int v = 0; v < geom_ids.rows; ++v) {
      for (int u = 0; u < geom_ids.cols; ++u) {
        const int geom = geom_ids.at<int>(v, u);
        if (geom < 0) continue;
        const int body = model_.geom_bodyid[geom];
        const bool is_held = brick_ && body == heldBody();
        if (!is_held && model_.body_rootid[body] != robot) continue;
        result.is_robot.at<unsigned char>(v, u) = 255;
        result.nearest_m = std::min<double>(result.nearest_m, depth_m.at<float>(v, u));
      }
    }
    return result;
  }
  /// The part of a wide view that the camera sees.
  cv::Mat inView(const cv::Mat& wide) const {
    return wide(cv::Rect(kMargin_px, kMargin_px, camera().width, camera().height));
  }

  /// What the filter makes of a measured image.
  depth_self_filter::MaskStatistics filter(depth_self_filter::RobotMask* mask, depth_camera::DepthImage* image) const {
    return mask->apply(camera(), T_root_camera(), positions_rad_, brick_, image);
  }

  depth_camera::CameraModel camera() const {
    const synthetic_depth::CameraModel& c = simulation_.config().camera.camera;
    return {c.width_px, c.height_px, c.fx_px, c.fy_px, c.cx_px, c.cy_px};
  }
  /// By the URDF, as the node takes it.
  Eigen::Isometry3d T_root_camera() const { return robot_->framePose(names::kDepthFrame, positions_rad_); }
  /// By the simulator.
  Eigen::Isometry3d T_map_camera() const { return camera_->opticalPose(*data_); }
  Eigen::Isometry3d T_map_root() const { return bodyPose(*data_, requireId(model_, mjOBJ_BODY, names::kBaseFrame)); }

  /// From a point in the root's frame to the nearest part of arm, magnet and held brick [m]; negative inside.
  double distanceToArm(const Eigen::Vector3d& p_root) const {
    const double arm_m = simulated_world::distanceToArm(*robot_, positions_rad_, p_root);
    if (!brick_) return arm_m;
    const Eigen::Isometry3d T_root_brick = robot_->framePose(brick_->frame, positions_rad_) * brick_->T_frame_brick;
    return std::min(arm_m, distanceToShape(names::Box{brick_->size_m}, T_root_brick.inverse() * p_root));
  }

  const std::shared_ptr<const names::RobotModel>& robot() const { return robot_; }

 private:
  static RendererConfig rendererConfig() {
    RendererConfig config;
    config.max_width_px = 640 + 2 * kMargin_px;
    config.max_height_px = 480 + 2 * kMargin_px;
    return config;
  }

  int heldBody() const { return requireId(model_, mjOBJ_BODY, "brick_" + std::to_string(kHeldBrick)); }
  void set(const std::string& joint, double value) {
    data_->qpos[model_.jnt_qposadr[requireId(model_, mjOBJ_JOINT, joint)]] = value;
  }

  std::shared_ptr<const names::RobotModel> robot_;
  Simulation simulation_;
  const mjModel& model_;
  DataPtr data_;
  OffscreenRenderer renderer_;
  std::unique_ptr<RgbdCamera> camera_;
  std::array<mjtNum, 7> brick_in_pile_{};  // pose of the brick while it is not held
  Eigen::VectorXd positions_rad_;
  std::optional<depth_self_filter::HeldBrick> brick_;
};

/// From a 32FC1 image of metres, as it is.
inline depth_camera::DepthImage toDepthImage(const cv::Mat& depth_m) {
  return {depth_m.cols, depth_m.rows, std::vector<float>(depth_m.begin<float>(), depth_m.end<float>())};
}

/// The way a 16UC1 driver in millimetres would deliver it: 0 for everything that is no depth.
inline depth_camera::DepthImage toDepthImage16(const cv::Mat& depth_m) {
  const cv::Mat units = synthetic_depth::encodeDepth16(depth_m, 1000.0);
  return depth_camera::depthImageFromU16(units.ptr<std::uint16_t>(), units.cols, units.rows, 1000.0);
}

inline depth_self_filter::RobotMaskConfig realsenseMask() {
  depth_self_filter::RobotMaskConfig config;
  config.baseline_m = 0.05;  // config/cameras/realsense.yaml
  config.noise = {0.0005, 0.0, 0.0038};
  return config;
}

}  // namespace simulated_world
