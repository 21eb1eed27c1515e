// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "support/urdf_robot.h"

namespace mp700_ur5e_description {

/// A collision shape in the frame base_link.
struct Solid {
  std::string link;
  urdf::GeometrySharedPtr geometry;
  Eigen::Isometry3d T_base_shape;

  Eigen::Vector3d halfExtents() const {
    if (geometry->type == urdf::Geometry::BOX) {
      const urdf::Vector3& size = static_cast<const urdf::Box&>(*geometry).dim;
      return 0.5 * Eigen::Vector3d(size.x, size.y, size.z);
    }
    if (geometry->type == urdf::Geometry::CYLINDER) {
      const auto& cylinder = static_cast<const urdf::Cylinder&>(*geometry);
      return {cylinder.radius, cylinder.radius, 0.5 * cylinder.length};
    }
    return Eigen::Vector3d::Constant(static_cast<const urdf::Sphere&>(*geometry).radius);
  }

  /// Whether a point [m, base_link] is inside, or nearer than `margin_m` for a box or cylinder measured across its faces.
  bool contains(const Eigen::Vector3d& p_base, double margin_m = 0.0) const {
    const Eigen::Vector3d p = T_base_shape.inverse() * p_base;
    const Eigen::Vector3d half = halfExtents().array() + margin_m;
    switch (geometry->type) {
      case urdf::Geometry::BOX:
        return (p.array().abs() <= half.array()).all();
      case urdf::Geometry::CYLINDER:
        return std::hypot(p.x(), p.y()) <= half.x() && std::abs(p.z()) <= half.z();
      default:
        return p.norm() <= half.x();
    }
  }

  /// Points of a grid inside, `step_m` or less apart, ends included [base_link].
  std::vector<Eigen::Vector3d> points(double step_m) const {
    const Eigen::Vector3d half = halfExtents();
    const Eigen::Vector3i count = (2.0 * half / step_m).array().ceil().cast<int>().max(1);
    std::vector<Eigen::Vector3d> result;
    for (int i = 0; i <= count.x(); ++i) {
      for (int j = 0; j <= count.y(); ++j) {
        for (int k = 0; k <= count.z(); ++k) {
          const Eigen::Vector3d share =
              Eigen::Vector3d(i, j, k).cwiseQuotient(count.cast<double>()) * 2.0 - Eigen::Vector3d::Ones();
          const Eigen::Vector3d p_base = T_base_shape * share.cwiseProduct(half);
          if (contains(p_base, 1e-9)) result.push_back(p_base);
        }
      }
    }
    return result;
  }
};

inline std::vector<Solid> solidsOf(const UrdfRobot& robot, const ArmPose& arm) {
  std::vector<Solid> solids;
  for (const auto& [name, link] : robot.urdf().links_) {
    for (const urdf::CollisionSharedPtr& collision : link->collision_array) {
      solids.push_back({name, collision->geometry, robot.linkPose(name, arm) * toEigen(collision->origin)});
    }
  }
  return solids;
}

/// The link that moves with this one: fixed joints followed upwards.
inline std::string rigidRoot(const UrdfRobot& robot, const std::string& link) {
  urdf::LinkConstSharedPtr at = robot.urdf().getLink(link);
  while (at->parent_joint && at->parent_joint->type == urdf::Joint::FIXED) at = at->getParent();
  return at->name;
}

/// Pairs of links that come nearer than `margin_m`, of those that are not rigidly connected and not neighbours at a joint.
/// Dense points of one against the inside of the other: slow and plain.
inline std::set<std::pair<std::string, std::string>> touchingLinks(const UrdfRobot& robot, const ArmPose& arm,
                                                                   double margin_m) {
  const auto rootAbove = [&](const std::string& root) {
    const urdf::LinkConstSharedPtr parent = robot.urdf().getLink(root)->getParent();
    return parent ? rigidRoot(robot, parent->name) : std::string();
  };
  std::set<std::pair<std::string, std::string>> touching;
  const std::vector<Solid> solids = solidsOf(robot, arm);
  for (const Solid& a : solids) {
    const std::vector<Eigen::Vector3d> points = a.points(0.01);
    const std::string root_a = rigidRoot(robot, a.link);
    for (const Solid& b : solids) {
      const std::string root_b = rigidRoot(robot, b.link);
      if (root_a == root_b || root_a == rootAbove(root_b) || root_b == rootAbove(root_a)) continue;
      for (const Eigen::Vector3d& p : points) {
        if (b.contains(p, margin_m)) {
          touching.insert({std::min(a.link, b.link), std::max(a.link, b.link)});
          break;
        }
      }
    }
  }
  return touching;
}

}  // namespace mp700_ur5e_description
