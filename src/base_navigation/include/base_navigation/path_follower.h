// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base_navigation/base_path.h"

namespace base_navigation {

struct PathFollowerConfig {
  // Kanayama et al. 1990, "A stable tracking control method for an autonomous mobile robot": error -> correction.
  double gain_along_1_s{1.0};
  double gain_across_1_m2{12.0};
  double gain_yaw_1_m{5.0};
  double gain_turn_1_s{2.0};  // of turns on the spot, angle error -> rate
  double speed_reserve{0.9};  // of the limits, for what is planned: the rest is for corrections
  double max_error_m{0.15};   // farther off the path: lost
  double max_error_rad{0.5};
  double settle_m{0.01};  // a stretch is over within this of its end, or when the end is passed
  double settle_rad{0.01};

  std::vector<std::string> validate() const;
};

enum class FollowStatus { kRunning, kReached, kLost };

struct FollowCommand {
  Twist2d twist;  // within limits of speed, and of acceleration against the command before
  FollowStatus status{FollowStatus::kRunning};
  double at_m{0.0};       // along the path, of the reference
  std::size_t motion{0};  // of the reference
  Pose2d reference_map;
  double error_across_m{0.0};  // signed, left of the reference positive
  double error_along_m{0.0};
  double error_yaw_rad{0.0};
};

/// Drives along a path: a reference moves over it with trapezoidal speed and waits for a base that lags; the command is the
/// reference's speed plus the correction. Stands still between stretches.
class PathFollower {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  PathFollower(const PathFollowerConfig& config, const MotionLimits& limits);

  /// Begins at the path's start, from the speed commanded last (normally none).
  void start(const BasePath& path);
  bool isActive() const;

  /// `dt_s` since the last call (0 < dt <= 0.5, else std::invalid_argument); `speed_factor` in [0, 1]: share of speed that
  /// the obstacle guard leaves. The base is where `pose_map` says.
  FollowCommand update(const Pose2d& pose_map, double dt_s, double speed_factor = 1.0);

  /// Brakes within the limits whatever was followed: the next command. Zero at last.
  Twist2d brake(double dt_s);
  /// The base stands (motors off, or a stop that was not ours): the next command starts from zero.
  void halt();

  const Twist2d& lastCommand() const { return last_; }

 private:
  PathFollowerConfig config_;
  MotionLimits limits_;
  std::optional<BasePath> path_;
  std::vector<Stretch> stretches_;
  std::size_t stretch_{0};
  double progress_{0.0};  // of the reference along the stretch [m], or [rad] of a turn on the spot
  double reference_speed_{0.0};
  Twist2d last_;
};

}  // namespace base_navigation
