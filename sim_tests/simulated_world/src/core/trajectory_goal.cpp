// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/trajectory_goal.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

namespace simulated_world {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kPositionRounding_rad = 1e-6;  // of a limit that went through text and back
constexpr double kSpeedRounding = 1e-3;         // relative; times are rounded to ns, a point may be 1 us after another

GoalAnswer refuse(GoalError error, const std::string& text) {
  return {false, error, text};
}

std::string describe(const std::string& joint, std::size_t point, const std::string& quantity, double value,
                     double lower, double upper, const std::string& unit) {
  std::ostringstream text;
  text << "joint " << joint << ", point " << point << ": " << quantity << " = " << value << ' ' << unit
       << ", must be in [" << lower << ", " << upper << "] " << unit;
  return text.str();
}

/// Index in the goal of each joint of the arm; empty and a complaint if the names are not the arm's.
std::vector<std::size_t> orderOf(const std::vector<std::string>& names, const std::vector<JointLimits>& joints,
                                 std::string* complaint) {
  std::vector<std::size_t> order;
  const auto complain = [complaint](const std::string& what) { *complaint += (complaint->empty() ? "" : ", ") + what; };
  for (const JointLimits& joint : joints) {
    const auto found = std::find(names.begin(), names.end(), joint.joint);
    if (found == names.end()) {
      complain("joint " + joint.joint + " is missing");
    } else {
      order.push_back(static_cast<std::size_t>(found - names.begin()));
    }
  }
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (std::find(order.begin(), order.end(), i) == order.end()) {
      complain("joint \"" + names[i] + "\" is unknown or named twice");
    }
  }
  return order;
}

Eigen::VectorXd reorder(const std::vector<double>& values, const std::vector<std::size_t>& order) {
  if (values.empty()) {
    return {};
  }
  Eigen::VectorXd result(static_cast<Eigen::Index>(order.size()));
  for (std::size_t i = 0; i < order.size(); ++i) {
    result[static_cast<Eigen::Index>(i)] = values[order[i]];
  }
  return result;
}

std::string sizeComplaint(const TrajectoryPoint& point, std::size_t joints) {
  const auto wrong = [joints](const std::vector<double>& values, bool required) {
    return values.size() != joints && (required || !values.empty());
  };
  const char* quantity = wrong(point.positions_rad, true)           ? "positions"
                         : wrong(point.velocities_rad_s, false)     ? "velocities"
                         : wrong(point.accelerations_rad_s2, false) ? "accelerations"
                                                                    : nullptr;
  if (quantity == nullptr) {
    return {};
  }
  return "number of " + std::string(quantity) + " must be the number of joints = " + std::to_string(joints);
}

std::string limitComplaint(const JointWaypoint& point, std::size_t index, const std::vector<JointLimits>& joints) {
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const auto row = static_cast<Eigen::Index>(j);
    const JointLimits& limit = joints[j];
    const double q = point.position_rad[row];
    if (!(q >= limit.lower_rad - kPositionRounding_rad && q <= limit.upper_rad + kPositionRounding_rad)) {
      return describe(limit.joint, index, "position", q, limit.lower_rad, limit.upper_rad, "rad");
    }
    if (point.velocity_rad_s.size() > 0 &&
        !(std::abs(point.velocity_rad_s[row]) <= limit.velocity_rad_s * (1.0 + kSpeedRounding))) {
      return describe(limit.joint, index, "velocity", point.velocity_rad_s[row], -limit.velocity_rad_s,
                      limit.velocity_rad_s, "rad/s");
    }
    if (point.acceleration_rad_s2.size() > 0 && !std::isfinite(point.acceleration_rad_s2[row])) {
      return describe(limit.joint, index, "acceleration", point.acceleration_rad_s2[row], -kInfinity, kInfinity,
                      "rad/s^2");
    }
  }
  return {};
}

double resolve(double requested, double preset) {
  if (requested < 0.0) {
    return kInfinity;
  }
  return requested > 0.0 ? requested : preset;
}

bool isNumber(const TrajectoryTolerance& tolerance) {
  return !std::isnan(tolerance.position_rad) && !std::isnan(tolerance.velocity_rad_s) &&
         !std::isnan(tolerance.acceleration_rad_s2);
}

/// Tolerances of names that are not the arm's are ignored, as ros_control does.
std::vector<JointTolerances> resolveTolerances(const TrajectoryGoal& goal, const std::vector<JointLimits>& joints,
                                               const TrajectoryFollowerConfig& config) {
  std::vector<JointTolerances> result;
  for (const JointLimits& joint : joints) {
    JointTolerances tolerances{config.path_tolerance_rad, kInfinity, config.goal_tolerance_rad,
                               config.stopped_velocity_tolerance_rad_s};
    for (const TrajectoryTolerance& request : goal.path_tolerance) {
      if (request.joint == joint.joint) {
        tolerances.path_position_rad = resolve(request.position_rad, tolerances.path_position_rad);
        tolerances.path_velocity_rad_s = resolve(request.velocity_rad_s, tolerances.path_velocity_rad_s);
      }
    }
    for (const TrajectoryTolerance& request : goal.goal_tolerance) {
      if (request.joint == joint.joint) {
        tolerances.goal_position_rad = resolve(request.position_rad, tolerances.goal_position_rad);
        tolerances.goal_velocity_rad_s = resolve(request.velocity_rad_s, tolerances.goal_velocity_rad_s);
      }
    }
    result.push_back(tolerances);
  }
  return result;
}

}  // namespace

