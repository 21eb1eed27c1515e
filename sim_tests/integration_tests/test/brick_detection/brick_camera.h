// SPDX-License-Identifier: BSD-3-Clause
// What the tests of node brick_detection share: a camera whose images are rendered from bricks at known poses and
// published one by one, in step with the node under test.
#pragma once

#include <map>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <geometry_msgs/TransformStamped.h>
#include <interactive_mapping_common_ros/testing/waiting.h>
#include <interactive_mapping_msgs/BrickArray.h>
#include <interactive_mapping_msgs/BrickDetectionUpdate.h>
#include <interactive_mapping_msgs/DetectBricks.h>
#include <mp700_ur5e_description/brick_types.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_msgs/TFMessage.h>

#include "support/await_update.h"
#include "support/tag_renderer.h"

namespace integration_tests {

using node_tests::call;
using node_tests::has;
using node_tests::kDeadline_s;
using node_tests::Latest;
using node_tests::waitUntil;

using brick_detection::CameraModel;
using interactive_mapping_msgs::Brick;
using interactive_mapping_msgs::BrickArray;
using interactive_mapping_msgs::DetectBricks;
using DetectionUpdate = interactive_mapping_msgs::BrickDetectionUpdate;

constexpr char kCameraFrame[] = "camera_color_optical_frame";

inline CameraModel smallCamera() {
  CameraModel camera;
  camera.width_px = 480;
  camera.height_px = 360;
  camera.fx_px = camera.fy_px = 400.0;
  camera.cx_px = 239.5;
  camera.cy_px = 179.5;
  return camera;
}

/// Looks from `eye` to `target`, image rows level.
inline Eigen::Isometry3d lookingAt(const Eigen::Vector3d& eye_map, const Eigen::Vector3d& target_map) {
  const Eigen::Vector3d forward = (target_map - eye_map).normalized();
  const Eigen::Vector3d right = forward.cross(Eigen::Vector3d::UnitZ()).normalized();
  Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
  T_map_camera.linear() << right, forward.cross(right), forward;
  T_map_camera.translation() = eye_map;
  return T_map_camera;
}

inline Eigen::Isometry3d standing(const Eigen::Vector3d& p_map, double yaw_rad) {
  Eigen::Isometry3d T_map_brick = Eigen::Isometry3d::Identity();
  T_map_brick.translation() = p_map;
  T_map_brick.rotate(Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()));
  return T_map_brick;
}

inline Eigen::Isometry3d toIsometry(const geometry_msgs::Pose& pose) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::Quaterniond(pose.orientation.w, pose.orientation.x, pose.orientation.y, pose.orientation.z)
                   .toRotationMatrix();
  T.translation() << pose.position.x, pose.position.y, pose.position.z;
  return T;
}

inline double angleBetween(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return Eigen::AngleAxisd(a.linear().transpose() * b.linear()).angle();
}

struct PlacedBrick {
  int id{0};
  Eigen::Isometry3d T_map_brick{Eigen::Isometry3d::Identity()};
};

/// All that belongs to one look.
struct BrickFrame {
  sensor_msgs::Image color;
  sensor_msgs::Image depth;  // without data: there is none
  sensor_msgs::CameraInfo info;
  geometry_msgs::TransformStamped transform;

  void setStamp(const ros::Time& stamp) {
    color.header.stamp = depth.header.stamp = info.header.stamp = transform.header.stamp = stamp;
  }
};

inline sensor_msgs::Image toImageMessage(const cv::Mat& pixels, const std::string& encoding) {
  sensor_msgs::Image image;
  image.header.frame_id = kCameraFrame;
  image.width = static_cast<std::uint32_t>(pixels.cols);
  image.height = static_cast<std::uint32_t>(pixels.rows);
  image.encoding = encoding;
  image.step = static_cast<std::uint32_t>(pixels.cols * pixels.elemSize());
  image.data.assign(pixels.datastart, pixels.dataend);  // fresh matrices are continuous
  return image;
}

