// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

#include <Eigen/Geometry>

namespace brick_detection {

constexpr double kToDeg = 180.0 / M_PI;
// Turns of a body that differ by less are the same solution.
constexpr double kSameTurn_rad = 1e-4;

/// Of the vectors in space the third component.
inline double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

/// skew(a) b = a x b.
inline Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  return (Eigen::Matrix3d() << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0).finished();
}

/// Log R, at most pi long. By atan2: AngleAxis loses small angles to rounding.
inline Eigen::Vector3d rotationVector(const Eigen::Matrix3d& R) {
  Eigen::Quaterniond turn(R);
  if (turn.w() < 0.0) turn.coeffs() *= -1.0;
  const double sine = turn.vec().norm();
  // Near zero 2 atan2(s, c) / s is 2 to all digits.
  return (sine > 1e-12 ? 2.0 * std::atan2(sine, turn.w()) / sine : 2.0) * turn.vec();
}

/// exp r.
inline Eigen::Matrix3d rotationOf(const Eigen::Vector3d& r) {
  const double angle = r.norm();
  if (!(angle > 0.0)) return Eigen::Matrix3d::Identity();
  return Eigen::AngleAxisd(angle, r / angle).toRotationMatrix();
}

}  // namespace brick_detection
