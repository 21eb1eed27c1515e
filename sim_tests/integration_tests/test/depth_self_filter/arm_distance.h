// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <Eigen/Geometry>
#include <mp700_ur5e_description/robot_model.h>

namespace simulated_world {

/// From a point in the shape's frame to its surface [m], negative inside.
inline double distanceToShape(const mp700_ur5e_description::Shape& shape, const Eigen::Vector3d& p) {
  if (const auto* box = std::get_if<mp700_ur5e_description::Box>(&shape)) {
    const Eigen::Vector3d d = p.cwiseAbs() - 0.5 * box->size_m;
    return d.cwiseMax(0.0).norm() + std::min(0.0, d.maxCoeff());
  }
  if (const auto* cylinder = std::get_if<mp700_ur5e_description::Cylinder>(&shape)) {
    const Eigen::Vector2d d(p.head<2>().norm() - cylinder->radius_m, std::abs(p.z()) - 0.5 * cylinder->length_m);
    return d.cwiseMax(0.0).norm() + std::min(0.0, d.maxCoeff());
  }
  return p.norm() - std::get<mp700_ur5e_description::Sphere>(shape).radius_m;
}

/// From a point in the root's frame to the nearest of arm and magnet [m]; they come last among the bodies.
inline double distanceToArm(const mp700_ur5e_description::RobotModel& robot, const Eigen::VectorXd& positions_rad,
                            const Eigen::Vector3d& p_root) {
  std::vector<Eigen::Isometry3d> T_root_body;
  robot.bodyPoses(positions_rad, &T_root_body);
  const std::size_t shoulder = robot.bodyOf("ur5e_shoulder_link");
  double nearest = std::numeric_limits<double>::infinity();
  for (const mp700_ur5e_description::BodyShape& shape : robot.shapes()) {
    if (shape.body < shoulder) continue;  // base and wheels
    nearest = std::min(nearest,
                       distanceToShape(shape.shape, (T_root_body[shape.body] * shape.T_body_shape).inverse() * p_root));
  }
  return nearest;
}

}  // namespace simulated_world
