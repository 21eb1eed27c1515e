// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "ur_driver_bridge/trajectory_check.h"

/// Other speeds along the same way: what is stopped stays on the path that was checked for collision. All points of the
/// results are on it. Between them the cubics leave it by less than a microradian at 10 ms. This grows with the fourth
/// power of the time between points. The trajectory's own points are points of the result, too: its acceleration jumps
/// there. Velocities are those of the trajectory or lower; to its acceleration a ramp of T adds up to velocity / T. All
/// results begin at time 0 (but reversed, which keeps the first time).
namespace ur_driver_bridge {

/// A stop that begins `at_s` into the trajectory at its full speed there: s(t) = at + t - t^2 / (2 T). It ends at rest
/// after `duration_s` of trajectory time. Position and velocity begin as the trajectory has them. Ends earlier if the
/// trajectory does. Points at most `sample_s` apart. One point where the arm stands: at or before the start of a
/// trajectory from rest, and after the end. To be checked with StartSpeed::kMoving. Throws std::invalid_argument for an
/// empty trajectory, numbers that are not finite, a duration or sample <= 0; so do the others.
JointTrajectory brake(const JointTrajectory& trajectory, double at_s, double duration_s, double sample_s = 0.01);

/// What remains from `at_s` on, from rest: s(t) = at + t^2 / (2 T), then at full speed. At the trajectory's end one point.
JointTrajectory resume(const JointTrajectory& trajectory, double at_s, double ramp_s, double sample_s = 0.01);

/// As far as `at_s`, where it comes to rest: full speed, then the last `ramp_s / 2` of the way braked. From rest if it
/// begins there; shorter ramps where there is no room. The end is exactly the trajectory's position at `at_s`.
JointTrajectory upTo(const JointTrajectory& trajectory, double at_s, double ramp_s, double sample_s = 0.01);

/// The same path from rest to rest, slower throughout by as little as keeps every acceleration within `limit_rad_s2`.
/// Unchanged if it keeps the limit already. Throws std::invalid_argument as the others, and if it does not begin and
/// end at rest.
JointTrajectory withinAcceleration(const JointTrajectory& trajectory, double limit_rad_s2);

/// The same way back, with the same speeds.
JointTrajectory reversed(const JointTrajectory& trajectory);

/// Where on the trajectory `position_rad` is: the time nearest to it (Euclidean in joint space) within `window_s` of
/// `near_s`. It is exact to a tenth of a millisecond where the arm moves. Where it stands still, the nearest to
/// `near_s`.
double timeOf(const JointTrajectory& trajectory, const ArmVector& position_rad, double near_s, double window_s);

}  // namespace ur_driver_bridge
