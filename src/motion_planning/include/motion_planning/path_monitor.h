// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "motion_planning/collision_checker.h"
#include "motion_planning/joint_trajectory.h"

namespace motion_planning {

struct PathMonitorConfig {
  double stop_clearance_m{0.0};   // beyond the collision test's own margins; 0: the test alone decides
  double sample_s{0.05};          // along the trajectory, and more densely where
  double sample_rad{0.035};       // a joint would move farther than this in between
  double horizon_s{1e9};          // looks ahead so far
  double clearance_step_m{0.01};  // the clearance told is too large by no more, as far as 40 looks allow

  std::vector<std::string> validate() const;
};

struct PathVerdict {
  bool must_stop{false};
  std::string reason;             // empty unless must_stop
  double clearance_m{0.0};        // smallest over what remains, at most kMaxClearance_m; once stopped, of that moment
  double time_to_contact_s{0.0};  // from now; infinite unless must_stop
  Contact contact;
};

constexpr double kMaxClearance_m = 0.5;

/// Watches what remains of a running trajectory against the scene as it is now.
class PathMonitor {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  explicit PathMonitor(const PathMonitorConfig& config);

  /// Watches this trajectory from now on. Throws std::invalid_argument if it is empty.
  void start(JointTrajectory trajectory, std::shared_ptr<const ArmKinematics> arm);
  void stop();
  bool isActive() const;

  /// `elapsed_s` since the start of the trajectory; `checker` knows what is held and what may be touched in this phase,
  /// and the scene as it is now. Once told to stop, always told to stop, until start(). Throws std::logic_error unless
  /// active.
  PathVerdict check(double elapsed_s, const CollisionChecker& checker);

 private:
  PathMonitorConfig config_;
  std::optional<JointTrajectory> trajectory_;
  std::shared_ptr<const ArmKinematics> arm_;
  std::optional<PathVerdict> stopped_;
};

}  // namespace motion_planning
