// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include <Eigen/Geometry>
#include <fcl/geometry/collision_geometry.h>
#include <fcl/narrowphase/distance_request.h>
#include <mp700_ur5e_description/robot_model.h>

namespace motion_planning {

/// Whether a pose is finite and its rotation is one, to what a pose rounded to floats fulfils.
bool isRigid(const Eigen::Isometry3d& T);

/// Whether a size is finite and positive along each axis.
bool isBoxSize(const Eigen::Vector3d& size_m);

/// A ball in the frame of a shape.
struct CoveringSphere {
  Eigen::Vector3d center;
  double radius_m;
};

/// Balls that together hold the whole shape: at most 1.2 times as wide as a cylinder, no wider than a box is thin
/// (a plate, longer than 8 times its thickness: a quarter of its length).
std::vector<CoveringSphere> coverShape(const mp700_ur5e_description::Shape& shape);

/// Points as deep within the shape as any point is: its middle axis or plane, in steps of half that depth (at most 33 along
/// an edge).
std::vector<Eigen::Vector3d> corePoints(const mp700_ur5e_description::Shape& shape);

/// Exact distance to the shape's surface from a point in the shape's frame [m], negative inside.
double signedDistance(const mp700_ur5e_description::Shape& shape, const Eigen::Vector3d& p_shape);

/// The shape with all faces moved outwards by `by_m`; it holds every point that is nearer than that.
mp700_ur5e_description::Shape inflate(const mp700_ur5e_description::Shape& shape, double by_m);

/// Half the extents along the axes of the frame in which the shape is turned by `R`.
Eigen::Vector3d halfExtents(const mp700_ur5e_description::Shape& shape, const Eigen::Matrix3d& R);

double boundingRadius(const mp700_ur5e_description::Shape& shape);

std::shared_ptr<const fcl::CollisionGeometryd> toFcl(const mp700_ur5e_description::Shape& shape);

/// For distances that are right to a micrometre. FCL's default stops when a step gains less than a micrometre, and was seen
/// to answer 0.3 mm too much on a cylinder.
fcl::DistanceRequestd exactDistanceRequest();

}  // namespace motion_planning