/// In another encoding, of an image CV_8UC3 with blue, green, red.
inline sensor_msgs::Image toColorMessage(const cv::Mat& bgr, const std::string& encoding) {
  static const std::map<std::string, int> kConversions = {{"rgb8", cv::COLOR_BGR2RGB},
                                                          {"bgra8", cv::COLOR_BGR2BGRA},
                                                          {"rgba8", cv::COLOR_BGR2RGBA},
                                                          {"mono8", cv::COLOR_BGR2GRAY}};
  const auto found = kConversions.find(encoding);
  cv::Mat pixels = bgr;
  if (found != kConversions.end()) cv::cvtColor(bgr, pixels, found->second);
  return toImageMessage(pixels.clone(), encoding);
}

inline geometry_msgs::TransformStamped toTransformMessage(const Eigen::Isometry3d& T_map_camera) {
  geometry_msgs::TransformStamped transform = tf2::eigenToTransform(T_map_camera);
  transform.header.frame_id = "map";
  transform.child_frame_id = kCameraFrame;
  return transform;
}

inline sensor_msgs::CameraInfo toInfoMessage(const CameraModel& camera) {
  sensor_msgs::CameraInfo info;
  info.header.frame_id = kCameraFrame;
  info.width = static_cast<std::uint32_t>(camera.width_px);
  info.height = static_cast<std::uint32_t>(camera.height_px);
  info.distortion_model = "plumb_bob";
  info.D.assign(5, 0.0);
  info.K = {camera.fx_px, 0.0, camera.cx_px, 0.0, camera.fy_px, camera.cy_px, 0.0, 0.0, 1.0};
  info.R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  info.P = {camera.fx_px, 0.0, camera.cx_px, 0.0, 0.0, camera.fy_px, camera.cy_px, 0.0, 0.0, 0.0, 1.0, 0.0};
  return info;
}

/// Bricks on the ground, z = 0 of the map, as a camera without noise sees them.
inline brick_detection::RenderedView renderBricks(const mp700_ur5e_description::BrickCatalogue& catalogue,
                                                  const std::vector<PlacedBrick>& bricks, const CameraModel& camera,
                                                  const Eigen::Isometry3d& T_map_camera) {
  brick_detection::RenderScene scene;
  scene.camera = camera;
  scene.family = catalogue.tags.family;
  scene.margin_cells = catalogue.tags.margin_cells;
  const Eigen::Isometry3d T_camera_map = T_map_camera.inverse();
  for (const PlacedBrick& brick : bricks) {
    scene.bricks.push_back(brick_detection::catalogueBrick(catalogue, brick.id, T_camera_map * brick.T_map_brick));
  }
  scene.T_camera_ground = T_camera_map;
  brick_detection::RenderEffects effects;
  effects.blur_sigma_px = 0.5;
  effects.noise_std = 2.0;
  return brick_detection::render(scene, effects, 1);
}

inline BrickFrame toFrame(const brick_detection::RenderedView& view, const CameraModel& camera,
                          const Eigen::Isometry3d& T_map_camera) {
  return {toColorMessage(view.color, "rgb8"), toImageMessage(view.depth_m, "32FC1"), toInfoMessage(camera),
          toTransformMessage(T_map_camera)};
}

/// A camera for one node under test, and an ear for what it says. The node listens below "<node>_in", so that several
/// nodes of one test do not hear each other's cameras.
class BrickCamera {
 public:
  explicit BrickCamera(const std::string& node) : bricks(node + "/bricks"), node_(node) {
    ros::NodeHandle in(node + "_in");
    color_ = in.advertise<sensor_msgs::Image>("color/image_raw", 100);
    depth_ = in.advertise<sensor_msgs::Image>("depth/image_rect", 100);
    info_ = in.advertise<sensor_msgs::CameraInfo>("color/camera_info", 100);
    tf_ = in.advertise<tf2_msgs::TFMessage>("tf", 100);
    update_subscriber_ = in.subscribe<DetectionUpdate>(
        node + "/update", 200, [this](const DetectionUpdate::ConstPtr& update) { updates.push_back(*update); });
    diagnostics_subscriber_ = in.subscribe<diagnostic_msgs::DiagnosticArray>(
        "/diagnostics", 100, [this](const diagnostic_msgs::DiagnosticArrayConstPtr& message) {
          for (const diagnostic_msgs::DiagnosticStatus& status : message->status) diagnostics_[status.name] = status;
        });
  }

