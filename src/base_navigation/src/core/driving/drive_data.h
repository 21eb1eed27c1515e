// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "base_navigation/base_navigator.h"

namespace base_navigation {

/// How a goal ends.
struct Ending {
  NavigationStatus status{NavigationStatus::kSuccess};
  std::string message;
};

/// A source of data: its newest stamp that can be true, and what is wrong with what came since.
struct Source {
  const char* article;
  const char* noun;
  double stamp_s{-1.0};
  std::string refused{};
  std::string problem{};  // of what came last, told by who hears it

  std::string name() const { return std::string(article) + noun; }
  void reset();
  /// Whether something new has come.
  bool accept(double stamp, double now_s, bool is_finite);
  /// Why it cannot be used; empty: it can. `max_age_s` infinite: once it has come, it can.
  std::string stale(double now_s, double max_age_s) const;
};

/// What is known of the base and of what is about it, as far as it can be true.
class DriveData {
 public:
  DriveData(const BaseNavigatorConfig& config, const MotionLimits& limits) : config_(config), limits_(limits) {}

  void take(const NavigationInput& input);
  /// Sources that were refused may have begun again.
  void forget();
  /// What all stamps meant is void: a bag or a simulation began again.
  void forgetTimes();

  /// What cannot be driven with, and why.
  std::optional<Ending> stale(double now_s) const;
  bool isOdometryFresh(double now_s) const { return odometry_.stale(now_s, config_.max_odometry_age_s).empty(); }
  bool isPoseFresh(double now_s) const { return pose_.stale(now_s, config_.max_pose_age_s).empty(); }
  /// What was seen before a jump is in the wrong place, and where it has been forgotten nothing is known yet.
  bool isScanFromBeforeJump() const { return scan_.stamp_s <= jumped_s_; }
  /// By odometry, at its last message.
  bool stands() const;

  double poseStamp() const { return pose_.stamp_s; }
  /// The base now, in base_link when the scan was taken.
  Pose2d motionSinceScan() const;

  Pose2d T_odom_base;
  Twist2d odometry_twist;
  Pose2d T_map_base;  // at the newest odometry
  Pose2d T_map_base_at_pose;
  std::shared_ptr<const Scan> scan;
  std::shared_ptr<const NavigationGrid> grid;
  bool has_jumped{false};  // localisation or odometry, with what was taken last
  std::string jump;        // in words; empty: none to stop for

 private:
  void takeOdometry(const NavigationInput& input);
  void takePose(const NavigationInput& input);

  const BaseNavigatorConfig& config_;
  const MotionLimits& limits_;
  Source odometry_{"", "odometry"};
  Source pose_{"the ", "pose in the map"};
  Source scan_{"the ", "scan"};
  Source grid_{"the ", "map"};
  Source heartbeat_{"the ", "heartbeat"};
  std::deque<std::pair<double, Pose2d>> odometry_history_;
  bool is_pose_known_{false};  // since the clock last ran back, a new goal or not
  Pose2d T_odom_base_at_pose_;
  bool was_odometry_fresh_at_pose_{false};
  double jumped_s_{-std::numeric_limits<double>::infinity()};  // the last time
};

}  // namespace base_navigation
