// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <utility>
#include <vector>

#include <diagnostic_updater/diagnostic_updater.h>
#include <nav_msgs/Odometry.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>

#include "system_diagnostics/tree_watch.h"
#include "system_diagnostics_ros/system_diagnostics_params.h"

namespace system_diagnostics_ros {

/// Topics in, /diagnostics out. All callbacks come from one thread.
class SystemDiagnosticsRos {
 public:
  /// Throws std::invalid_argument for bad parameters.
  SystemDiagnosticsRos(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);

 private:
  using TransformEvent = ros::MessageEvent<tf2_msgs::TFMessage const>;
  struct Watch {
    WatchedTransform frames;
    system_diagnostics::TransformWatch watch;
  };

  void onTransforms(const TransformEvent& event, bool is_static);
  void onImage(const ros::MessageEvent<sensor_msgs::Image const>& event);
  void onOdometry(const ros::MessageEvent<nav_msgs::Odometry const>& event);
  /// Now; forgets everything when the clock has gone back.
  ros::Time checkClock();

  void diagnoseTransform(std::size_t index, diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseTree(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseArrival(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseMotion(diagnostic_updater::DiagnosticStatusWrapper& status);

  const SystemDiagnosticsParams params_;
  tf2::BufferCore buffer_;
  std::vector<Watch> watches_;
  system_diagnostics::TreeWatch tree_;
  system_diagnostics::DelayStatistics delays_;
  system_diagnostics::ImageShiftMeter shift_meter_;
  system_diagnostics::TimeOffsetEstimator estimator_;
  ros::Time last_now_;
  ros::Time last_image_stamp_;
  std::string image_problem_;  // empty: none

  diagnostic_updater::Updater diagnostics_;
  ros::Subscriber tf_subscriber_;
  ros::Subscriber tf_static_subscriber_;
  ros::Subscriber image_subscriber_;
  ros::Subscriber odometry_subscriber_;
  ros::WallTimer diagnostics_timer_;
};

}  // namespace system_diagnostics_ros
