// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/trajectory_check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <sstream>
#include <stdexcept>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_common/formatted.h>

#include "motion_planning/cubic_segment.h"

namespace ur_driver_bridge {
namespace {

using interactive_mapping::formatted;
using motion_planning::CubicSegment;

constexpr double kRest_rad_s = 1e-6;          // slower is at rest: five hours for a degree
constexpr double kPosition_rad = 1e-6;        // beyond a position limit: a thirtieth of the arm's repeatability
constexpr double kTimeRounding_s = 1e-9;      // messages hold times in whole nanoseconds
constexpr double kRoundingStep_rad_s = 2e-3;  // of velocity, the most that is put down to rounding: 3 rad/s over 10 us

/// Times at which a joint's velocity is largest or smallest: the ends, and the vertex if it is between.
std::array<double, 3> velocityExtremes(const CubicSegment& cubic, int joint) {
  const double jerk = cubic.jerk()[joint];
  const double vertex = jerk == 0.0 ? 0.0 : -cubic.acceleration_rad_s2[joint] / jerk;
  return {0.0, cubic.duration_s, std::clamp(std::isfinite(vertex) ? vertex : 0.0, 0.0, cubic.duration_s)};
}

/// Times at which a joint's position is largest or smallest: the ends, and where velocity vanishes between.
std::array<double, 4> positionExtremes(const CubicSegment& cubic, int joint) {
  const double v = cubic.velocity_rad_s[joint];
  const double a = cubic.acceleration_rad_s2[joint];
  const double jerk = cubic.jerk()[joint];
  std::array<double, 4> times = {0.0, cubic.duration_s, 0.0, 0.0};
  // 0.5 j t^2 + a t + v = 0, without cancellation: t = 2 v / -(a + sign(a) root) and its partner.
  const double discriminant = a * a - 2.0 * jerk * v;
  if (!(discriminant >= 0.0)) return times;
  const double sum = a + std::copysign(std::sqrt(discriminant), a);
  if (sum == 0.0) return times;
  const double first = -2.0 * v / sum;
  const double second = jerk == 0.0 ? 0.0 : -sum / jerk;
  if (first > 0.0 && first < cubic.duration_s) times[2] = first;
  if (second > 0.0 && second < cubic.duration_s) times[3] = second;
  return times;
}

/// Acceleration that the rounding of both times may seem to be. Each is wrong by half of kTimeRounding_s; what that does
/// to the mean velocity, six times as much over the duration does to the acceleration at the ends.
double roundingOf(const TrajectoryPoint& a, const TrajectoryPoint& b, int joint) {
  const double h = b.time_s - a.time_s;
  const double mean_rad_s = std::abs(b.position_rad[joint] - a.position_rad[joint]) / h;
  return std::min(6.0 * mean_rad_s * kTimeRounding_s / h, kRoundingStep_rad_s) / h;
}

std::string pointName(const JointTrajectory& trajectory, std::size_t i) {
  std::ostringstream out;
  out << "point " << i << " of " << trajectory.points.size() << " (at " << trajectory.points[i].time_s << " s)";
  return out.str();
}

Verdict badRequest(const std::string& message) {
  return {ArmStatus::kBadRequest, message};
}

/// "elbow_joint: position 3.2, 0.004 s after point 3 of 20 (at 0.5 s), must be in [-3.14, 3.14] rad"
Verdict beyond(const JointTrajectory& trajectory, std::size_t i, double after_s, const std::string& joint,
               const std::string& what, double value, const std::string& allowed) {
  std::ostringstream out;
  out << joint << ": " << what << " " << value;
  if (after_s > 0.0) {
    out << ", " << after_s << " s after ";
  } else {
    out << " at ";
  }
  out << pointName(trajectory, i) << ", must be in " << allowed;
  return {ArmStatus::kBeyondLimits, out.str()};
}

std::string interval(double lower, double upper, const std::string& unit) {
  return "[" + formatted("%g", lower) + ", " + formatted("%g", upper) + "] " + unit;
}

Verdict checkForm(const JointTrajectory& trajectory, const std::vector<std::string>& joints, StartSpeed start) {
  const auto& points = trajectory.points;
  if (points.empty()) return badRequest("the trajectory has 0 points, must have at least 1");
  for (std::size_t i = 0; i < points.size(); ++i) {
    const TrajectoryPoint& point = points[i];
    if (!std::isfinite(point.time_s)) return badRequest("the time of point " + std::to_string(i) + " is not finite");
    for (int joint = 0; joint < 6; ++joint) {
      const char* what = !std::isfinite(point.position_rad[joint])          ? "position"
                         : !std::isfinite(point.velocity_rad_s[joint])      ? "velocity"
                         : !std::isfinite(point.acceleration_rad_s2[joint]) ? "acceleration"
                                                                            : nullptr;
      if (what) return badRequest(joints[joint] + ": " + what + " is not finite at " + pointName(trajectory, i));
    }
  }
  if (points.front().time_s < 0.0) {
    return badRequest("the trajectory begins at " + formatted("%g", points.front().time_s) + " s, must be >= 0 s");
  }
  for (std::size_t i = 1; i < points.size(); ++i) {
    if (points[i].time_s > points[i - 1].time_s) continue;
    return badRequest(pointName(trajectory, i) + " is not later than the one before, at " +
                      formatted("%g", points[i - 1].time_s) + " s");
  }
  const auto moves = [&](std::size_t i, const char* where) -> Verdict {
    int joint = 0;
    const double speed = points[i].velocity_rad_s.cwiseAbs().maxCoeff(&joint);
    if (speed <= kRest_rad_s) return {};
    return badRequest(joints[joint] + ": velocity " + formatted("%g", points[i].velocity_rad_s[joint]) +
                      " rad/s at the " + where + ", must be at rest there");
  };
  if (start == StartSpeed::kAtRest) {
    const Verdict verdict = moves(0, "start");
    if (!verdict.isFine()) return verdict;
  }
  return moves(points.size() - 1, "end");
}

/// Each time is wrong by itself, so that errors do not add up: from any point to any later one the velocity changes by
/// no more than the limit allows and one rounding step. Of the earlier points that one counts from which, at the limit,
/// the least velocity would have been reached by now.
Verdict checkSpeedGained(const JointTrajectory& trajectory, const TrajectoryLimits& limits, double tolerance) {
  const auto& points = trajectory.points;
  for (int joint = 0; joint < 6; ++joint) {
    const double limit_rad_s2 = limits.acceleration_rad_s2[joint];
    for (const double sign : {1.0, -1.0}) {
      const auto beyondLimit = [&](std::size_t i) {
        return sign * points[i].velocity_rad_s[joint] - (1.0 + tolerance) * limit_rad_s2 * points[i].time_s;
      };
      std::size_t from = 0;
      for (std::size_t i = 1; i < points.size(); ++i) {
        if (beyondLimit(i) < beyondLimit(from)) from = i;
        if (beyondLimit(i) - beyondLimit(from) <= kRoundingStep_rad_s) continue;
        const double mean_rad_s2 = (points[i].velocity_rad_s[joint] - points[from].velocity_rad_s[joint]) /
                                   (points[i].time_s - points[from].time_s);
        return beyond(trajectory, i, 0.0, limits.joints[joint],
                      "mean acceleration since point " + std::to_string(from) + ",", mean_rad_s2,
                      interval(-limit_rad_s2, limit_rad_s2, "rad/s^2"));
      }
    }
  }
  return {};
}

}  // namespace

std::vector<std::string> TrajectoryLimits::validate() const {
  std::vector<std::string> problems;
  if (joints.size() != 6) {
    problems.push_back("joints = " + std::to_string(joints.size()) + " names, must be 6");
    return problems;
  }
  interactive_mapping::RangeCheck check;
  for (int i = 0; i < 6; ++i) {
    const std::string of = "[" + joints[i] + "]";
    check(("lower_rad" + of).c_str(), lower_rad[i], -1e3, 1e3, "rad");
    check(("upper_rad" + of).c_str(), upper_rad[i], std::max(-1e3, lower_rad[i]), 1e3, "rad");
    check(("velocity_rad_s" + of).c_str(), velocity_rad_s[i], 1e-3, 100.0, "rad/s");
    check(("acceleration_rad_s2" + of).c_str(), acceleration_rad_s2[i], 1e-2, 1000.0, "rad/s^2");
  }
  return check.problems();
}

Verdict checkTrajectory(const JointTrajectory& trajectory, const TrajectoryLimits& limits, double tolerance,
                        StartSpeed start) {
  std::vector<std::string> problems = limits.validate();
  interactive_mapping::RangeCheck check;
  check("tolerance", tolerance, 0.0, 1.0, "");
  problems.insert(problems.end(), check.problems().begin(), check.problems().end());
  interactive_mapping::refuseIfAny("impossible limits:", problems);

  const Verdict form = checkForm(trajectory, limits.joints, start);
  if (!form.isFine()) return form;
  const auto& points = trajectory.points;

  // Written as "not within" so that a number that overflowed does not pass.
  const auto position = [&](std::size_t i, double after_s, int joint, double value) -> Verdict {
    if (value >= limits.lower_rad[joint] - kPosition_rad && value <= limits.upper_rad[joint] + kPosition_rad) return {};
    return beyond(trajectory, i, after_s, limits.joints[joint], "position", value,
                  interval(limits.lower_rad[joint], limits.upper_rad[joint], "rad"));
  };
  const auto rate = [&](std::size_t i, double after_s, int joint, const char* what, double value, double limit,
                        double allowance, const char* unit) -> Verdict {
    if (std::abs(value) <= (1.0 + tolerance) * limit + allowance) return {};
    return beyond(trajectory, i, after_s, limits.joints[joint], what, value, interval(-limit, limit, unit));
  };
  // The points first: what is wrong with one of them is told as such, and not by what the cubics make of it.
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (int joint = 0; joint < 6; ++joint) {
      // Who cuts a trajectory that came in a message takes accelerations from its cubics.
      const double rounding = i + 1 < points.size() ? roundingOf(points[i], points[i + 1], joint) : 0.0;
      const std::array<Verdict, 3> found = {
          position(i, 0.0, joint, points[i].position_rad[joint]),
          rate(i, 0.0, joint, "velocity", points[i].velocity_rad_s[joint], limits.velocity_rad_s[joint], 0.0, "rad/s"),
          rate(i, 0.0, joint, "acceleration", points[i].acceleration_rad_s2[joint], limits.acceleration_rad_s2[joint],
               rounding, "rad/s^2")};
      for (const Verdict& verdict : found) {
        if (!verdict.isFine()) return verdict;
      }
    }
  }
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const CubicSegment cubic(points[i], points[i + 1]);
    for (int joint = 0; joint < 6; ++joint) {
      for (const double t : positionExtremes(cubic, joint)) {
        Verdict verdict = position(i, t, joint, cubic.positionAt(t)[joint]);
        if (!verdict.isFine()) return verdict;
      }
      for (const double t : velocityExtremes(cubic, joint)) {
        Verdict verdict =
            rate(i, t, joint, "velocity", cubic.velocityAt(t)[joint], limits.velocity_rad_s[joint], 0.0, "rad/s");
        if (!verdict.isFine()) return verdict;
      }
      const double rounding = roundingOf(points[i], points[i + 1], joint);
      for (const double t : {0.0, cubic.duration_s}) {
        Verdict verdict = rate(i, t, joint, "acceleration", cubic.accelerationAt(t)[joint],
                               limits.acceleration_rad_s2[joint], rounding, "rad/s^2");
        if (!verdict.isFine()) return verdict;
      }
    }
  }
  return checkSpeedGained(trajectory, limits, tolerance);
}

