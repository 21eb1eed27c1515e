// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include <depth_camera_ros/camera_pose_source.h>
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

/// The self filter as a ROS node: depth images, camera info, joint states and the brick in the hand in; depth images
/// without the robot, statistics and diagnostics out. The README lists them. Callbacks only store what they get and may run
/// concurrently; a worker thread takes the newest image, waits for what belongs to it, and filters it. An image that comes
/// meanwhile replaces the one that waits.
class DepthSelfFilterRos {
 public:
  /// Throws std::invalid_argument listing every impossible parameter, or what is wrong with the robot's description.
  DepthSelfFilterRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  ~DepthSelfFilterRos();
  DepthSelfFilterRos(const DepthSelfFilterRos&) = delete;
  DepthSelfFilterRos& operator=(const DepthSelfFilterRos&) = delete;

 private:
  using Update = interactive_mapping_msgs::SelfFilterUpdate;
  using SteadyTime = std::chrono::steady_clock::time_point;

  struct Waiting {
    sensor_msgs::ImageConstPtr image;
    SteadyTime arrival;
  };
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
  void onInfo(const sensor_msgs::CameraInfoConstPtr& info);
  void onJointStates(const sensor_msgs::JointStateConstPtr& states);
  void onAttached(const interactive_mapping_msgs::AttachedBrickConstPtr& message);

  void work();
  /// Nothing, and the reason, when the image is dropped.
  std::optional<Frame> prepare(const sensor_msgs::Image& message, SteadyTime arrival, Drop* drop);
  std::optional<Eigen::Isometry3d> cameraPose(const std::string& camera_frame, const ros::Time& stamp,
                                              const Eigen::VectorXd& positions_rad, SteadyTime deadline, Drop* drop);
  depth_self_filter::JointHistory::Answer waitForJoints(double stamp_s, SteadyTime deadline);
  sensor_msgs::CameraInfoConstPtr waitForInfo(SteadyTime deadline);
  bool isStopping() const;

  void diagnoseInput(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseJoints(diagnostic_updater::DiagnosticStatusWrapper& status);

  const DepthSelfFilterParams params_;
  const std::shared_ptr<const mp700_ur5e_description::RobotModel> robot_;
  depth_self_filter::RobotMask mask_;  // the worker's
  bool is_rectified_{false};
  depth_camera::DepthRectifier rectifier_;  // the worker's

  mutable std::mutex mutex_;  // guards what follows, up to the blank line
  std::condition_variable changed_;
  bool is_stopping_{false};
  std::optional<Waiting> waiting_;
  sensor_msgs::CameraInfoConstPtr info_;
  depth_self_filter::JointHistory joints_;
  depth_self_filter::HandHistory hand_;
  std::string hand_problem_;  // of the last message about the hand; empty: none
  Counters counters_;

  depth_camera_ros::CameraPoseSource pose_source_;  // of cameras that the URDF does not have; checks the stamps of all
  image_transport::ImageTransport input_transport_, output_transport_;
  image_transport::Publisher image_publisher_;
  ros::Publisher info_publisher_, update_publisher_;
  image_transport::Subscriber image_subscriber_;
  ros::Subscriber info_subscriber_, joint_subscriber_, attached_subscriber_;
  diagnostic_updater::Updater diagnostics_;
  ros::WallTimer diagnostics_timer_;
  std::thread worker_;  // last: everything it uses exists before it
};

}  // namespace depth_self_filter_ros