  /// Arguments that make a node listen to this camera.
  static std::vector<std::string> remappings(const std::string& node) {
    std::vector<std::string> out;
    for (const char* topic : {"color/image_raw", "color/camera_info", "depth/image_rect"}) {
      out.push_back(std::string(topic) + ":=" + node + "_in/" + topic);
    }
    out.push_back("/tf:=" + node + "_in/tf");
    out.push_back("/tf_static:=" + node + "_in/tf_static");
    return out;
  }

  /// Waits until the node has subscribed and offers its services.
  bool isThere() {
    return waitUntil([this] {
      return color_.getNumSubscribers() > 0 && info_.getNumSubscribers() > 0 && tf_.getNumSubscribers() > 0 &&
             update_subscriber_.getNumPublishers() > 0 && ros::service::exists(node_ + "/detect", false);
    });
  }

  /// Waits until the node hears and is heard: until it has refused an image of encoding "probe".
  bool connect() {
    if (!isThere()) return false;
    // A subscriber is counted before its connection is ready: the first answers may be lost.
    sensor_msgs::Image probe;
    probe.encoding = "probe";
    probe.header.frame_id = kCameraFrame;
    for (int i = 0; i < 30; ++i) {
      probe.header.stamp = nextStamp();
      color_.publish(probe);
      if (waitUntil([&] { return !updates.empty() && updates.back().header.stamp == probe.header.stamp; }, 1.0)) {
        return true;
      }
    }
    return false;
  }

  /// Now, and after the last one.
  ros::Time nextStamp() {
    waitUntil([this] { return ros::Time::now() > stamp_; });
    stamp_ = ros::Time::now();
    return stamp_;
  }

  void publish(const BrickFrame& frame) {
    tf2_msgs::TFMessage transforms;
    transforms.transforms.push_back(frame.transform);
    tf_.publish(transforms);
    info_.publish(frame.info);
    if (!frame.depth.data.empty()) depth_.publish(frame.depth);
    color_.publish(frame.color);
  }
  void publish(const sensor_msgs::CameraInfo& info) { info_.publish(info); }
  void publish(const tf2_msgs::TFMessage& transforms) { tf_.publish(transforms); }
  void publishDepth(const sensor_msgs::Image& depth) { depth_.publish(depth); }

  /// What the node says about the image of this stamp that was published when `updates` had `since` entries.
  DetectionUpdate await(const ros::Time& stamp, std::size_t since) { return awaitUpdate(updates, stamp, since, node_); }

  /// Publishes all of the frame as it is, and waits for what becomes of it.
  DetectionUpdate lookAsIs(const BrickFrame& frame) {
    const std::size_t since = updates.size();
    publish(frame);
    return await(frame.color.header.stamp, since);
  }

  /// The same, exposed now.
  DetectionUpdate look(BrickFrame frame) {
    frame.setStamp(nextStamp());
    return lookAsIs(frame);
  }

  /// Camera info and image come by different connections: looks until it shows that the node has this info.
  DetectionUpdate lookUntil(const BrickFrame& frame, std::uint8_t status) {
    DetectionUpdate update;
    for (int i = 0; i < 200; ++i) {
      update = look(frame);
      if (update.status == status || update.status == DetectionUpdate::NUM_STATUS) return update;
    }
    ADD_FAILURE() << "status " << static_cast<int>(status) << " expected, still " << static_cast<int>(update.status)
                  << " " << update.message;
    return update;
  }

  /// What /diagnostics says under "<node>: <task>".
  diagnostic_msgs::DiagnosticStatus diagnostic(const std::string& task) const {
    const auto found = diagnostics_.find(node_.substr(1) + ": " + task);
    return found == diagnostics_.end() ? diagnostic_msgs::DiagnosticStatus() : found->second;
  }
  std::string diagnosticValue(const std::string& task, const std::string& key) const {
    for (const diagnostic_msgs::KeyValue& value : diagnostic(task).values) {
      if (value.key == key) return value.value;
    }
    return "";
  }

  const std::string& node() const { return node_; }

  std::vector<DetectionUpdate> updates;  // all, in the order they came
  Latest<BrickArray> bricks;

 private:
  std::string node_;
  ros::Publisher color_, depth_, info_, tf_;
  ros::Subscriber update_subscriber_, diagnostics_subscriber_;
  std::map<std::string, diagnostic_msgs::DiagnosticStatus> diagnostics_;
  ros::Time stamp_;
};

}  // namespace integration_tests
