// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include <depth_camera_ros/image_worker.h>
#include <diagnostic_updater/diagnostic_updater.h>
#include <image_transport/image_transport.h>
#include <interactive_mapping_msgs/AttachedBrick.h>
#include <interactive_mapping_msgs/SelfFilterUpdate.h>
#include <ros/node_handle.h>
#include <ros/wall_timer.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/JointState.h>

#include "depth_self_filter/hand_history.h"
#include "depth_self_filter/joint_history.h"
#include "depth_self_filter/robot_mask.h"
#include "depth_self_filter_ros/conversions.h"
#include "depth_self_filter_ros/depth_self_filter_params.h"

namespace depth_self_filter_ros {

/// An image as it came.
struct WaitingImage {
  sensor_msgs::ImageConstPtr image;
  std::chrono::steady_clock::time_point arrival;
};

/// The self filter as a ROS node. In: depth images, camera info, joint states and the brick in the hand. Out: depth
/// images without the robot, statistics and diagnostics. The README lists them. The worker thread waits for what
/// belongs to an image, and filters it.
class DepthSelfFilterRos final : public depth_camera_ros::ImageWorker<WaitingImage> {
 public:
  /// Throws std::invalid_argument listing every impossible parameter, or what is wrong with the robot's description.
  DepthSelfFilterRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  ~DepthSelfFilterRos();

 private:
  using Update = interactive_mapping_msgs::SelfFilterUpdate;

  DepthSelfFilterRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, const DepthSelfFilterParams& params,
                     std::shared_ptr<const mp700_ur5e_description::RobotModel> robot);

  /// All that belongs to an image.
  struct Frame {
    depth_camera::DepthImage image;    // rectified
    depth_camera::CameraModel camera;  // of the rectified image
    sensor_msgs::CameraInfo info;
    Eigen::Isometry3d T_root_camera{Eigen::Isometry3d::Identity()};
    Eigen::VectorXd positions_rad;
    std::optional<depth_self_filter::HeldBrick> brick;
  };
  struct Counters {
    std::uint64_t received{0};
    std::uint64_t replaced{0};  // by a newer image while they waited
    std::array<std::uint64_t, Update::NUM_STATUS> by_status{};
    std::string last_drop;
    std::uint64_t bad_joint_states{0};
    std::string last_bad_joint_states;
    double last_filter_ms{0.0};
    std::optional<ros::WallTime> last_image, last_accepted;
  };

  void onImage(const sensor_msgs::ImageConstPtr& image);
  void onJointStates(const sensor_msgs::JointStateConstPtr& states);
  void onAttached(const interactive_mapping_msgs::AttachedBrickConstPtr& message);

  void process(const WaitingImage& job) override;
  /// Nothing, and the reason, when the image is dropped.
  std::optional<Frame> prepare(const sensor_msgs::Image& message, SteadyTime arrival, Drop* drop);
  std::optional<Eigen::Isometry3d> cameraPose(const std::string& camera_frame, const ros::Time& stamp,
                                              const Eigen::VectorXd& positions_rad, SteadyTime deadline, Drop* drop);
  depth_self_filter::JointHistory::Answer waitForJoints(double stamp_s, SteadyTime deadline);

  void diagnoseInput(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseJoints(diagnostic_updater::DiagnosticStatusWrapper& status);

  const DepthSelfFilterParams params_;
  const std::shared_ptr<const mp700_ur5e_description::RobotModel> robot_;
  depth_self_filter::RobotMask mask_;  // the worker's
  bool is_rectified_{false};
  depth_camera::DepthRectifier rectifier_;  // the worker's

  // mutex_ guards what follows, up to the blank line.
  depth_self_filter::JointHistory joints_;
  depth_self_filter::HandHistory hand_;
  std::string hand_problem_;  // of the last message about the hand; empty: none
  Counters counters_;

  image_transport::ImageTransport input_transport_, output_transport_;
  image_transport::Publisher image_publisher_;
  ros::Publisher info_publisher_, update_publisher_;
  image_transport::Subscriber image_subscriber_;
  ros::Subscriber joint_subscriber_, attached_subscriber_;
  diagnostic_updater::Updater diagnostics_;
  ros::WallTimer diagnostics_timer_;
};

}  // namespace depth_self_filter_ros
