// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>

#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <ros/timer.h>
#include <rosgraph_msgs/Clock.h>

namespace interactive_mapping_ros {

/// A periodic timer in ROS time. Its callback runs in the queue of `handle`, never twice at once, and not after the
/// destructor. Under simulated time ros::Timer looks at the clock each millisecond of wall time; this one wakes with /clock.
/// There it fires at the first clock at or after each multiple of the period, and at once when the clock jumps.
class ClockTimer {
 public:
  /// Throws std::invalid_argument unless the period is positive.
  ClockTimer(ros::NodeHandle handle, ros::Duration period, std::function<void()> callback);
  ClockTimer(const ClockTimer&) = delete;
  ClockTimer& operator=(const ClockTimer&) = delete;

 private:
  void onClock(const rosgraph_msgs::Clock& clock);

  const std::uint64_t period_ns_;
  const std::function<void()> callback_;
  std::uint64_t periods_;  // whole ones, since time zero
  ros::Timer timer_;       // while time is not simulated
  ros::Subscriber clock_;  // while it is
};

}  // namespace interactive_mapping_ros
