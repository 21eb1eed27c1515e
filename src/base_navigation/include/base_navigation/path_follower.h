// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include <interactive_mapping_common/config/schema.h>

#include "base_navigation/base_path.h"

namespace base_navigation {

/// Farther off the path, the base is lost.
inline constexpr double kMaxError_m = 0.15;
inline constexpr double kMaxError_rad = 0.5;
/// A stretch is over within this of its end, or when the end is passed.
inline constexpr double kSettle_m = 0.005;
inline constexpr double kSettle_rad = 0.006;

struct PathFollowerConfig {
  double gain_along_1_s{2.0};
  double lag_s{0.09};
  double speed_reserve{0.9};
  double wait_m{0.05};

  static void fields(PathFollowerConfig& c, interactive_mapping::Fields& f) {
    f("gain_along_1_s", c.gain_along_1_s, 0.1, 20.0, "1/s", "Kanayama's gain of the error along the path");
    f("lag_s", c.lag_s, 0.0, 0.5, "s",
      "lag of commands and drives; the follower corrects the pose that the base will have after it");
    f("speed_reserve", c.speed_reserve, 0.1, 1.0, "",
      "share of the speed limits that plans use; the rest is left for corrections");
    f("wait_m", c.wait_m, 2.0 * kSettle_m, kMaxError_m, "m",
      "the reference slows down for a base that lags by half of this, and waits at all of it");
  }
};

enum class FollowStatus { kRunning, kReached, kLost };

struct FollowCommand {
  Twist2d twist;  // within limits of speed, and of acceleration against the command before
  FollowStatus status{FollowStatus::kRunning};
  double at_m{0.0};       // along the path, of the reference
  std::size_t motion{0};  // of the reference
  Pose2d reference_map;
  double error_across_m{0.0};  // signed, of the base: left of the reference positive
  double error_along_m{0.0};   // before the reference positive
  double error_yaw_rad{0.0};   // turned left of the reference positive
};

/// Drives along a path. A reference moves over it with trapezoidal speed and waits for a base that lags. The command is
/// the reference's speed plus the correction. Stands still between stretches. Long: one law of control; its parts
/// change the same reference.
class PathFollower {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  PathFollower(const PathFollowerConfig& config, const MotionLimits& limits);

  /// Begins at the path's start, from the speed commanded last (normally none). Throws std::invalid_argument if the path
  /// is not finite.
  void start(const BasePath& path);
  /// Goes on from a standstill, at the place of the present stretch that is nearest to the base. False, and nothing
  /// changes, if that is farther off than half of what counts as lost.
  bool resume(const Pose2d& pose_map);
  bool isActive() const { return path_.has_value(); }

  /// The speed that is wanted here by and by, at the reference's place, corrections included: what the obstacle guard is
  /// asked about. None while it stands or brakes between stretches. Throws std::logic_error unless active.
  Twist2d wanted(const Pose2d& pose_map) const;
  /// What is left of the present stretch, from the reference on; empty: it is over.
  std::vector<BaseMotion> ahead() const;

  /// `dt_s` since the last call (0 < dt <= 0.5, else std::invalid_argument); `speed_factor` in [0, 1]: share of wanted()
  /// that the obstacle guard leaves. The base is where `pose_map` says. kReached: the base has been commanded to stop, at
  /// the end of the path; kLost: it is too far off. Both end the following. Throws std::logic_error unless active.
  FollowCommand update(const Pose2d& pose_map, double dt_s, double speed_factor = 1.0);

  /// Ends the following and brakes within the limits, along the arc of the last command: the next command. Zero at last.
  Twist2d brake(double dt_s);
  /// Brakes likewise, and resume() may follow.
  Twist2d pause(double dt_s);
  /// As pause(), as hard as a stop on request: with stop_m_s2.
  Twist2d stop(double dt_s);
  /// The base stands (motors off, or a stop that was not ours): the next command starts from zero.
  void halt();

  const Twist2d& lastCommand() const { return last_; }

 private:
  /// A motion of the present stretch.
  struct Piece {
    double begin_m;  // along the stretch
    double end_m;
    double curvature_1_m;  // turn per metre driven, whatever the direction
    double max_speed_m_s;  // with the reserve
  };
  /// Where two motions of different curvature meet. A base cannot change its curvature at once. The step is driven as a
  /// ramp, half of it before the joint and half behind. So the second half makes up for the turn that came too early.
  struct Joint {
    double at_m;  // along the stretch
    double step_1_m;
    double half_m;     // length of half the ramp
    double speed_m_s;  // at most, on the ramp
  };
  struct Error {
    double along_m;   // of the reference, before the base positive
    double across_m;  // left of the base positive
    double yaw_rad;   // turned left of the base positive
  };

  void beginStretch();
  std::size_t pieceAt(double at_m) const;
  double plannedSpeed(double at_m) const;
  Pose2d referenceAt(double progress) const;
  double curvatureAt(double at_m) const;
  double yawAheadOf(double at_m) const;
  Pose2d expected(const Pose2d& pose_map) const;
  void observe(const Pose2d& pose_map, double dt_s);
  Error errorOf(const Pose2d& pose_map) const;
  Twist2d law(const Error& error, double speed) const;
  Twist2d limited(const Twist2d& wanted, double dt_s) const;
  Twist2d slowDown(double dt_s, double share);
  void report(const Pose2d& pose_map, FollowCommand* command) const;

  PathFollowerConfig config_;
  MotionLimits limits_;
  std::optional<BasePath> path_;
  std::vector<Stretch> stretches_;
  std::vector<Piece> pieces_;
  std::vector<Joint> joints_;
  std::vector<Pose2d> starts_map_;  // of the path's motions
  std::size_t stretch_{0};
  double stretch_at_m_{0.0};  // of its begin, along the path
  bool is_over_{false};       // the present stretch: the base is being stopped
  double progress_{0.0};      // of the reference along the stretch [m], or [rad] of a turn on the spot; not negative
  double reference_speed_{0.0};
  Twist2d last_;
  std::optional<Pose2d> smooth_map_;  // of the base: what was commanded, corrected by what was measured
};

}  // namespace base_navigation
