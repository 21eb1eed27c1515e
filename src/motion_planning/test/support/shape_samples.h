// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <random>
#include <vector>

#include <Eigen/Geometry>
#include <mp700_ur5e_description/robot_model.h>

namespace motion_planning {

/// A rotation of any size, each as likely, and a translation within `reach_m`.
inline Eigen::Isometry3d randomPose(std::mt19937& engine, double reach_m) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> offset(-reach_m, reach_m);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::Quaterniond(normal(engine), normal(engine), normal(engine), normal(engine))
                   .normalized()
                   .toRotationMatrix();
  T.translation() << offset(engine), offset(engine), offset(engine);
  return T;
}

/// Points on the surface of a shape, so that no point of the surface is farther than `step_m` from one of them. In the
/// shape's frame; written without the code under test.
inline std::vector<Eigen::Vector3d> surfacePoints(const mp700_ur5e_description::Shape& shape, double step_m) {
  std::vector<Eigen::Vector3d> points;
  const auto steps = [step_m](double length_m) { return std::max(1, static_cast<int>(std::ceil(length_m / step_m))); };
  if (const auto* box = std::get_if<mp700_ur5e_description::Box>(&shape)) {
    for (int axis = 0; axis < 3; ++axis) {
      const int u = (axis + 1) % 3;
      const int v = (axis + 2) % 3;
      for (int i = 0; i <= steps(box->size_m[u]); ++i) {
        for (int j = 0; j <= steps(box->size_m[v]); ++j) {
          for (const double side : {-0.5, 0.5}) {
            Eigen::Vector3d p;
            p[axis] = side * box->size_m[axis];
            p[u] = box->size_m[u] * (static_cast<double>(i) / steps(box->size_m[u]) - 0.5);
            p[v] = box->size_m[v] * (static_cast<double>(j) / steps(box->size_m[v]) - 0.5);
            points.push_back(p);
          }
        }
      }
    }
  } else if (const auto* cylinder = std::get_if<mp700_ur5e_description::Cylinder>(&shape)) {
    const auto ring = [&](double radius_m, double z) {
      const int count = steps(2.0 * M_PI * radius_m);
      for (int i = 0; i < count; ++i) {
        points.emplace_back(radius_m * std::cos(2.0 * M_PI * i / count), radius_m * std::sin(2.0 * M_PI * i / count),
                            z);
      }
    };
    const int layers = steps(cylinder->length_m);
    for (int i = 0; i <= layers; ++i) {
      ring(cylinder->radius_m, cylinder->length_m * (static_cast<double>(i) / layers - 0.5));
    }
    const int rings = steps(cylinder->radius_m);
    for (int i = 0; i < rings; ++i) {
      for (const double side : {-0.5, 0.5}) ring(cylinder->radius_m * i / rings, side * cylinder->length_m);
    }
  } else {
    const double radius_m = std::get<mp700_ur5e_description::Sphere>(shape).radius_m;
    const int rings = steps(M_PI * radius_m);
    for (int i = 0; i <= rings; ++i) {
      const double polar = M_PI * i / rings;
      const int count = steps(2.0 * M_PI * radius_m * std::sin(polar));
      for (int j = 0; j < count; ++j) {
        const double turn = 2.0 * M_PI * j / count;
        points.push_back(radius_m * Eigen::Vector3d(std::sin(polar) * std::cos(turn), std::sin(polar) * std::sin(turn),
                                                    std::cos(polar)));
      }
    }
  }
  return points;
}

}  // namespace motion_planning
