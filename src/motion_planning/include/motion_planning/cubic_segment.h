// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "motion_planning/joint_trajectory.h"

namespace motion_planning {

/// The cubic that joins position and velocity of two points of a trajectory, as a joint trajectory controller interpolates.
/// Acceleration is linear. Times t are from the first point [s]. The second point is later than the first.
struct CubicSegment {
  double duration_s;
  ArmVector position_rad;         // at the begin, as ...
  ArmVector velocity_rad_s;       // ... this
  ArmVector acceleration_rad_s2;  // ... and this
  ArmVector end_acceleration_rad_s2;

  CubicSegment(const TrajectoryPoint& a, const TrajectoryPoint& b)
      : duration_s(b.time_s - a.time_s), position_rad(a.position_rad), velocity_rad_s(a.velocity_rad_s) {
    const ArmVector mean_rad_s = (b.position_rad - a.position_rad) / duration_s;
    acceleration_rad_s2 = (6.0 * mean_rad_s - 4.0 * a.velocity_rad_s - 2.0 * b.velocity_rad_s) / duration_s;
    end_acceleration_rad_s2 = (-6.0 * mean_rad_s + 2.0 * a.velocity_rad_s + 4.0 * b.velocity_rad_s) / duration_s;
  }

  ArmVector jerk() const { return (end_acceleration_rad_s2 - acceleration_rad_s2) / duration_s; }  // [rad/s^3]
  ArmVector positionAt(double t) const {
    return position_rad + t * (velocity_rad_s + t * (0.5 * acceleration_rad_s2 + t / 6.0 * jerk()));
  }
  ArmVector velocityAt(double t) const { return velocity_rad_s + t * (acceleration_rad_s2 + 0.5 * t * jerk()); }
  ArmVector accelerationAt(double t) const { return acceleration_rad_s2 + t * jerk(); }
};

}  // namespace motion_planning