std::vector<std::string> TrajectoryFollowerConfig::validate() const {
  std::vector<std::string> problems;
  const auto requirePositive = [&problems](const char* key, double value, const char* unit) {
    if (!(value > 0.0) || !std::isfinite(value)) {
      std::ostringstream line;
      line << key << " = " << value << ' ' << unit << ", must be positive and finite";
      problems.push_back(line.str());
    }
  };
  requirePositive("path_tolerance_rad", path_tolerance_rad, "rad");
  requirePositive("goal_tolerance_rad", goal_tolerance_rad, "rad");
  requirePositive("stopped_velocity_tolerance_rad_s", stopped_velocity_tolerance_rad_s, "rad/s");
  requirePositive("goal_time_s", goal_time_s, "s");
  requirePositive("stop_trajectory_duration_s", stop_trajectory_duration_s, "s");
  return problems;
}

std::string speedComplaint(const Eigen::VectorXd& from_rad, const Eigen::VectorXd& to_rad, double duration_s,
                           const std::vector<JointLimits>& joints) {
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const auto row = static_cast<Eigen::Index>(j);
    const double speed = std::abs(to_rad[row] - from_rad[row]) / duration_s;
    if (!(speed <= joints[j].velocity_rad_s * (1.0 + kSpeedRounding))) {
      std::ostringstream text;
      text << "joint " << joints[j].joint << ": mean speed from " << from_rad[row] << " to " << to_rad[row]
           << " rad within " << duration_s << " s = " << speed << " rad/s, must be in [0, " << joints[j].velocity_rad_s
           << "] rad/s";
      return text.str();
    }
  }
  return {};
}

GoalAnswer checkGoal(const TrajectoryGoal& goal, const std::vector<JointLimits>& joints,
                     const TrajectoryFollowerConfig& config, CheckedGoal* checked) {
  std::string complaint;
  const std::vector<std::size_t> order = orderOf(goal.joint_names, joints, &complaint);
  if (!complaint.empty()) {
    return refuse(GoalError::kInvalidJoints,
                  "Joints on incoming goal don't match the controller joints: " + complaint + ".");
  }
  const auto tolerancesAreNumbers = [](const std::vector<TrajectoryTolerance>& tolerances) {
    return std::all_of(tolerances.begin(), tolerances.end(), isNumber);
  };
  if (!tolerancesAreNumbers(goal.path_tolerance) || !tolerancesAreNumbers(goal.goal_tolerance) ||
      !std::isfinite(goal.goal_time_tolerance_s) || !std::isfinite(goal.start_s)) {
    return refuse(GoalError::kInvalidGoal, "Tolerances and start time must be numbers.");
  }
  CheckedGoal result{goal.id, goal.start_s, {}, resolveTolerances(goal, joints, config), 0.0};
  result.goal_time_s = goal.goal_time_tolerance_s < 0.0    ? 0.0
                       : goal.goal_time_tolerance_s == 0.0 ? config.goal_time_s
                                                           : goal.goal_time_tolerance_s;
  for (std::size_t i = 0; i < goal.points.size(); ++i) {
    const TrajectoryPoint& point = goal.points[i];
    complaint = sizeComplaint(point, joints.size());
    if (!complaint.empty()) {
      return refuse(GoalError::kInvalidGoal, "point " + std::to_string(i) + ": " + complaint);
    }
    const double earliest_s = i == 0 ? 0.0 : goal.points[i - 1].time_from_start_s;
    const double time_s = point.time_from_start_s;
    if (!std::isfinite(time_s) || !(i == 0 ? time_s >= earliest_s : time_s > earliest_s)) {
      std::ostringstream text;
      text << "point " << i << ": time_from_start = " << time_s << " s, must be "
           << (i == 0 ? "at least " : "greater than ") << earliest_s << " s";
      return refuse(GoalError::kInvalidGoal, text.str());
    }
    const JointWaypoint waypoint{time_s, reorder(point.positions_rad, order), reorder(point.velocities_rad_s, order),
                                 reorder(point.accelerations_rad_s2, order)};
    complaint = limitComplaint(waypoint, i, joints);
    if (complaint.empty() && i > 0) {
      complaint = speedComplaint(result.points.back().position_rad, waypoint.position_rad, time_s - earliest_s, joints);
    }
    if (!complaint.empty()) {
      return refuse(GoalError::kInvalidGoal, complaint);
    }
    result.points.push_back(waypoint);
  }
  *checked = std::move(result);
  return {true, GoalError::kSuccessful, {}};
}

}  // namespace simulated_world
