// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "simulated_world/joint_spline.h"

namespace simulated_world {

/// A joint of the arm and what it can do, from the URDF.
struct JointLimits {
  std::string joint;
  double lower_rad = 0.0;
  double upper_rad = 0.0;
  double velocity_rad_s = 0.0;
  double effort_Nm = 0.0;
};

/// Values of control_msgs/FollowJointTrajectoryResult.
enum class GoalError {
  kSuccessful = 0,
  kInvalidGoal = -1,
  kInvalidJoints = -2,
  kOldHeaderTimestamp = -3,
  kPathToleranceViolated = -4,
  kGoalToleranceViolated = -5,
};

/// Arrays are in the order of the goal's joint names. Velocities and accelerations may be empty.
struct TrajectoryPoint {
  std::vector<double> positions_rad;
  std::vector<double> velocities_rad_s;
  std::vector<double> accelerations_rad_s2;
  double time_from_start_s = 0.0;
};

/// How far a joint may stray. 0: the controller's default, negative: no limit.
struct TrajectoryTolerance {
  std::string joint;
  double position_rad = 0.0;
  double velocity_rad_s = 0.0;
  double acceleration_rad_s2 = 0.0;  ///< accepted and not checked: the arm does not measure acceleration
};

struct TrajectoryGoal {
  std::string id;
  std::vector<std::string> joint_names;  ///< every joint of the arm, in any order
  double start_s = 0.0;                  ///< simulated time; 0: at once
  std::vector<TrajectoryPoint> points;   ///< none: stop
  std::vector<TrajectoryTolerance> path_tolerance;
  std::vector<TrajectoryTolerance> goal_tolerance;
  double goal_time_tolerance_s = 0.0;  ///< 0: the controller's default, negative: none
};

/// Whether a goal is taken on; if not, why.
struct GoalAnswer {
  bool accepted = false;
  GoalError error = GoalError::kSuccessful;
  std::string text;
};

/// The default tolerances and times of ur_robot_driver's scaled_pos_joint_traj_controller.
struct TrajectoryFollowerConfig {
  double path_tolerance_rad = 0.2;
  double goal_tolerance_rad = 0.1;
  double stopped_velocity_tolerance_rad_s = 0.05;
  double goal_time_s = 0.6;                 ///< in trajectory time: longer by as much as the speed is scaled down
  double stop_trajectory_duration_s = 0.5;  ///< from cancelling to rest

  /// One line per impossible value; empty: valid.
  std::vector<std::string> validate() const;
};

/// The tolerances of one joint that are checked; infinity: none.
struct JointTolerances {
  double path_position_rad = 0.0;
  double path_velocity_rad_s = 0.0;
  double goal_position_rad = 0.0;
  double goal_velocity_rad_s = 0.0;
};

/// A goal that can be followed; arrays in the order of the arm's joints.
struct CheckedGoal {
  std::string id;
  double start_s = 0.0;
  std::vector<JointWaypoint> points;  ///< times from the start
  std::vector<JointTolerances> tolerances;
  double goal_time_s = 0.0;
};

/// Whether every joint is named once, all numbers are finite and as many as joints, times increase, and neither the
/// points nor the ways between them demand more than the joints can do. Writes `checked` if accepted. Stricter than
/// ros_control, which knows no limits: there the UR controller refuses such a motion by a protective stop.
GoalAnswer checkGoal(const TrajectoryGoal& goal, const std::vector<JointLimits>& joints,
                     const TrajectoryFollowerConfig& config, CheckedGoal* checked);

/// What an impossible speed on the way from one position to another within a time is called; empty: possible.
std::string speedComplaint(const Eigen::VectorXd& from_rad, const Eigen::VectorXd& to_rad, double duration_s,
                           const std::vector<JointLimits>& joints);

}  // namespace simulated_world
