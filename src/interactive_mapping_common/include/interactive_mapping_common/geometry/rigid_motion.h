// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sstream>
#include <stdexcept>
#include <string>

#include <Eigen/Dense>

namespace interactive_mapping {

constexpr double kRigidTolerance = 1e-4;  // products of rotations in floats, with room

/// How far R^T R of the pose's rotation R is from the identity.
inline double rotationDefect(const Eigen::Isometry3d& pose) {
  return (pose.linear().transpose() * pose.linear() - Eigen::Matrix3d::Identity()).norm();
}

/// Whether the pose is finite, and a rotation (no mirror) and a shift.
inline bool isRigid(const Eigen::Isometry3d& pose, double tolerance = kRigidTolerance) {
  return pose.matrix().allFinite() && rotationDefect(pose) < tolerance && pose.linear().determinant() > 0.0 &&
         pose.matrix().row(3) == Eigen::RowVector4d(0.0, 0.0, 0.0, 1.0);
}

/// Throws std::invalid_argument unless `pose`, called `what` there, is rigid.
inline void requireRigid(const Eigen::Isometry3d& pose, const char* what) {
  if (!pose.matrix().allFinite()) throw std::invalid_argument(std::string(what) + " is not finite");
  if (isRigid(pose)) return;
  std::ostringstream text;
  text << what << " is no rigid motion: R^T R deviates from the identity by " << rotationDefect(pose) << ", must be < "
       << kRigidTolerance << ", with determinant +1";
  throw std::invalid_argument(text.str());
}

}  // namespace interactive_mapping
