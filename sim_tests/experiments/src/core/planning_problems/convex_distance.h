// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <mp700_ur5e_description/robot_model.h>

namespace experiments {

/// A solid somewhere.
struct Solid {
  mp700_ur5e_description::Shape shape;
  Eigen::Isometry3d T_world_shape{Eigen::Isometry3d::Identity()};
};

/// Radius of the sphere about the shape's middle that holds it.
double boundingRadius(const mp700_ur5e_description::Shape& shape);

/// Point of the solid that is nearest to `p`; `p` itself if it is inside. Closed form.
Eigen::Vector3d nearestPoint(const Solid& solid, const Eigen::Vector3d& p_world);

/// Largest n . p over the points p of the solid, for any vector n.
double support(const Solid& solid, const Eigen::Vector3d& n_world);

/// Distance of two solids, between two bounds that are proven at the end: the distance of a pair of points, one of each,
/// and the gap between two parallel planes that separate the solids.
struct ConvexDistance {
  double lower_m{0.0};  // 0: not shown to be apart
  double upper_m{0.0};
};

/// By alternating projections (Cheney, Goldstein: Proximity maps for convex sets, 1959), which need nothing but
/// nearestPoint, and by the axes of both: no code in common with the collision library that planning uses. Ends when the bounds are within
/// `tolerance_m` of each other, or the solids are shown to be farther apart than `enough_m` or nearer than `touching_m`,
/// or after `max_iterations`.
ConvexDistance convexDistance(const Solid& a, const Solid& b, double tolerance_m = 1e-4, double enough_m = 1e9,
                              double touching_m = 0.0, int max_iterations = 400);

}  // namespace experiments
