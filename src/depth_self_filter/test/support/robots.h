// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <limits>
#include <memory>
#include <random>
#include <string>

#include <Eigen/Geometry>

#include "depth_self_filter/robot_mask.h"
#include "mp700_ur5e_description/robot_names.h"

namespace depth_self_filter {
namespace test {

using mp700_ur5e_description::RobotModel;

inline std::shared_ptr<const RobotModel> shippedRobot() {
  return RobotModel::load(DESCRIPTION_DIR "/urdf/mp700_ur5e.urdf");
}

/// One shape, centred in the frame "base_link": its geometry as a URDF has it, such as "<sphere radius='0.1'/>".
inline std::shared_ptr<const RobotModel> robotOf(const std::string& geometry) {
  return RobotModel::parse("<robot name='one'><link name='base_link'><collision><geometry>" + geometry +
                               "</geometry></collision></link></robot>",
                           "one shape");
}

/// Arm angles in the order of kArmJoints; wheels at zero.
inline Eigen::VectorXd positions(const RobotModel& robot, const std::array<double, 6>& arm_rad) {
  Eigen::VectorXd result = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(robot.joints().size()));
  for (std::size_t i = 0; i < arm_rad.size(); ++i) {
    result[static_cast<Eigen::Index>(robot.jointIndex(mp700_ur5e_description::kArmJoints[i]))] = arm_rad[i];
  }
  return result;
}

/// Stretched out before the camera on the mast.
constexpr std::array<double, 6> kArmInView = {0.2, -0.9, 1.2, -1.9, -1.57, 0.0};

/// Nothing is padded, spread or taken for a shadow, and depths are exact: what a single effect is tested against.
inline RobotMaskConfig exactConfig() {
  RobotMaskConfig config;
  config.padding_m = config.padding_rad = config.brick_padding_m = 0.0;
  config.edge_px = 0;
  config.baseline_m = 0.0;
  config.noise_sigmas = 0.0;
  return config;
}

inline Eigen::Isometry3d randomPose(std::mt19937_64* random, double reach_m) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(-reach_m, reach_m);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::Quaterniond(normal(*random), normal(*random), normal(*random), normal(*random))
                   .normalized()
                   .toRotationMatrix();
  T.translation() << uniform(*random), uniform(*random), uniform(*random);
  return T;
}

/// Depths up to `max_m`, and every kind of value that is none.
inline depth_camera::DepthImage randomImage(int width, int height, double max_m, std::mt19937_64* random) {
  std::uniform_real_distribution<float> depth(0.05F, static_cast<float>(max_m));
  std::uniform_int_distribution<int> kind(0, 9);
  constexpr float kInf = std::numeric_limits<float>::infinity();
  depth_camera::DepthImage image{width, height, {}};
  for (int i = 0; i < width * height; ++i) {
    switch (kind(*random)) {
      case 0:
      case 1:
        image.depth_m.push_back(0.0F);
        break;
      case 2:
        image.depth_m.push_back(kInf);
        break;
      case 3: {
        const std::array<float, 3> kRare = {-kInf, std::numeric_limits<float>::quiet_NaN(), -0.5F};
        image.depth_m.push_back(kRare[(*random)() % kRare.size()]);
        break;
      }
      default:
        image.depth_m.push_back(depth(*random));
    }
  }
  return image;
}

inline depth_camera::DepthImage constantImage(const depth_camera::CameraModel& camera, float depth_m) {
  return {
      camera.width, camera.height,
      std::vector<float>(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height), depth_m)};
}

}  // namespace test
}  // namespace depth_self_filter
