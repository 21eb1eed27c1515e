// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <random>
#include <vector>

#include <motion_planning/joint_trajectory.h>

#include "ur_driver_bridge/trajectory_check.h"

namespace ur_driver_bridge {

inline std::vector<std::string> armJoints() {
  return {"shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint",
          "wrist_1_joint",      "wrist_2_joint",       "wrist_3_joint"};
}

inline TrajectoryLimits armLimits() {
  TrajectoryLimits limits;
  limits.joints = armJoints();
  limits.lower_rad.setConstant(-3.0);
  limits.upper_rad.setConstant(3.0);
  limits.velocity_rad_s << 1.0, 1.1, 1.2, 1.3, 1.4, 1.5;
  limits.acceleration_rad_s2 << 1.5, 1.6, 1.7, 1.8, 1.9, 2.0;
  return limits;
}

inline motion_planning::MotionLimits plannerLimits(const TrajectoryLimits& limits) {
  return {limits.velocity_rad_s, limits.acceleration_rad_s2};
}

/// Along random waypoints within the limits, as the planner times them.
inline JointTrajectory plannedTrajectory(std::mt19937_64* random, const TrajectoryLimits& limits = armLimits()) {
  std::uniform_real_distribution<double> share(0.0, 1.0);
  std::uniform_int_distribution<int> count(2, 6);
  motion_planning::JointPath path(static_cast<std::size_t>(count(*random)));
  const double size = 0.05 + 0.95 * share(*random);
  for (ArmVector& q : path) {
    for (int i = 0; i < 6; ++i) {
      q[i] = size * (limits.lower_rad[i] + share(*random) * (limits.upper_rad[i] - limits.lower_rad[i]));
    }
  }
  return motion_planning::timeParametrize(path, plannerLimits(limits));
}

}  // namespace ur_driver_bridge
