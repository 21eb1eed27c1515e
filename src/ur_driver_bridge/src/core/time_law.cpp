// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/time_law.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "motion_planning/cubic_segment.h"

namespace ur_driver_bridge {
namespace {

using motion_planning::CubicSegment;

constexpr double kMinSpacing_s = 1e-5;   // between points: nearer, accelerations would be those of rounding
constexpr double kSearchStep_s = 0.002;  // of timeOf: the arm does not turn round twice within it
constexpr int kBisections = 26;          // of two search steps: to 1e-10 s
constexpr double kSameDistance_rad = 1e-12;

void requireFinite(const char* name, double value) {
  if (std::isfinite(value)) return;
  throw std::invalid_argument(std::string(name) + " is not finite");
}

void requirePositive(const char* name, double value) {
  if (value > 0.0 && std::isfinite(value)) return;
  std::ostringstream text;
  text << name << " = " << value << " s, must be > 0 s and finite";
  throw std::invalid_argument(text.str());
}

void requireTrajectory(const JointTrajectory& trajectory) {
  if (trajectory.empty()) throw std::invalid_argument("trajectory has 0 points, must have at least 1");
}

/// The trajectory's time s as a function of the new time t, for a while: s = begin + rate t + acceleration t^2 / 2, with t
/// from the start of the piece.
struct LawPiece {
  double begin_s;
  double rate;              // ds/dt at the start
  double acceleration_1_s;  // d2s/dt2
  double duration_s;

  double at(double t) const { return begin_s + t * (rate + 0.5 * acceleration_1_s * t); }
  double rateAt(double t) const { return rate + acceleration_1_s * t; }
  /// Inverse of at() where the rate does not change its sign.
  double timeOf(double s) const {
    const double root = std::sqrt(std::max(rate * rate + 2.0 * acceleration_1_s * (s - begin_s), 0.0));
    return rate + root > 0.0 ? 2.0 * (s - begin_s) / (rate + root) : duration_s;
  }
};

/// Where a law has points, from the start of the piece to its end, both included. The given trajectory's own points are
/// among them, for its acceleration jumps there; at constant rate no others are needed.
std::vector<double> pointTimes(const JointTrajectory& trajectory, const LawPiece& piece, double sample_s) {
  std::vector<double> knots = {0.0};
  const double end_s = piece.at(piece.duration_s);
  for (const TrajectoryPoint& point : trajectory.points) {
    if (!(point.time_s > piece.begin_s && point.time_s < end_s)) continue;
    const double t = piece.timeOf(point.time_s);
    if (t - knots.back() >= kMinSpacing_s && piece.duration_s - t >= kMinSpacing_s) knots.push_back(t);
  }
  knots.push_back(piece.duration_s);
  if (piece.acceleration_1_s == 0.0) return knots;
  std::vector<double> times = {0.0};
  for (std::size_t i = 0; i + 1 < knots.size(); ++i) {
    const double length = knots[i + 1] - knots[i];
    const int parts = std::max(1, static_cast<int>(std::ceil(length / sample_s - 1e-9)));
    for (int k = 1; k < parts; ++k) times.push_back(knots[i] + length * k / parts);
    times.push_back(knots[i + 1]);
  }
  return times;
}

void setAccelerations(JointTrajectory* trajectory) {
  auto& points = trajectory->points;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    points[i].acceleration_rad_s2 = CubicSegment(points[i], points[i + 1]).acceleration_rad_s2;
  }
  points.back().acceleration_rad_s2.setZero();
}

/// The trajectory under a law of pieces that follow each other; at rest at the end.
JointTrajectory follow(const JointTrajectory& trajectory, const std::vector<LawPiece>& pieces, double sample_s) {
  JointTrajectory result;
  double start = 0.0;
  for (const LawPiece& piece : pieces) {
    for (const double t : pointTimes(trajectory, piece, sample_s)) {
      if (!result.empty() && start + t - result.points.back().time_s < 0.5 * kMinSpacing_s)
        continue;  // where they join
      TrajectoryPoint point = trajectory.sample(piece.at(t));
      point.time_s = start + t;
      point.velocity_rad_s *= piece.rateAt(t);
      result.points.push_back(point);
    }
    start += piece.duration_s;
  }
  result.points.back().velocity_rad_s.setZero();
  setAccelerations(&result);
  return result;
}

JointTrajectory standing(const JointTrajectory& trajectory, double at_s) {
  JointTrajectory result;
  result.points.push_back(trajectory.sample(at_s));
  result.points[0].time_s = 0.0;
  result.points[0].velocity_rad_s.setZero();
  result.points[0].acceleration_rad_s2.setZero();
  return result;
}

}  // namespace

