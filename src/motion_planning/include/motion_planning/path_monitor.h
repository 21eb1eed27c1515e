// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "motion_planning/collision_checker.h"
#include "motion_planning/joint_trajectory.h"

namespace motion_planning {

struct PathMonitorConfig {
  double stop_clearance_m{0.0};  // beyond the collision test's own margins; 0: the test alone decides
  double sample_s{0.05};         // along the trajectory
  double horizon_s{1e9};         // looks ahead so far

  std::vector<std::string> validate() const;
};

struct PathVerdict {
  bool must_stop{false};
  std::string reason;             // empty unless must_stop
  double clearance_m{0.0};        // smallest over what remains, at most 0.5 m
  double time_to_contact_s{0.0};  // from now; infinite unless must_stop
  Contact contact;
};

/// Watches what remains of a running trajectory against the scene as it is now.
class PathMonitor {
 public:
  explicit PathMonitor(const PathMonitorConfig& config);

  /// `checker` knows what is held and what may be touched in this phase.
  void start(JointTrajectory trajectory, std::shared_ptr<const ArmKinematics> arm);
  void stop();
  bool isActive() const;

  /// `elapsed_s` since the start of the trajectory. Once told to stop, always told to stop, until start().
  PathVerdict check(double elapsed_s, const CollisionChecker& checker);

 private:
  PathMonitorConfig config_;
  std::optional<JointTrajectory> trajectory_;
  std::optional<PathVerdict> stopped_;
};

}  // namespace motion_planning
