// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <optional>
#include <vector>

#include <Eigen/Geometry>

#include "brick_detection/camera_model.h"
#include "brick_detection/depth_plane.h"

namespace brick_detection {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

/// The pose moved by a small step (translation [m], rotation [rad]) along the axes of its target frame:
/// t + dt, exp(dr) R.
Eigen::Isometry3d moved(const Eigen::Isometry3d& pose, const Vector6d& step);

/// The step that takes `from` to `to`: moved(from, stepBetween(from, to)) is `to`.
Vector6d stepBetween(const Eigen::Isometry3d& from, const Eigen::Isometry3d& to);

/// Where a known point of the body was seen.
struct PointMeasurement {
  Eigen::Vector3d p_body{Eigen::Vector3d::Zero()};
  Eigen::Vector2d bearing{Eigen::Vector2d::Zero()};
  /// Of a difference of bearings, to pixels: the inverse of how the bearing changes with the pixel, distortion included.
  Eigen::Matrix2d px_per_bearing{Eigen::Matrix2d::Identity()};
  double std_px{0.25};  ///< of each coordinate
};

/// Nothing where the lens model gives no finite bearing.
std::optional<PointMeasurement> measurePoint(const Eigen::Vector3d& p_body, const Eigen::Vector2d& pixel,
                                             const CameraModel& camera, double std_px = 0.25);

/// A known plane of the body, and what the depth image has of it.
struct PlaneMeasurement {
  Eigen::Vector3d p_body{Eigen::Vector3d::Zero()};  ///< a point of it
  Eigen::Vector3d n_body{Eigen::Vector3d::UnitZ()};
  DepthPlane plane;
};

/// The plane of the body against the measured one, in the order of DepthPlane's covariance. Tilt about axis_u and
/// axis_v [rad] and offset of the middle along the normal [m]. `jacobian`: by a step of the pose, may be null.
Eigen::Vector3d planeResidual(const PlaneMeasurement& measurement, const Eigen::Isometry3d& T_camera_body,
                              Eigen::Matrix<double, 3, 6>* jacobian = nullptr);

/// Where the body must be seen, minus where it was [px]. `jacobian`: by a step of the pose, may be null.
Eigen::Vector2d pointResidual(const PointMeasurement& measurement, const Eigen::Isometry3d& T_camera_body,
                              Eigen::Matrix<double, 2, 6>* jacobian = nullptr);

/// All that one image says about the pose of one body.
struct PoseProblem {
  std::vector<PointMeasurement> points;
  std::vector<PlaneMeasurement> planes;
};

/// What one residual's chi-square counts for in the cost: less and less, after Cauchy's function.
double robustCost(double chi2);

struct RefinedPose {
  Eigen::Isometry3d T_camera_body{Eigen::Isometry3d::Identity()};
  Matrix6d covariance{Matrix6d::Identity()};  ///< as BrickSighting's
  double cost{0.0};  ///< chi-square in which large residuals count less; compares poses of one problem
};

/// The nearest minimum of that cost: Levenberg-Marquardt with analytic Jacobians. Residuals weigh as Cauchy's function
/// has it, so that one bad point or plane among good ones has next to no pull. The depth image's systematic offset is one
/// unknown that all planes share. Covariance from the information at the minimum. Nothing if the start or the minimum
/// has a point behind the camera, or the measurements do not determine the pose.
std::optional<RefinedPose> refinePose(const PoseProblem& problem, const Eigen::Isometry3d& T_camera_body_start);

}  // namespace brick_detection