JointTrajectory brake(const JointTrajectory& trajectory, double at_s, double duration_s, double sample_s) {
  requireTrajectory(trajectory);
  requireFinite("at_s", at_s);
  requirePositive("duration_s", duration_s);
  requirePositive("sample_s", sample_s);
  const double end_s = trajectory.duration();
  const TrajectoryPoint& first = trajectory.points.front();
  const bool has_begun = at_s > first.time_s || (at_s == first.time_s && !first.velocity_rad_s.isZero(0.0));
  if (!has_begun || at_s >= end_s) return standing(trajectory, at_s);
  LawPiece law{at_s, 1.0, -1.0 / duration_s, duration_s};
  if (law.at(duration_s) > end_s) law.duration_s = law.timeOf(end_s);
  if (law.duration_s < kMinSpacing_s) return standing(trajectory, end_s);
  return follow(trajectory, {law}, sample_s);
}

JointTrajectory resume(const JointTrajectory& trajectory, double at_s, double ramp_s, double sample_s) {
  requireTrajectory(trajectory);
  requireFinite("at_s", at_s);
  requirePositive("ramp_s", ramp_s);
  requirePositive("sample_s", sample_s);
  const double end_s = trajectory.duration();
  const double begin_s = std::max(at_s, trajectory.points.front().time_s);
  if (begin_s >= end_s) return standing(trajectory, end_s);
  LawPiece ramp{begin_s, 0.0, 1.0 / ramp_s, ramp_s};
  const double full_s = begin_s + 0.5 * ramp_s;
  std::vector<LawPiece> pieces;
  if (full_s < end_s - kMinSpacing_s) {
    pieces.push_back(ramp);
    pieces.push_back({full_s, 1.0, 0.0, end_s - full_s});
  } else {
    ramp.duration_s = std::sqrt(2.0 * ramp_s * (end_s - begin_s));
    if (ramp.duration_s < kMinSpacing_s) return standing(trajectory, end_s);
    pieces.push_back(ramp);
  }
  JointTrajectory result = follow(trajectory, pieces, sample_s);
  result.points.back().position_rad = trajectory.points.back().position_rad;
  return result;
}

JointTrajectory upTo(const JointTrajectory& trajectory, double at_s, double ramp_s, double sample_s) {
  requireTrajectory(trajectory);
  requireFinite("at_s", at_s);
  requirePositive("ramp_s", ramp_s);
  requirePositive("sample_s", sample_s);
  const double begin_s = trajectory.points.front().time_s;
  const double stop_s = std::min(at_s, trajectory.duration());
  if (stop_s - begin_s < kMinSpacing_s) return standing(trajectory, std::max(stop_s, begin_s));
  std::vector<LawPiece> pieces;
  const double full_s = std::max(stop_s - begin_s - 0.5 * ramp_s, 0.0);
  if (full_s > kMinSpacing_s) pieces.push_back({begin_s, 1.0, 0.0, full_s});
  const double brake_from_s = pieces.empty() ? begin_s : begin_s + full_s;
  const double brake_s = 2.0 * (stop_s - brake_from_s);
  pieces.push_back({brake_from_s, 1.0, -1.0 / brake_s, brake_s});
  JointTrajectory result = follow(trajectory, pieces, sample_s);
  result.points.back().position_rad = trajectory.sample(stop_s).position_rad;
  return result;
}

