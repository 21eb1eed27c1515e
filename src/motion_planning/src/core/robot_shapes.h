// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include <Eigen/Geometry>
#include <fcl/geometry/collision_geometry.h>
#include <mp700_ur5e_description/robot_model.h>

namespace motion_planning {

/// Whether a pose is finite and its rotation is one, to what a pose rounded to floats fulfils.
bool isRigid(const Eigen::Isometry3d& T);

/// A ball in the frame of a shape.
struct CoveringSphere {
  Eigen::Vector3d center;
  double radius_m;
};

/// Balls that together hold the whole shape and stand out by a fifth of its thickness or less (a box: a third).
std::vector<CoveringSphere> coverShape(const mp700_ur5e_description::Shape& shape);

/// Points of the shape's middle axis that are as deep within it as any point is, at most half that depth apart.
std::vector<Eigen::Vector3d> corePoints(const mp700_ur5e_description::Shape& shape);

/// Exact distance to the shape's surface from a point in the shape's frame [m], negative inside.
double signedDistance(const mp700_ur5e_description::Shape& shape, const Eigen::Vector3d& p_shape);

/// The shape with all faces moved outwards by `by_m`; it holds every point that is nearer than that.
mp700_ur5e_description::Shape inflate(const mp700_ur5e_description::Shape& shape, double by_m);

/// Half the extents along the axes of the frame in which the shape is turned by `R`.
Eigen::Vector3d halfExtents(const mp700_ur5e_description::Shape& shape, const Eigen::Matrix3d& R);

double boundingRadius(const mp700_ur5e_description::Shape& shape);

std::shared_ptr<const fcl::CollisionGeometryd> toFcl(const mp700_ur5e_description::Shape& shape);

}  // namespace motion_planning