Verdict checkStart(const JointTrajectory& trajectory, const ArmVector& arm_rad, const std::vector<std::string>& joints,
                   double tolerance_rad) {
  if (joints.size() != 6) {
    throw std::invalid_argument("joints = " + std::to_string(joints.size()) + " names, must be 6");
  }
  if (!(tolerance_rad >= 0.0) || !std::isfinite(tolerance_rad)) {
    throw std::invalid_argument("tolerance_rad = " + formatted("%g", tolerance_rad) +
                                " rad, must be >= 0 rad and finite");
  }
  if (trajectory.empty()) return badRequest("the trajectory has 0 points, must have at least 1");
  const ArmVector& begin_rad = trajectory.points.front().position_rad;
  int worst = 0;
  double worst_rad = -1.0;
  for (int joint = 0; joint < 6; ++joint) {
    const double gap_rad = std::abs(arm_rad[joint] - begin_rad[joint]);
    if (!std::isfinite(gap_rad)) {
      return {ArmStatus::kStartMismatch, joints[joint] + ": the arm is at " + formatted("%g", arm_rad[joint]) +
                                             " rad, the trajectory begins at " + formatted("%g", begin_rad[joint]) +
                                             " rad"};
    }
    if (gap_rad > worst_rad) {
      worst = joint;
      worst_rad = gap_rad;
    }
  }
  if (worst_rad <= tolerance_rad) return {};
  return {ArmStatus::kStartMismatch, joints[worst] + ": the arm is at " + formatted("%g", arm_rad[worst]) +
                                         " rad, the trajectory begins at " + formatted("%g", begin_rad[worst]) +
                                         " rad: " + formatted("%g", worst_rad) + " rad apart, allowed " +
                                         formatted("%g", tolerance_rad) + " rad"};
}

}  // namespace ur_driver_bridge