JointTrajectory withinAcceleration(const JointTrajectory& trajectory, double limit_rad_s2) {
  requireTrajectory(trajectory);
  requirePositive("limit_rad_s2", limit_rad_s2);
  const auto& points = trajectory.points;
  constexpr double kRest_rad_s = 1e-3;
  const auto rests = [](const TrajectoryPoint& p) { return p.velocity_rad_s.cwiseAbs().maxCoeff() <= kRest_rad_s; };
  if (!rests(points.front()) || !rests(points.back())) {
    throw std::invalid_argument("withinAcceleration: the trajectory does not begin and end at rest");
  }
  double most_rad_s2 = 0.0;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const CubicSegment cubic(points[i], points[i + 1]);
    most_rad_s2 = std::max({most_rad_s2, cubic.acceleration_rad_s2.cwiseAbs().maxCoeff(),
                            cubic.end_acceleration_rad_s2.cwiseAbs().maxCoeff()});
  }
  constexpr double kRounding = 1e-6;  // what is at the limit by computation is not beyond it when looked at
  const double slower = std::sqrt(most_rad_s2 * (1.0 + kRounding) / limit_rad_s2);
  if (slower <= 1.0) return trajectory;
  JointTrajectory result = trajectory;
  const double begin_s = points.front().time_s;
  for (TrajectoryPoint& point : result.points) {
    point.time_s = begin_s + (point.time_s - begin_s) * slower;
    point.velocity_rad_s /= slower;
  }
  setAccelerations(&result);
  return result;
}

JointTrajectory reversed(const JointTrajectory& trajectory) {
  requireTrajectory(trajectory);
  JointTrajectory result;
  const double turn_s = trajectory.points.front().time_s + trajectory.points.back().time_s;
  for (auto point = trajectory.points.rbegin(); point != trajectory.points.rend(); ++point) {
    result.points.push_back(*point);
    result.points.back().time_s = turn_s - point->time_s;
    result.points.back().velocity_rad_s = -point->velocity_rad_s;
  }
  setAccelerations(&result);
  return result;
}

double timeOf(const JointTrajectory& trajectory, const ArmVector& position_rad, double near_s, double window_s) {
  requireTrajectory(trajectory);
  requireFinite("near_s", near_s);
  if (!position_rad.allFinite()) throw std::invalid_argument("position_rad is not finite");
  if (!(window_s >= 0.0) || !std::isfinite(window_s)) {
    std::ostringstream text;
    text << "window_s = " << window_s << " s, must be >= 0 s and finite";
    throw std::invalid_argument(text.str());
  }
  const double first_s = trajectory.points.front().time_s;
  const double last_s = trajectory.points.back().time_s;
  const double near = std::clamp(near_s, first_s, last_s);
  const double low_s = std::clamp(near_s - window_s, first_s, last_s);
  const double high_s = std::clamp(near_s + window_s, first_s, last_s);
  const auto distance = [&](double s) { return (trajectory.sample(s).position_rad - position_rad).norm(); };

  std::vector<double> times;
  const int parts = std::max(1, static_cast<int>(std::ceil((high_s - low_s) / kSearchStep_s)));
  std::vector<double> distances;
  for (int k = 0; k <= parts; ++k) {
    times.push_back(k == parts ? high_s : low_s + (high_s - low_s) * k / parts);
    distances.push_back(distance(times.back()));
  }
  double best_s = near;
  double best_rad = distance(near);
  const auto consider = [&](double s, double gap_rad) {
    const bool is_nearer = gap_rad < best_rad - kSameDistance_rad;
    const bool is_as_near = gap_rad <= best_rad + kSameDistance_rad && std::abs(s - near) < std::abs(best_s - near);
    if (!is_nearer && !is_as_near) return;
    best_s = s;
    best_rad = gap_rad;
  };
  for (std::size_t k = 0; k < times.size(); ++k) {
    consider(times[k], distances[k]);
    const bool falls_to = k == 0 || distances[k] <= distances[k - 1];
    const bool rises_from = k + 1 == times.size() || distances[k] <= distances[k + 1];
    if (!falls_to || !rises_from) continue;
    // Where the distance has its minimum, the way there is at right angles to the motion.
    double low = times[k == 0 ? 0 : k - 1];
    double high = times[std::min(k + 1, times.size() - 1)];
    for (int n = 0; n < kBisections; ++n) {
      const double middle = 0.5 * (low + high);
      const TrajectoryPoint point = trajectory.sample(middle);
      const double slope = (point.position_rad - position_rad).dot(point.velocity_rad_s);
      (slope < 0.0 ? low : high) = middle;
    }
    consider(0.5 * (low + high), distance(0.5 * (low + high)));
  }
  return best_s;
}

}  // namespace ur_driver_bridge
