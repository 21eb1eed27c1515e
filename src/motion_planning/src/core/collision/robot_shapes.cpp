// SPDX-License-Identifier: BSD-3-Clause
#include "collision/robot_shapes.h"

#include <algorithm>
#include <cmath>

#include <fcl/geometry/shape/box.h>
#include <fcl/geometry/shape/cylinder.h>
#include <fcl/geometry/shape/sphere.h>
#include <interactive_mapping_common/geometry/rigid_motion.h>

namespace motion_planning {

using mp700_ur5e_description::Box;
using mp700_ur5e_description::Cylinder;
using mp700_ur5e_description::Shape;
using mp700_ur5e_description::Sphere;

bool isRigid(const Eigen::Isometry3d& T) {
  return interactive_mapping::isRigid(T, 1e-5);  // tighter: these come in doubles
}

bool isBoxSize(const Eigen::Vector3d& size_m) {
  return size_m.allFinite() && size_m.minCoeff() > 0.0;
}

std::vector<CoveringSphere> coverShape(const Shape& shape) {
  std::vector<CoveringSphere> spheres;
  if (const auto* box = std::get_if<Box>(&shape)) {
    // Cells about half as wide as the box is thin; each ball goes through its cell's corners.
    const double cell_m = 0.5 * box->size_m.minCoeff();
    const Eigen::Array3i count = (box->size_m.array() / cell_m - 1e-9).ceil().cast<int>().max(1).min(16);
    const Eigen::Vector3d edge = box->size_m.cwiseQuotient(count.cast<double>().matrix());
    for (int i = 0; i < count[0]; ++i) {
      for (int j = 0; j < count[1]; ++j) {
        for (int k = 0; k < count[2]; ++k) {
          const Eigen::Vector3d center =
              (Eigen::Array3d(i, j, k) + 0.5).matrix().cwiseProduct(edge) - 0.5 * box->size_m;
          spheres.push_back({center, 0.5 * edge.norm()});
        }
      }
    }
  } else if (const auto* cylinder = std::get_if<Cylinder>(&shape)) {
    // Slices of half thickness t lie in balls of radius sqrt(r^2 + t^2) <= 1.2 r for t <= 0.66 r.
    const int count =
        std::max(1, static_cast<int>(std::ceil(cylinder->length_m / (2.0 * 0.66 * cylinder->radius_m) - 1e-9)));
    const double half_slice_m = 0.5 * cylinder->length_m / count;
    for (int i = 0; i < count; ++i) {
      spheres.push_back({{0.0, 0.0, (2 * i + 1) * half_slice_m - 0.5 * cylinder->length_m},
                         std::hypot(cylinder->radius_m, half_slice_m)});
    }
  } else {
    spheres.push_back({Eigen::Vector3d::Zero(), std::get<Sphere>(shape).radius_m});
  }
  return spheres;
}

std::vector<Eigen::Vector3d> corePoints(const Shape& shape) {
  Eigen::Vector3d half = Eigen::Vector3d::Zero();
  if (const auto* box = std::get_if<Box>(&shape)) half = 0.5 * box->size_m;
  if (const auto* cylinder = std::get_if<Cylinder>(&shape)) {
    half << cylinder->radius_m, cylinder->radius_m, 0.5 * cylinder->length_m;
  }
  const double depth_m = half.minCoeff();
  if (depth_m <= 0.0) return {Eigen::Vector3d::Zero()};
  const Eigen::Vector3d reach = half.array() - depth_m;
  const Eigen::Array3i count = (4.0 * reach.array() / depth_m).ceil().cast<int>().min(32);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i <= count[0]; ++i) {
    for (int j = 0; j <= count[1]; ++j) {
      for (int k = 0; k <= count[2]; ++k) {
        const Eigen::Array3d share = Eigen::Array3d(i, j, k) / count.cast<double>().max(1.0);
        const Eigen::Vector3d p = (2.0 * share - (count > 0).cast<double>()).matrix().cwiseProduct(reach);
        if (signedDistance(shape, p) < (1e-9 - 1.0) * depth_m) points.push_back(p);  // of a disc not the corners
      }
    }
  }
  return points;
}

double signedDistance(const Shape& shape, const Eigen::Vector3d& p_shape) {
  if (const auto* box = std::get_if<Box>(&shape)) {
    const Eigen::Vector3d q = p_shape.cwiseAbs() - 0.5 * box->size_m;
    const double beyond = q.maxCoeff();
    return beyond <= 0.0 ? beyond : q.cwiseMax(0.0).norm();
  }
  if (const auto* cylinder = std::get_if<Cylinder>(&shape)) {
    const double across = std::hypot(p_shape.x(), p_shape.y()) - cylinder->radius_m;
    const double along = std::abs(p_shape.z()) - 0.5 * cylinder->length_m;
    if (across <= 0.0 || along <= 0.0) return std::max(across, along);
    return std::hypot(across, along);
  }
  return p_shape.norm() - std::get<Sphere>(shape).radius_m;
}

Shape inflate(const Shape& shape, double by_m) {
  if (const auto* box = std::get_if<Box>(&shape)) return Box{box->size_m.array() + 2.0 * by_m};
  if (const auto* cylinder = std::get_if<Cylinder>(&shape)) {
    return Cylinder{cylinder->radius_m + by_m, cylinder->length_m + 2.0 * by_m};
  }
  return Sphere{std::get<Sphere>(shape).radius_m + by_m};
}

Eigen::Vector3d halfExtents(const Shape& shape, const Eigen::Matrix3d& R) {
  if (const auto* box = std::get_if<Box>(&shape)) return R.cwiseAbs() * (0.5 * box->size_m);
  if (const auto* cylinder = std::get_if<Cylinder>(&shape)) {
    // The axis and a disc square to it, whose reach along an axis is r times the sine of the angle between the two.
    const Eigen::Array3d along = R.col(2).array().abs();
    return 0.5 * cylinder->length_m * along + cylinder->radius_m * (1.0 - along.square()).max(0.0).sqrt();
  }
  return Eigen::Vector3d::Constant(std::get<Sphere>(shape).radius_m);
}

double boundingRadius(const Shape& shape) {
  if (const auto* box = std::get_if<Box>(&shape)) return 0.5 * box->size_m.norm();
  if (const auto* cylinder = std::get_if<Cylinder>(&shape)) {
    return std::hypot(cylinder->radius_m, 0.5 * cylinder->length_m);
  }
  return std::get<Sphere>(shape).radius_m;
}

std::shared_ptr<const fcl::CollisionGeometryd> toFcl(const Shape& shape) {
  std::shared_ptr<fcl::CollisionGeometryd> geometry;
  if (const auto* box = std::get_if<Box>(&shape)) geometry = std::make_shared<fcl::Boxd>(box->size_m);
  if (const auto* cylinder = std::get_if<Cylinder>(&shape)) {
    geometry = std::make_shared<fcl::Cylinderd>(cylinder->radius_m, cylinder->length_m);
  }
  if (const auto* sphere = std::get_if<Sphere>(&shape)) geometry = std::make_shared<fcl::Sphered>(sphere->radius_m);
  geometry->computeLocalAABB();
  return geometry;
}

fcl::DistanceRequestd exactDistanceRequest() {
  fcl::DistanceRequestd request;
  request.distance_tolerance = 1e-9;
  return request;
}

}  // namespace motion_planning
