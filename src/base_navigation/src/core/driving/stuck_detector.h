// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <string>

#include "driving/drive_data.h"

namespace base_navigation {

/// Compares what was commanded with what odometry and localisation measure.
class StuckDetector {
 public:
  explicit StuckDetector(const BaseNavigatorConfig& config) : config_(config) {}

  /// The base stands, or is to.
  void reset() { motions_.clear(); }
  void add(double now_s, double dt_s, const Twist2d& command, const DriveData& data);
  /// In words: what is stuck, by so long at least; empty: nothing.
  std::string find(double now_s, double least_s) const;

 private:
  struct Motion {
    double now_s;
    Pose2d commanded;
    double commanded_rad;
    Pose2d T_odom_base;
    Pose2d T_map_base;
  };

  std::string judge(const char* what, const std::string& by, Pose2d Motion::*measured, const Motion& last) const;

  const BaseNavigatorConfig& config_;
  std::deque<Motion> motions_;  // commanded and measured, since the base was told to move
  Pose2d commanded_;
  double commanded_rad_{0.0};
};

}  // namespace base_navigation
