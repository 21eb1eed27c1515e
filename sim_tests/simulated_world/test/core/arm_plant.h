// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "simulated_world/trajectory_goal.h"

namespace simulated_world {

inline std::vector<JointLimits> twoJoints() {
  return {{"pan", -6.0, 6.0, 3.0, 150.0}, {"lift", -2.0, 1.0, 1.0, 150.0}};
}

/// An arm whose joints approach the setpoint with a time constant; 0: at once.
struct ArmPlant {
  double time_constant_s = 0.0;
  bool is_blocked = false;
  Eigen::VectorXd position_rad = Eigen::Vector2d::Zero();
  Eigen::VectorXd velocity_rad_s = Eigen::Vector2d::Zero();

  void follow(const JointMotion& setpoint, double dt_s) {
    if (is_blocked) {
      velocity_rad_s.setZero();
    } else if (time_constant_s == 0.0) {
      position_rad = setpoint.position_rad;
      velocity_rad_s = setpoint.velocity_rad_s;
    } else {
      velocity_rad_s = (setpoint.position_rad - position_rad) / std::max(time_constant_s, dt_s);
      position_rad += velocity_rad_s * dt_s;
    }
  }
};

/// From wherever the arm is to (pan, lift) at rest within a time.
inline TrajectoryGoal goTo(const std::string& id, double pan_rad, double lift_rad, double time_s) {
  TrajectoryGoal goal;
  goal.id = id;
  goal.joint_names = {"pan", "lift"};
  goal.points = {{{pan_rad, lift_rad}, {0.0, 0.0}, {0.0, 0.0}, time_s}};
  return goal;
}

}  // namespace simulated_world
