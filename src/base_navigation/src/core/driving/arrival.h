// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <optional>

#include "base_navigation/planar.h"

namespace base_navigation {

/// Where the base stands at the end of its way: the mean of the poses there, whose noise is not the base's.
class Arrival {
 public:
  void start(double now_s) {
    since_s_ = now_s;
    num_poses_ = 0;
    position_sum_.setZero();
    heading_sum_.setZero();
  }

  /// Nothing: not known yet.
  std::optional<Pose2d> add(double now_s, double pose_stamp_s, const Pose2d& T_map_base) {
    if (pose_stamp_s != last_stamp_s_) {
      last_stamp_s_ = pose_stamp_s;
      position_sum_ += T_map_base.position();
      heading_sum_ += Eigen::Vector2d(std::cos(T_map_base.yaw_rad), std::sin(T_map_base.yaw_rad));
      ++num_poses_;
    }
    if (now_s - since_s_ < kLook_s || num_poses_ == 0) return std::nullopt;
    const Eigen::Vector2d mean = position_sum_ / num_poses_;
    return Pose2d{mean.x(), mean.y(), std::atan2(heading_sum_.y(), heading_sum_.x())};
  }

 private:
  static constexpr double kLook_s = 0.3;

  double since_s_{0.0};
  int num_poses_{0};
  Eigen::Vector2d position_sum_{Eigen::Vector2d::Zero()};
  Eigen::Vector2d heading_sum_{Eigen::Vector2d::Zero()};
  double last_stamp_s_{-1.0};
};

}  // namespace base_navigation
