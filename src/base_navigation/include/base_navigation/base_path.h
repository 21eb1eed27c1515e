// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "base_navigation/planar.h"

namespace base_navigation {

/// Part of a path with one curvature and one direction: an arc, a straight line (turn 0) or a turn on the spot (length 0).
struct BaseMotion {
  double length_m{0.0};  // negative: backwards
  double turn_rad{0.0};  // counter-clockwise positive

  bool isTurn() const { return length_m == 0.0; }
};

/// Speed and acceleration of a differential drive, all positive.
struct MotionLimits {
  double forward_m_s{0.0};
  double backward_m_s{0.0};
  double turn_rad_s{0.0};
  double linear_m_s2{0.0};
  double turn_rad_s2{0.0};
  double stop_m_s2{0.0};  // of a stop on request; turns brake harder by the same factor

  std::vector<std::string> validate() const;
};

/// What a differential drive can follow exactly: motions one after the other, in the map frame. Two motions join without a
/// stop only if neither is a turn on the spot and both go the same way.
struct BasePath {
  Pose2d start;
  std::vector<BaseMotion> motions;

  Pose2d end() const;
  double length() const;  // [m], of all motions whatever their direction
  double turn() const;    // [rad], likewise, curves included

  /// The pose `along` (0 .. 1) of motion `i`. Throws std::invalid_argument if there is no such motion.
  Pose2d pose(std::size_t i, double along) const;

  struct Sample {
    Pose2d pose;
    std::size_t motion;
    double along;  // 0 .. 1 of that motion
    double at_m;   // along the path
  };
  /// Start, joints, end and poses between, so that no point within `radius_m` of base_link moves farther than `step_m`
  /// from one to the next. Throws std::invalid_argument for an impossible step or radius, or a motion that is not finite.
  std::vector<Sample> sample(double step_m, double radius_m) const;

  /// Joins motions that are one (equal curvature and direction; neighbouring turns on the spot), drops empty ones (under
  /// 0.1 mm and 0.1 mrad).
  void tidy();
};

/// Pieces of a path between which the base stands: [begin, end) of motions.
struct Stretch {
  std::size_t begin;
  std::size_t end;
  double length_m;  // unsigned; turn on the spot: 0
  double turn_rad;  // signed; of a turn on the spot
  bool is_turn;
  bool is_forward;
};
std::vector<Stretch> stretches(const BasePath& path);

/// Shortest time [s] that the path takes within the (valid) limits, standing at both ends, at direction changes and
/// about turns on the spot. Curves are driven at the speed at which they turn at most at turn_rad_s, accelerating so
/// that turn_rad_s2 holds. Changes of curvature between them cost nothing.
double duration(const BasePath& path, const MotionLimits& limits);

}  // namespace base_navigation
