// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <vector>

#include <Eigen/Core>
#include <interactive_mapping_common/geometry/pose2d.h>

namespace base_navigation {

using interactive_mapping::Pose2d;
using interactive_mapping::Twist2d;

/// Convex, counter-clockwise.
using Polygon = std::vector<Eigen::Vector2d>;

/// The angle in [-pi, pi].
inline double wrapAngle(double angle_rad) {
  return std::remainder(angle_rad, 2.0 * M_PI);
}

inline bool isFinite(const Pose2d& pose) {
  return std::isfinite(pose.x_m) && std::isfinite(pose.y_m) && std::isfinite(pose.yaw_rad);
}

/// Pose of `b`, given in the frame of `a`, in the frame that `a` is given in.
Pose2d compose(const Pose2d& a, const Pose2d& b);
Pose2d inverse(const Pose2d& pose);
Eigen::Vector2d transform(const Pose2d& pose, const Eigen::Vector2d& point);

/// Where a base comes that drives `length_m` (negative: backwards) and turns by `turn_rad`, both evenly. This is an
/// arc, a straight line or, with length 0, a turn on the spot.
Pose2d moveAlongArc(const Pose2d& pose, double length_m, double turn_rad);

/// The polygon with its edges moved outwards by `padding_m`, corners sharp. Throws std::invalid_argument unless it is
/// convex and counter-clockwise with at least three corners, and the padding is finite and not negative.
Polygon padPolygon(const Polygon& polygon, double padding_m);

/// Of the largest circle about the origin inside the polygon, and of the smallest about the origin around it. The first
/// throws std::invalid_argument if the origin is not inside.
double inscribedRadius(const Polygon& polygon);
double circumscribedRadius(const Polygon& polygon);

}  // namespace base_navigation
