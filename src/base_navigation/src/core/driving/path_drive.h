// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "base_navigation/path_follower.h"
#include "driving/drive_data.h"

namespace base_navigation {

bool isZero(const Twist2d& twist);

/// The base on its path: driven along it, braked on it, or braked off it, where it can no longer tell where it is.
class PathDrive {
 public:
  PathDrive(const PathFollowerConfig& config, const MotionLimits& limits)
      : config_(config), follower_(config, limits) {}

  /// Other limits, with no path; the base is at rest.
  void setLimits(const MotionLimits& limits) { follower_ = PathFollower(config_, limits); }
  /// The next step.
  void setTime(double now_s, double dt_s) {
    now_s_ = now_s;
    dt_s_ = dt_s;
  }

  void start(const BasePath& path);
  /// Goes on from rest after the path was left. False: the base is too far off it.
  bool resume(const Pose2d& T_map_base);
  FollowCommand follow(const Pose2d& T_map_base, double speed_factor);
  /// The path is void; the base brakes on.
  void finish() { follower_.brake(dt_s_); }

  /// The base has been stopped without looking, or the localisation has jumped.
  void leavePath() { is_off_path_ = true; }
  /// At once: the base stops by itself.
  void halt() { follower_.halt(); }
  void setHard(bool is_hard) { is_hard_ = is_hard; }
  void brake(const DriveData& data);
  /// Brakes. True: the base stands.
  bool comeToStand(const DriveData& data);
  /// A new reason to brake: brakingTime() counts from the next command of zero.
  void restartBraking() { zero_since_s_.reset(); }
  /// How long the base has not come to rest, commanded zero [s].
  double brakingTime() const { return now_s_ - zero_since_s_.value_or(now_s_); }

  /// Commanded zero, and at rest by odometry.
  bool stands(const DriveData& data) const;
  bool isOffPath() const { return is_off_path_; }
  bool isActive() const { return follower_.isActive(); }
  double at() const { return at_m_; }  ///< along the path [m]
  const PathFollower& follower() const { return follower_; }
  const Twist2d& command() const { return follower_.lastCommand(); }

 private:
  PathFollowerConfig config_;
  PathFollower follower_;
  double now_s_{0.0};
  double dt_s_{0.0};
  double at_m_{0.0};
  bool is_off_path_{false};
  bool is_hard_{false};  // brakes with stop_m_s2: for a cancel, or a lost heartbeat
  std::optional<double> zero_since_s_;
};

}  // namespace base_navigation
