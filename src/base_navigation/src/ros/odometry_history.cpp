// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation_ros/odometry_history.h"

#include <algorithm>

namespace base_navigation_ros {

using base_navigation::Pose2d;

namespace {
constexpr double kMaxBeyond_s = 0.1;
}

bool OdometryHistory::add(const ros::Time& stamp, const Pose2d& T_odom_base) {
  const bool ran_back = !poses_.empty() && stamp < poses_.back().first;
  if (ran_back) poses_.clear();
  if (!poses_.empty() && stamp == poses_.back().first) poses_.pop_back();
  poses_.emplace_back(stamp, T_odom_base);
  while ((stamp - poses_.front().first).toSec() > memory_s_) poses_.pop_front();
  return !ran_back;
}

std::optional<Pose2d> OdometryHistory::at(const ros::Time& stamp) const {
  if (poses_.empty()) return std::nullopt;
  const auto after = std::lower_bound(poses_.begin(), poses_.end(), stamp,
                                      [](const auto& entry, const ros::Time& time) { return entry.first < time; });
  if (after == poses_.end()) {
    if ((stamp - poses_.back().first).toSec() > kMaxBeyond_s) return std::nullopt;
    return poses_.back().second;
  }
  if (after == poses_.begin()) {
    if ((after->first - stamp).toSec() > kMaxBeyond_s) return std::nullopt;
    return after->second;
  }
  const auto before = std::prev(after);
  const double share = (stamp - before->first).toSec() / (after->first - before->first).toSec();
  const Pose2d& a = before->second;
  const Pose2d& b = after->second;
  return Pose2d{a.x_m + share * (b.x_m - a.x_m), a.y_m + share * (b.y_m - a.y_m),
                base_navigation::wrapAngle(a.yaw_rad + share * base_navigation::wrapAngle(b.yaw_rad - a.yaw_rad))};
}

}  // namespace base_navigation_ros
