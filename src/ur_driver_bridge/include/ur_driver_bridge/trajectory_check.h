// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "motion_planning/joint_trajectory.h"
#include "ur_driver_bridge/arm_state.h"
#include "ur_driver_bridge/arm_status.h"

namespace ur_driver_bridge {

using motion_planning::JointTrajectory;
using motion_planning::TrajectoryPoint;

struct TrajectoryLimits {
  std::vector<std::string> joints;  // names, for messages; in the order of ArmVector
  ArmVector lower_rad{ArmVector::Constant(-1.0)};
  ArmVector upper_rad{ArmVector::Constant(1.0)};
  ArmVector velocity_rad_s{ArmVector::Constant(1.0)};
  ArmVector acceleration_rad_s2{ArmVector::Constant(2.0)};

  std::vector<std::string> validate() const;
};

/// What is asked of the first point: a stop begins in motion.
enum class StartSpeed { kAtRest, kMoving };

/// Whether a controller can follow it. It must have at least one point, be finite, with first time >= 0 and times
/// strictly rising, and be at rest at both ends. Joints must be within their limits. Velocity and acceleration must be
/// within theirs everywhere, also between the points as the cubics go (JointTrajectory::sample). `tolerance` is a share
/// of velocity and acceleration limits that is allowed beyond (the planner's own sampling). Times may be rounded to
/// nanoseconds, as in messages; what that may seem to be between near points it may not be over many. kBadRequest or
/// kBeyondLimits, naming point, joint, value and limit. Throws std::invalid_argument for impossible limits or
/// tolerance.
Verdict checkTrajectory(const JointTrajectory& trajectory, const TrajectoryLimits& limits, double tolerance = 0.01,
                        StartSpeed start = StartSpeed::kAtRest);

/// Whether the arm stands where the trajectory begins; kStartMismatch names the worst joint. `arm` in the same turn as the
/// trajectory: 2 pi apart is another place.
Verdict checkStart(const JointTrajectory& trajectory, const ArmVector& arm_rad, const std::vector<std::string>& joints,
                   double tolerance_rad);

}  // namespace ur_driver_bridge
