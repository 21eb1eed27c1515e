// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <image_transport/image_transport.h>
#include <ros/node_handle.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include "brick_detection/calibration_file.h"
#include "brick_detection/calibration_session.h"
#include "brick_detection_ros/camera_calibrator_params.h"

namespace brick_detection_ros {

/// Where the mast's camera is, from a target on the arm's tool. Somebody, or a program, moves the arm; this watches image
/// and tf and takes samples at standstills, by service or by itself. Subscribes `color/image_raw`, `color/camera_info`
/// and `depth/image_rect`. Serves ~take_sample, ~discard_last, ~solve and ~save (std_srvs/Trigger, whose message says
/// what was done, or why not). Publishes ~samples (the tool's poses) and ~camera (the answer), latched.
class CameraCalibrator {
 public:
  /// Throws std::invalid_argument for impossible parameters and a target that does not exist.
  CameraCalibrator(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, const CameraCalibratorParams& params);
  ~CameraCalibrator();
  CameraCalibrator(const CameraCalibrator&) = delete;
  CameraCalibrator& operator=(const CameraCalibrator&) = delete;

 private:
  using Request = std_srvs::Trigger::Request;
  using Response = std_srvs::Trigger::Response;

  /// What was last received.
  struct Inputs {
    sensor_msgs::ImageConstPtr image;
    sensor_msgs::CameraInfoConstPtr info;
    sensor_msgs::ImageConstPtr depth;  // of the image's time, or none
  };

  void onImage(const sensor_msgs::ImageConstPtr& image);
  void onInfo(const sensor_msgs::CameraInfoConstPtr& info);
  void onDepth(const sensor_msgs::ImageConstPtr& depth);
  void onTimer(const ros::WallTimerEvent& event);
  bool onTakeSample(Request& request, Response& response);
  bool onDiscardLast(Request& request, Response& response);
  bool onSolve(Request& request, Response& response);
  bool onSave(Request& request, Response& response);

  Inputs inputs();
  /// Each returns true and sets `message` to what was done, or false and why not.
  bool takeSample(const Inputs& inputs, std::string* message);
  bool solve(std::string* message);
  bool save(std::string* message);

  /// The tool's poses over the time before the image, that of the image last. Empty, and the reason, without tf.
  std::vector<Eigen::Isometry3d> toolPoses(const ros::Time& stamp, std::string* why_not);
  std::optional<Eigen::Isometry3d> lookUp(const std::string& target, const std::string& source, const ros::Time& stamp,
                                          std::string* why_not) const;
  std::optional<brick_detection::CalibratedEdge> edge(std::string* why_not) const;
  void publishSamples();
  void publishCamera();

  const CameraCalibratorParams params_;

  std::mutex inputs_mutex_;  // guards what follows, up to the blank line
  std::condition_variable tf_changed_;
  sensor_msgs::ImageConstPtr image_;
  sensor_msgs::CameraInfoConstPtr info_;
  std::deque<sensor_msgs::ImageConstPtr> depths_;  // the last few
  bool is_stopping_{false};

  std::mutex work_mutex_;  // guards what follows, up to the blank line: one sample, one solution at a time
  brick_detection::TargetFinder finder_;
  brick_detection::CalibrationSession session_;
  std::string camera_frame_;                              // of the samples' images
  ros::Time tried_stamp_;                                 // of the last image looked at by itself
  std::optional<brick_detection::HandEyeResult> result_;  // of the samples as they are

  tf2_ros::Buffer tf_buffer_;
  boost::signals2::connection tf_connection_;
  std::optional<tf2_ros::TransformListener> tf_listener_;
  image_transport::ImageTransport transport_;
  image_transport::Subscriber image_subscriber_, depth_subscriber_;
  ros::Subscriber info_subscriber_;
  ros::Publisher samples_publisher_, camera_publisher_;
  ros::ServiceServer take_sample_, discard_last_, solve_, save_;
  ros::WallTimer timer_;
};

}  // namespace brick_detection_ros
