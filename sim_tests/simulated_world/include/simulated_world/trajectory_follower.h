// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "simulated_world/joint_spline.h"
#include "simulated_world/trajectory_goal.h"

namespace simulated_world {

enum class GoalOutcome { kSucceeded, kAborted, kPreempted, kCanceled };

struct GoalResult {
  std::string goal_id;
  GoalOutcome outcome = GoalOutcome::kSucceeded;
  GoalError error = GoalError::kSuccessful;
  std::string text;
};

/// Behaves as ros_control's (scaled) joint trajectory controller: follows one trajectory goal at a time, samples it at a
/// time that passes slower when the speed is scaled down, and watches the tolerances. Differences, all on the strict
/// side: demands beyond the limits are refused (checkGoal); a goal whose first point is at time 0 wants the arm there
/// and is aborted if it is not; a goal with a start time to come makes the arm stop until then; after an abort the arm
/// stops, and it does so in real time whatever the speed scaling. Deterministic; single-threaded.
class TrajectoryFollower {
 public:
  /// Throws std::invalid_argument listing everything that is impossible.
  TrajectoryFollower(std::vector<JointLimits> joints, const TrajectoryFollowerConfig& config);

  /// A goal taken on replaces the one that runs. Refused before the first update: the arm's position is not known.
  GoalAnswer acceptGoal(const TrajectoryGoal& goal, double now_s);

  /// Stops the arm if `goal_id` is the goal that runs or waits; false: it is not.
  bool cancelGoal(const std::string& goal_id);

  /// The program or the robot stopped: the arm brakes from where and how fast it is, and the goal is dead.
  void halt(const std::string& reason);

  /// Holds the measured position, as a controller that is started; an arm that still brakes does so to the end.
  void restart();

  /// Advances by dt_s > 0. Measured values in the order of the joints. Returns the setpoint for the joints' servos;
  /// velocity and acceleration in real time, not trajectory time. Throws std::invalid_argument on sizes, NaN or dt.
  const JointMotion& update(double now_s, double dt_s, double speed_scaling, const Eigen::VectorXd& measured_rad,
                            const Eigen::VectorXd& measured_rad_s);

  /// Goals that ended since the last call, in order.
  std::vector<GoalResult> takeResults();

  const std::vector<JointLimits>& joints() const { return joints_; }
  const JointMotion& desired() const { return desired_; }
  const JointMotion& actual() const { return actual_; }
  /// Desired minus actual.
  JointMotion error() const;
  /// Id of the goal that runs or waits for its start.
  std::optional<std::string> activeGoal() const;
  /// Time since the start of the running trajectory, in trajectory time; 0 without one.
  double trajectoryTime() const { return goal_ && !splines_.empty() ? trajectory_time_s_ : 0.0; }

 private:
  /// Constant deceleration of each joint to rest.
  struct Stop {
    JointMotion from;
    Eigen::VectorXd duration_s;
    double elapsed_s = 0.0;
  };

  void start(double now_s);
  JointWaypoint desiredInTrajectoryTime() const;
  void startStop(const JointMotion& from);
  JointMotion sampleStop() const;
  bool isStopping() const { return stop_ && stop_->elapsed_s < stop_->duration_s.maxCoeff(); }
  void finish(GoalOutcome outcome, GoalError error, const std::string& text);
  void abortAndStop(GoalError error, const std::string& text);
  void checkTolerances();
  std::string violatedPath() const;
  std::string violatedGoal() const;

  std::vector<JointLimits> joints_;
  TrajectoryFollowerConfig config_;
  bool has_state_ = false;
  JointMotion desired_;
  JointMotion actual_;
  std::optional<CheckedGoal> goal_;
  bool waits_for_start_ = false;
  std::vector<JointSpline> splines_;  ///< in trajectory time; empty: no trajectory is being followed
  double trajectory_time_s_ = 0.0;
  double speed_scaling_ = 0.0;  ///< of the last update
  std::optional<Stop> stop_;    ///< in real time
  std::vector<GoalResult> results_;
};

}  // namespace simulated_world
