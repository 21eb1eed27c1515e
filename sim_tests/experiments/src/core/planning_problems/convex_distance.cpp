// SPDX-License-Identifier: BSD-3-Clause
#include "planning_problems/convex_distance.h"

#include <algorithm>
#include <cmath>

namespace experiments {
namespace {

using mp700_ur5e_description::Box;
using mp700_ur5e_description::Cylinder;
using mp700_ur5e_description::Sphere;

// In the shape's own frame.
struct Nearest {
  Eigen::Vector3d p;
  Eigen::Vector3d operator()(const Box& box) const { return p.cwiseMax(-0.5 * box.size_m).cwiseMin(0.5 * box.size_m); }
  Eigen::Vector3d operator()(const Cylinder& cylinder) const {
    Eigen::Vector3d q = p;
    const double radius = p.head<2>().norm();
    if (radius > cylinder.radius_m) q.head<2>() *= cylinder.radius_m / radius;
    q.z() = std::clamp(p.z(), -0.5 * cylinder.length_m, 0.5 * cylinder.length_m);
    return q;
  }
  Eigen::Vector3d operator()(const Sphere& sphere) const {
    return p.norm() > sphere.radius_m ? Eigen::Vector3d(p * (sphere.radius_m / p.norm())) : p;
  }
};

struct Support {
  Eigen::Vector3d n;
  double operator()(const Box& box) const { return 0.5 * n.cwiseAbs().dot(box.size_m); }
  double operator()(const Cylinder& cylinder) const {
    return cylinder.radius_m * n.head<2>().norm() + 0.5 * cylinder.length_m * std::abs(n.z());
  }
  double operator()(const Sphere& sphere) const { return sphere.radius_m * n.norm(); }
};

struct Radius {
  double operator()(const Box& box) const { return 0.5 * box.size_m.norm(); }
  double operator()(const Cylinder& cylinder) const { return std::hypot(cylinder.radius_m, 0.5 * cylinder.length_m); }
  double operator()(const Sphere& sphere) const { return sphere.radius_m; }
};

}  // namespace

double boundingRadius(const mp700_ur5e_description::Shape& shape) {
  return std::visit(Radius{}, shape);
}

Eigen::Vector3d nearestPoint(const Solid& solid, const Eigen::Vector3d& p_world) {
  const Eigen::Vector3d p = solid.T_world_shape.linear().transpose() * (p_world - solid.T_world_shape.translation());
  return solid.T_world_shape * std::visit(Nearest{p}, solid.shape);
}

double support(const Solid& solid, const Eigen::Vector3d& n_world) {
  return n_world.dot(solid.T_world_shape.translation()) +
         std::visit(Support{solid.T_world_shape.linear().transpose() * n_world}, solid.shape);
}

ConvexDistance convexDistance(const Solid& a, const Solid& b, double tolerance_m, double enough_m, double touching_m,
                              int max_iterations) {
  ConvexDistance result;
  // Any direction proves a distance: the gap between the planes across it that touch the solids.
  const auto separate = [&](const Eigen::Vector3d& way) {
    const double length_m = way.norm();
    if (length_m < 1e-12) return;
    const Eigen::Vector3d n = way / length_m;  // from a to b
    result.lower_m = std::max(result.lower_m, -support(b, -n) - support(a, n));
  };
  // Between faces that are nearly parallel the projections creep; there the normal of one of them separates at once.
  for (const Solid* solid : {&a, &b}) {
    for (int axis = 0; axis < 3; ++axis) {
      separate(solid->T_world_shape.linear().col(axis));
      separate(-solid->T_world_shape.linear().col(axis));
    }
  }
  if (result.lower_m > enough_m) {
    result.upper_m = 1e9;
    return result;
  }
  Eigen::Vector3d on_a = nearestPoint(a, b.T_world_shape.translation());
  result.upper_m = 1e9;
  for (int i = 0; i < max_iterations; ++i) {
    const Eigen::Vector3d on_b = nearestPoint(b, on_a);
    on_a = nearestPoint(a, on_b);
    const Eigen::Vector3d way = on_b - on_a;
    const double length_m = way.norm();
    result.upper_m = std::min(result.upper_m, length_m);
    if (length_m > 1e-12) {
      separate(way);
      // Along edges that are nearly parallel the projections creep; what is square to such an edge separates at once.
      for (const Solid* solid : {&a, &b}) {
        for (int axis = 0; axis < 3; ++axis) {
          const Eigen::Vector3d edge = solid->T_world_shape.linear().col(axis);
          separate(way - edge * edge.dot(way));
        }
      }
    }
    if (result.upper_m - result.lower_m < tolerance_m || result.lower_m > enough_m || result.upper_m < touching_m)
      break;
  }
  return result;
}

}  // namespace experiments
