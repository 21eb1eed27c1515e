// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/trajectory_follower.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

namespace simulated_world {
namespace {

std::string jointsProblem(const JointLimits& joint) {
  std::ostringstream line;
  if (!(joint.lower_rad < joint.upper_rad)) {
    line << "joint " << joint.joint << ": lower = " << joint.lower_rad
         << " rad, must be below upper = " << joint.upper_rad << " rad";
  } else if (!(joint.velocity_rad_s > 0.0)) {
    line << "joint " << joint.joint << ": velocity = " << joint.velocity_rad_s << " rad/s, must be positive";
  }
  return line.str();
}

/// "<joint> <quantity> error = <value> <unit>, must be in [-<tolerance>, <tolerance>] <unit>", empty if it is.
std::string violation(const std::string& joint, const char* quantity, double error, double tolerance,
                      const char* unit) {
  if (std::abs(error) <= tolerance) {
    return {};
  }
  std::ostringstream text;
  text << "joint " << joint << ": " << quantity << " error = " << error << ' ' << unit << ", must be in [-" << tolerance
       << ", " << tolerance << "] " << unit;
  return text.str();
}

}  // namespace

TrajectoryFollower::TrajectoryFollower(std::vector<JointLimits> joints, const TrajectoryFollowerConfig& config)
    : joints_(std::move(joints)), config_(config) {
  std::vector<std::string> problems = config.validate();
  if (joints_.empty()) {
    problems.emplace_back("number of joints = 0, must be at least 1");
  }
  for (const JointLimits& joint : joints_) {
    const std::string problem = jointsProblem(joint);
    if (!problem.empty()) {
      problems.push_back(problem);
    }
  }
  if (!problems.empty()) {
    std::string message = "TrajectoryFollower:";
    for (const std::string& problem : problems) {
      message += "\n  " + problem;
    }
    throw std::invalid_argument(message);
  }
  desired_ = JointMotion::atRest(Eigen::VectorXd::Zero(static_cast<Eigen::Index>(joints_.size())));
  actual_ = desired_;
}

GoalAnswer TrajectoryFollower::acceptGoal(const TrajectoryGoal& goal, double now_s) {
  if (!has_state_) {
    return {false, GoalError::kInvalidGoal, "Can't accept new action goals. Controller is not running."};
  }
  CheckedGoal checked;
  GoalAnswer answer = checkGoal(goal, joints_, config_, &checked);
  if (!answer.accepted) {
    return answer;
  }
  const double start_s = checked.start_s > 0.0 ? checked.start_s : now_s;
  if (!checked.points.empty()) {
    const double end_s = start_s + checked.points.back().time_s;
    if (end_s <= now_s) {
      std::ostringstream text;
      text << "all " << checked.points.size() << " trajectory points are in the past: the last one was due "
           << now_s - end_s << " s ago";
      return {false, GoalError::kOldHeaderTimestamp, text.str()};
    }
    const JointWaypoint& first = checked.points.front();
    const double way_s = start_s + first.time_s - now_s;
    if (way_s > 0.0) {
      const std::string complaint = speedComplaint(desired_.position_rad, first.position_rad, way_s, joints_);
      if (!complaint.empty()) {
        return {false, GoalError::kInvalidGoal, "path to point 0: " + complaint};
      }
    }
  }
  if (goal_) {
    finish(GoalOutcome::kPreempted, GoalError::kSuccessful, "replaced by another goal");
  }
  goal_ = std::move(checked);
  goal_->start_s = start_s;
  waits_for_start_ = start_s > now_s;
  if (waits_for_start_ || goal_->points.empty()) {
    startStop(desired_);
  } else {
    start(now_s);
  }
  return answer;
}

bool TrajectoryFollower::cancelGoal(const std::string& goal_id) {
  if (!goal_ || goal_->id != goal_id) {
    return false;
  }
  finish(GoalOutcome::kCanceled, GoalError::kSuccessful, "canceled");
  startStop(desired_);
  return true;
}

void TrajectoryFollower::halt(const std::string& reason) {
  if (goal_) {
    finish(GoalOutcome::kAborted, GoalError::kInvalidGoal, reason);
  }
  if (!isStopping()) {
    startStop(actual_);
  }
}

void TrajectoryFollower::restart() {
  if (goal_) {
    finish(GoalOutcome::kAborted, GoalError::kInvalidGoal, "controller restarted");
  }
  if (isStopping()) {
    return;
  }
  desired_ = JointMotion::atRest(actual_.position_rad);
  splines_.clear();
  stop_.reset();
}

const JointMotion& TrajectoryFollower::update(double now_s, double dt_s, double speed_scaling,
                                              const Eigen::VectorXd& measured_rad,
                                              const Eigen::VectorXd& measured_rad_s) {
  const auto count = static_cast<Eigen::Index>(joints_.size());
  if (!(dt_s > 0.0) || !(speed_scaling >= 0.0 && speed_scaling <= 1.0)) {
    throw std::invalid_argument("TrajectoryFollower: dt_s = " + std::to_string(dt_s) +
                                " s, must be positive; speed_scaling = " + std::to_string(speed_scaling) +
                                ", must be in [0, 1]");
  }
  if (measured_rad.size() != count || measured_rad_s.size() != count || !measured_rad.allFinite() ||
      !measured_rad_s.allFinite()) {
    throw std::invalid_argument("TrajectoryFollower: measured positions and velocities must be " +
                                std::to_string(count) + " finite numbers each");
  }
  actual_ = {measured_rad, measured_rad_s, Eigen::VectorXd::Zero(count)};
  speed_scaling_ = speed_scaling;
  if (!has_state_) {
    has_state_ = true;
    desired_ = JointMotion::atRest(measured_rad);
  }
  if (waits_for_start_ && now_s >= goal_->start_s) {
    waits_for_start_ = false;
    start(now_s - dt_s);
  }
  if (stop_) {
    stop_->elapsed_s += dt_s;
    desired_ = sampleStop();
    if (goal_ && goal_->points.empty() && !isStopping() && violatedGoal().empty()) {
      finish(GoalOutcome::kSucceeded, GoalError::kSuccessful, "stopped");
    }
  } else if (!splines_.empty()) {
    trajectory_time_s_ += dt_s * speed_scaling;
    const auto next = std::find_if(splines_.begin(), splines_.end() - 1,
                                   [this](const JointSpline& spline) { return trajectory_time_s_ < spline.endTime(); });
    desired_ = next->sample(trajectory_time_s_);
    desired_.velocity_rad_s *= speed_scaling;
    desired_.acceleration_rad_s2 *= speed_scaling * speed_scaling;
    checkTolerances();
  }
  return desired_;
}

std::vector<GoalResult> TrajectoryFollower::takeResults() {
  std::vector<GoalResult> taken;
  taken.swap(results_);
  return taken;
}

JointMotion TrajectoryFollower::error() const {
  return {desired_.position_rad - actual_.position_rad, desired_.velocity_rad_s - actual_.velocity_rad_s,
          desired_.acceleration_rad_s2 - actual_.acceleration_rad_s2};
}

std::optional<std::string> TrajectoryFollower::activeGoal() const {
  return goal_ ? std::optional<std::string>(goal_->id) : std::nullopt;
}

/// From the desired state on through the points that are still to come; trajectory time 0 is the goal's start.
void TrajectoryFollower::start(double now_s) {
  trajectory_time_s_ = std::max(0.0, now_s - goal_->start_s);
  const std::vector<JointWaypoint>& points = goal_->points;
  const auto first = std::find_if(points.begin(), points.end(),
                                  [this](const JointWaypoint& point) { return point.time_s > trajectory_time_s_; });
  if (first == points.end()) {
    abortAndStop(GoalError::kOldHeaderTimestamp, "all trajectory points were due before the start");
    return;
  }
  JointMotion expected = desired_;
  if (first != points.begin()) {
    expected = JointSpline(*(first - 1), *first).sample(trajectory_time_s_);
  }
  for (std::size_t j = 0; j < joints_.size(); ++j) {
    const auto row = static_cast<Eigen::Index>(j);
    const std::string text =
        violation(joints_[j].joint, "position at the start,", expected.position_rad[row] - actual_.position_rad[row],
                  goal_->tolerances[j].path_position_rad, "rad");
    if (!text.empty()) {
      abortAndStop(GoalError::kPathToleranceViolated, text);
      return;
    }
  }
  splines_.clear();
  stop_.reset();
  JointWaypoint previous = desiredInTrajectoryTime();
  for (auto point = first; point != points.end(); ++point) {
    splines_.emplace_back(previous, *point);
    previous = *point;
  }
}

/// With the speed in trajectory time that is the desired one in real time, or as near as the joint's limit allows.
JointWaypoint TrajectoryFollower::desiredInTrajectoryTime() const {
  JointWaypoint point{trajectory_time_s_, desired_.position_rad, desired_.velocity_rad_s, desired_.acceleration_rad_s2};
  for (std::size_t j = 0; j < joints_.size(); ++j) {
    const auto row = static_cast<Eigen::Index>(j);
    const double limit = joints_[j].velocity_rad_s;
    if (std::abs(point.velocity_rad_s[row]) <= speed_scaling_ * limit && speed_scaling_ > 0.0) {
      point.velocity_rad_s[row] /= speed_scaling_;
      point.acceleration_rad_s2[row] /= speed_scaling_ * speed_scaling_;
    } else {
      point.velocity_rad_s[row] = std::copysign(speed_scaling_ > 0.0 ? limit : 0.0, point.velocity_rad_s[row]);
      point.acceleration_rad_s2[row] = 0.0;
    }
  }
  return point;
}

void TrajectoryFollower::startStop(const JointMotion& from) {
  Stop stop{from, Eigen::VectorXd::Zero(from.position_rad.size()), 0.0};
  for (std::size_t j = 0; j < joints_.size(); ++j) {
    const auto row = static_cast<Eigen::Index>(j);
    const double velocity = from.velocity_rad_s[row];
    if (velocity != 0.0) {
      // Rather a harder stop than one beyond the joint's limit: the way of a stop is half velocity times duration.
      const double room = (velocity > 0.0 ? joints_[j].upper_rad : joints_[j].lower_rad) - from.position_rad[row];
      stop.duration_s[row] = std::clamp(2.0 * room / velocity, 0.0, config_.stop_trajectory_duration_s);
    }
  }
  splines_.clear();
  stop_ = std::move(stop);
}

JointMotion TrajectoryFollower::sampleStop() const {
  JointMotion motion = JointMotion::atRest(stop_->from.position_rad);
  for (Eigen::Index j = 0; j < motion.position_rad.size(); ++j) {
    const double T = stop_->duration_s[j];
    if (T == 0.0) {
      continue;
    }
    const double t = std::min(stop_->elapsed_s, T);
    const double velocity = stop_->from.velocity_rad_s[j];
    motion.position_rad[j] += velocity * t * (1.0 - 0.5 * t / T);
    motion.velocity_rad_s[j] = velocity * (1.0 - t / T);
    motion.acceleration_rad_s2[j] = t < T ? -velocity / T : 0.0;
  }
  return motion;
}

void TrajectoryFollower::finish(GoalOutcome outcome, GoalError error, const std::string& text) {
  results_.push_back({goal_->id, outcome, error, text});
  goal_.reset();
  waits_for_start_ = false;
}

void TrajectoryFollower::abortAndStop(GoalError error, const std::string& text) {
  finish(GoalOutcome::kAborted, error, text);
  startStop(desired_);
}

void TrajectoryFollower::checkTolerances() {
  if (!goal_) {
    return;
  }
  const double end_s = splines_.back().endTime();
  if (trajectory_time_s_ < end_s) {
    const std::string text = violatedPath();
    if (!text.empty()) {
      abortAndStop(GoalError::kPathToleranceViolated, text);
    }
    return;
  }
  const std::string text = violatedGoal();
  if (text.empty()) {
    finish(GoalOutcome::kSucceeded, GoalError::kSuccessful, {});
  } else if (trajectory_time_s_ >= end_s + goal_->goal_time_s) {
    std::ostringstream late;
    late << text << ", within goal time = " << goal_->goal_time_s << " s of trajectory time after the end";
    abortAndStop(GoalError::kGoalToleranceViolated, late.str());
  }
}

std::string TrajectoryFollower::violatedPath() const {
  const JointMotion difference = error();
  for (std::size_t j = 0; j < joints_.size(); ++j) {
    const auto row = static_cast<Eigen::Index>(j);
    const JointTolerances& tolerances = goal_->tolerances[j];
    std::string text =
        violation(joints_[j].joint, "path position", difference.position_rad[row], tolerances.path_position_rad, "rad");
    if (text.empty()) {
      text = violation(joints_[j].joint, "path velocity", difference.velocity_rad_s[row],
                       tolerances.path_velocity_rad_s, "rad/s");
    }
    if (!text.empty()) {
      return text;
    }
  }
  return {};
}

std::string TrajectoryFollower::violatedGoal() const {
  const JointMotion difference = error();
  for (std::size_t j = 0; j < joints_.size(); ++j) {
    const auto row = static_cast<Eigen::Index>(j);
    const JointTolerances& tolerances = goal_->tolerances[j];
    std::string text =
        violation(joints_[j].joint, "goal position", difference.position_rad[row], tolerances.goal_position_rad, "rad");
    if (text.empty()) {
      text = violation(joints_[j].joint, "goal velocity", difference.velocity_rad_s[row],
                       tolerances.goal_velocity_rad_s, "rad/s");
    }
    if (!text.empty()) {
      return text;
    }
  }
  return {};
}

}  // namespace simulated_world
