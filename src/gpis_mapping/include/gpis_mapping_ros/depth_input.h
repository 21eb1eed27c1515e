// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_ROS_DEPTH_INPUT_H
#define GPIS_MAPPING_ROS_DEPTH_INPUT_H

#include <array>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <Eigen/Geometry>
#include <boost/signals2/connection.hpp>
#include <image_transport/image_transport.h>
#include <ros/node_handle.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include "gpis_mapping/pose_guard.h"
#include "gpis_mapping/types.h"
#include "gpis_mapping_ros/conversions.h"

namespace gpis_mapping_ros {

struct DepthInputParams {
  std::string map_frame{"map"};
  std::string camera_frame;  // empty: the image's own frame_id
  std::string image_transport{"raw"};
  double depth_units_per_metre{1000.0};  // of 16UC1 images
  double tf_timeout_s{0.2};              // how long an image waits for its pose and camera info, by the wall clock
  double max_future_s{0.5};              // how far a stamp may lie ahead of ROS time
  gpis_mapping::PoseLimits pose_limits;

  /// Every problem as "key = value unit, must be ...".
  std::vector<std::string> validate() const;
};

/// A depth image that passed every check.
struct DepthInputFrame {
  gpis_mapping::DepthImage image;
  gpis_mapping::CameraModel camera;
  Eigen::Isometry3d T_map_camera{Eigen::Isometry3d::Identity()};
  ros::Time stamp;
  std::string camera_frame;
  double wait_ms{0.0};  // from arrival to the begin of its processing
};

/// What happened so far; for diagnostics.
struct DepthInputCounters {
  std::uint64_t received{0};
  std::uint64_t replaced{0};  // by a newer image while they waited
  std::uint64_t settled_jumps{0};
  std::array<std::uint64_t, kNumFrameStatus> by_status{};
  std::string last_refusal;
  double last_tf_age_s{0.0};  // newest pose in tf, how old at the time of the last image's look-up
  bool has_tf_age{false};
  std::string warning;  // of the kind that does not stop anything
};

/// Depth images with camera info and tf, checked, one at a time. Subscribes `depth/image_rect` and `depth/camera_info`
/// relative to `nh`. A worker thread takes the newest image, waits for its pose, checks it and hands it to `consume`; an
/// image that comes meanwhile replaces the one that waits. Callbacks of subscriptions only store what they get; they
/// may run in any callback queue. Neither `consume` nor `refuse` is called after the destructor has begun to return.
class DepthInput {
 public:
  /// Called on the worker thread. Returns why the consumer did not want the frame, or a status of kAccepted.
  using Consume = std::function<Refusal(const DepthInputFrame&)>;
  /// Called on the worker thread for each image that is left out.
  using Refuse = std::function<void(const ros::Time& stamp, const Refusal&)>;

  /// `private_nh` names the transport hints' namespace. Throws std::invalid_argument for impossible parameters.
  DepthInput(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, const DepthInputParams& params,
             Consume consume, Refuse refuse);
  ~DepthInput();
  DepthInput(const DepthInput&) = delete;
  DepthInput& operator=(const DepthInput&) = delete;

  DepthInputCounters counters() const;
  void setPoseLimits(const gpis_mapping::PoseLimits& limits);
  /// Believes the next pose, whatever it is: for a map that was cleared or loaded.
  void resetPoseGuard();

  const DepthInputParams& params() const { return params_; }
  const tf2_ros::Buffer& tfBuffer() const { return tf_buffer_; }
  std::string imageTopic() const { return image_subscriber_.getTopic(); }
  std::string infoTopic() const { return info_subscriber_.getTopic(); }

 private:
  using SteadyTime = std::chrono::steady_clock::time_point;

  struct Waiting {
    sensor_msgs::ImageConstPtr image;
    SteadyTime arrival;
  };

  void onImage(const sensor_msgs::ImageConstPtr& image);
  void onInfo(const sensor_msgs::CameraInfoConstPtr& info);
  void work();
  /// Everything between arrival and `consume`. Nothing, and the reason, when the image is left out.
  std::optional<DepthInputFrame> prepare(const Waiting& waiting, Refusal* refusal);
  bool checkTime(const ros::Time& stamp, Refusal* refusal);
  sensor_msgs::CameraInfoConstPtr waitForInfo(SteadyTime deadline);
  void noteTfAge(const std::string& camera_frame, const ros::Time& stamp);
  /// Waits until tf can answer, or the deadline, or the end.
  std::optional<Eigen::Isometry3d> lookUpPose(const std::string& camera_frame, const ros::Time& stamp,
                                              SteadyTime deadline, Refusal* refusal);
  void count(const Refusal& refusal);

  const DepthInputParams params_;
  Consume consume_;
  Refuse refuse_;
  bool is_rectified_{false};

  mutable std::mutex mutex_;  // guards what follows, up to the blank line
  std::condition_variable changed_;
  bool is_stopping_{false};
  std::optional<Waiting> waiting_;
  sensor_msgs::CameraInfoConstPtr info_;
  DepthInputCounters counters_;
  std::uint64_t num_tf_messages_{0};
  std::optional<gpis_mapping::PoseLimits> new_limits_;
  bool reset_guard_{false};

  // Of the worker alone.
  gpis_mapping::PoseGuard guard_;
  ros::Time last_stamp_;

  tf2_ros::Buffer tf_buffer_;
  tf2_ros::TransformListener tf_listener_;
  boost::signals2::connection tf_connection_;
  image_transport::ImageTransport transport_;
  image_transport::Subscriber image_subscriber_;
  ros::Subscriber info_subscriber_;
  std::thread worker_;  // last: everything it uses exists before it
};

}  // namespace gpis_mapping_ros

#endif  // GPIS_MAPPING_ROS_DEPTH_INPUT_H
