// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/base_path.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <interactive_mapping_common/config/range_check.h>

namespace base_navigation {
namespace {

constexpr double kEmpty_m = 1e-4;
constexpr double kEmpty_rad = 1e-4;
constexpr double kSameHeading_rad = 1e-6;  // joined motions bend off so little, under 1 um sideways for each metre

bool isEmpty(const BaseMotion& motion) {
  return std::abs(motion.length_m) < kEmpty_m && std::abs(motion.turn_rad) < kEmpty_rad;
}

/// Turns on the spot are one in any direction: what their sum passes through, they have passed through.
bool areOne(const BaseMotion& a, const BaseMotion& b) {
  if (a.isTurn() || b.isTurn()) return a.isTurn() && b.isTurn();
  if ((a.length_m > 0.0) != (b.length_m > 0.0)) return false;
  // Heading where they meet, against that of the one arc through both ends' headings.
  const double off_rad = (a.turn_rad * b.length_m - b.turn_rad * a.length_m) / (a.length_m + b.length_m);
  return std::abs(off_rad) < kSameHeading_rad;
}

void join(std::vector<BaseMotion>* motions) {
  std::vector<BaseMotion> joined;
  for (const BaseMotion& motion : *motions) {
    if (!joined.empty() && areOne(joined.back(), motion)) {
      joined.back().length_m += motion.length_m;
      joined.back().turn_rad += motion.turn_rad;
    } else {
      joined.push_back(motion);
    }
  }
  *motions = std::move(joined);
}

/// Time over `length_m` from speed `v0` to `v1`, both reachable, at most `v_max`.
double trapezoidTime(double length_m, double v0, double v1, double v_max, double acceleration) {
  const double peak_squared = acceleration * length_m + 0.5 * (v0 * v0 + v1 * v1);
  if (peak_squared <= v_max * v_max) return (2.0 * std::sqrt(peak_squared) - v0 - v1) / acceleration;
  const double ramps_m = (2.0 * v_max * v_max - v0 * v0 - v1 * v1) / (2.0 * acceleration);
  return (2.0 * v_max - v0 - v1) / acceleration + (length_m - ramps_m) / v_max;
}

}  // namespace

std::vector<std::string> MotionLimits::validate() const {
  interactive_mapping::RangeCheck check;
  check("forward_m_s", forward_m_s, 0.01, 10.0, "m/s");
  check("backward_m_s", backward_m_s, 0.01, 10.0, "m/s");
  check("turn_rad_s", turn_rad_s, 0.01, 10.0, "rad/s");
  check("linear_m_s2", linear_m_s2, 0.01, 20.0, "m/s2");
  check("turn_rad_s2", turn_rad_s2, 0.01, 50.0, "rad/s2");
  check("stop_m_s2", stop_m_s2, std::max(0.01, linear_m_s2), 20.0, "m/s2");
  return check.problems();
}

Pose2d BasePath::end() const {
  Pose2d pose_map = start;
  for (const BaseMotion& motion : motions) pose_map = moveAlongArc(pose_map, motion.length_m, motion.turn_rad);
  return pose_map;
}

double BasePath::length() const {
  double length_m = 0.0;
  for (const BaseMotion& motion : motions) length_m += std::abs(motion.length_m);
  return length_m;
}

double BasePath::turn() const {
  double turn_rad = 0.0;
  for (const BaseMotion& motion : motions) turn_rad += std::abs(motion.turn_rad);
  return turn_rad;
}

Pose2d BasePath::pose(std::size_t i, double along) const {
  if (i >= motions.size()) {
    throw std::invalid_argument("motion " + std::to_string(i) + ", the path has " + std::to_string(motions.size()));
  }
  Pose2d pose_map = start;
  for (std::size_t k = 0; k < i; ++k) pose_map = moveAlongArc(pose_map, motions[k].length_m, motions[k].turn_rad);
  return moveAlongArc(pose_map, along * motions[i].length_m, along * motions[i].turn_rad);
}

std::vector<BasePath::Sample> BasePath::sample(double step_m, double radius_m) const {
  if (!(step_m > 0.0) || !std::isfinite(step_m)) {
    throw std::invalid_argument("step = " + std::to_string(step_m) + " m, must be finite and above 0");
  }
  if (!(radius_m >= 0.0) || !std::isfinite(radius_m)) {
    throw std::invalid_argument("radius = " + std::to_string(radius_m) + " m, must be finite and at least 0");
  }
  std::vector<Sample> samples = {{start, 0, 0.0, 0.0}};
  Pose2d begin_map = start;
  double begin_m = 0.0;
  for (std::size_t i = 0; i < motions.size(); ++i) {
    const BaseMotion& motion = motions[i];
    // A point at r moves at v + omega x r: over the motion no farther than |length| + |turn| |r|.
    const double moved_m = std::abs(motion.length_m) + std::abs(motion.turn_rad) * radius_m;
    if (!std::isfinite(moved_m)) throw std::invalid_argument("motion " + std::to_string(i) + " is not finite");
    const auto steps = static_cast<std::size_t>(std::max(1.0, std::ceil(moved_m / step_m)));
    for (std::size_t k = 1; k <= steps; ++k) {
      const double along = static_cast<double>(k) / static_cast<double>(steps);
      samples.push_back({moveAlongArc(begin_map, along * motion.length_m, along * motion.turn_rad), i, along,
                         begin_m + along * std::abs(motion.length_m)});
    }
    begin_map = samples.back().pose;
    begin_m = samples.back().at_m;
  }
  return samples;
}

void BasePath::tidy() {
  // Joined first, since many small motions may be one that is not small; and again, across what was dropped.
  join(&motions);
  motions.erase(std::remove_if(motions.begin(), motions.end(), isEmpty), motions.end());
  join(&motions);
  motions.erase(std::remove_if(motions.begin(), motions.end(), isEmpty), motions.end());
}

std::vector<Stretch> stretches(const BasePath& path) {
  std::vector<Stretch> result;
  for (std::size_t i = 0; i < path.motions.size(); ++i) {
    const BaseMotion& motion = path.motions[i];
    const bool is_forward = motion.length_m >= 0.0;
    const bool goes_on =
        !result.empty() && !motion.isTurn() && !result.back().is_turn && result.back().is_forward == is_forward;
    if (!goes_on) result.push_back({i, i, 0.0, 0.0, motion.isTurn(), is_forward});
    result.back().end = i + 1;
    result.back().length_m += std::abs(motion.length_m);
    result.back().turn_rad += motion.turn_rad;
  }
  return result;
}

double duration(const BasePath& path, const MotionLimits& limits) {
  double time_s = 0.0;
  std::vector<double> v_max;
  std::vector<double> acceleration;
  std::vector<double> v_squared;  // at the joints of a stretch, both ends included
  for (const Stretch& stretch : stretches(path)) {
    if (stretch.is_turn) {
      time_s += trapezoidTime(std::abs(stretch.turn_rad), 0.0, 0.0, limits.turn_rad_s, limits.turn_rad_s2);
      continue;
    }
    const std::size_t n = stretch.end - stretch.begin;
    v_max.assign(n, stretch.is_forward ? limits.forward_m_s : limits.backward_m_s);
    acceleration.assign(n, limits.linear_m_s2);
    v_squared.assign(n + 1, 0.0);
    for (std::size_t i = 0; i < n; ++i) {
      const BaseMotion& motion = path.motions[stretch.begin + i];
      const double curvature = std::abs(motion.turn_rad / motion.length_m);
      if (curvature * v_max[i] > limits.turn_rad_s) v_max[i] = limits.turn_rad_s / curvature;
      if (curvature * acceleration[i] > limits.turn_rad_s2) acceleration[i] = limits.turn_rad_s2 / curvature;
    }
    const auto gained = [&](std::size_t i) {
      return 2.0 * acceleration[i] * std::abs(path.motions[stretch.begin + i].length_m);
    };
    // The fastest speeds at the joints: what the neighbours allow, what can be reached, what can be braked from.
    for (std::size_t i = 1; i < n; ++i) {
      const double v = std::min(v_max[i - 1], v_max[i]);
      v_squared[i] = std::min(v * v, v_squared[i - 1] + gained(i - 1));
    }
    for (std::size_t i = n; i-- > 0;) v_squared[i] = std::min(v_squared[i], v_squared[i + 1] + gained(i));
    for (std::size_t i = 0; i < n; ++i) {
      time_s += trapezoidTime(std::abs(path.motions[stretch.begin + i].length_m), std::sqrt(v_squared[i]),
                              std::sqrt(v_squared[i + 1]), v_max[i], acceleration[i]);
    }
  }
  return time_s;
}

}  // namespace base_navigation
