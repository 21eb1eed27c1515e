// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>
#include <utility>

#include <ros/time.h>

#include "base_navigation/planar.h"

namespace base_navigation_ros {

/// Where the base was in `odom` in the last seconds: for scans, which are older than the newest odometry.
class OdometryHistory {
 public:
  explicit OdometryHistory(double memory_s = 3.0) : memory_s_(memory_s) {}

  /// False, and everything before is forgotten, if time ran back.
  bool add(const ros::Time& stamp, const base_navigation::Pose2d& T_odom_base);

  bool isEmpty() const { return poses_.empty(); }
  const ros::Time& newestStamp() const { return poses_.back().first; }            // unless empty
  const base_navigation::Pose2d& newest() const { return poses_.back().second; }  // unless empty

  /// Between two messages by moving evenly; up to 0.1 s beyond the ends: that pose. Nothing farther away.
  std::optional<base_navigation::Pose2d> at(const ros::Time& stamp) const;

 private:
  const double memory_s_;
  std::deque<std::pair<ros::Time, base_navigation::Pose2d>> poses_;  // by time
};

}  // namespace base_navigation_ros
