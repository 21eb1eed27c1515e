// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/pose_refinement.h"

#include <cmath>

#include <Eigen/Dense>

#include "rotation.h"

namespace brick_detection {
namespace {

using Vector7d = Eigen::Matrix<double, 7, 1>;
using Matrix7d = Eigen::Matrix<double, 7, 7>;

// Scale of Cauchy's function [standard deviations of a residual vector]. 95 % efficient on one Gaussian residual at 2.4
// (Zhang 1997, table 1); our residuals have two and three components.
constexpr double kCauchyScale = 3.0;
constexpr int kMaxIterations = 60;
constexpr double kSmallestStep = 1e-10;  // [m, rad]: far below any measurement, far above rounding
constexpr double kLeastDepth_m = 1e-3;

/// The weight that goes with robustCost().
double robustWeight(double squared) {
  return 1.0 / (1.0 + squared / (kCauchyScale * kCauchyScale));
}

/// Sums of the normal equations. Unknowns: step of the pose, and the shared offset of the depth image in units of its
/// standard deviation.
struct NormalEquations {
  Matrix7d information{Matrix7d::Zero()};
  Vector7d gradient{Vector7d::Zero()};
  double cost{0.0};

  template <int Rows>
  void add(const Eigen::Matrix<double, Rows, 1>& residual, const Eigen::Matrix<double, Rows, 7>& jacobian) {
    const double squared = residual.squaredNorm();
    const double weight = robustWeight(squared);
    information.noalias() += weight * jacobian.transpose() * jacobian;
    gradient.noalias() += weight * jacobian.transpose() * residual;
    cost += robustCost(squared);
  }
};

bool isInFront(const PoseProblem& problem, const Eigen::Isometry3d& T_camera_body) {
  for (const PointMeasurement& point : problem.points) {
    if (!((T_camera_body * point.p_body).z() > kLeastDepth_m)) return false;
  }
  return true;
}

NormalEquations build(const PoseProblem& problem, const std::vector<Eigen::Matrix3d>& whitenings,
                      const Eigen::Isometry3d& T_camera_body, double shared) {
  NormalEquations sums;
  for (const PointMeasurement& point : problem.points) {
    Eigen::Matrix<double, 2, 6> by_pose;
    const Eigen::Vector2d residual = pointResidual(point, T_camera_body, &by_pose) / point.std_px;
    Eigen::Matrix<double, 2, 7> jacobian = Eigen::Matrix<double, 2, 7>::Zero();
    jacobian.leftCols<6>() = by_pose / point.std_px;
    sums.add<2>(residual, jacobian);
  }
  for (std::size_t i = 0; i < problem.planes.size(); ++i) {
    const PlaneMeasurement& plane = problem.planes[i];
    Eigen::Matrix<double, 3, 6> by_pose;
    Eigen::Vector3d residual = planeResidual(plane, T_camera_body, &by_pose);
    residual.z() -= shared * plane.plane.shared_offset_m;
    Eigen::Matrix<double, 3, 7> jacobian = Eigen::Matrix<double, 3, 7>::Zero();
    jacobian.leftCols<6>() = by_pose;
    jacobian(2, 6) = -plane.plane.shared_offset_m;
    sums.add<3>(whitenings[i] * residual, whitenings[i] * jacobian);
  }
  sums.information(6, 6) += 1.0;  // the shared offset's prior: standard deviation 1
  sums.gradient(6) += shared;
  sums.cost += shared * shared;
  return sums;
}

}  // namespace

double robustCost(double chi2) {
  return kCauchyScale * kCauchyScale * std::log1p(chi2 / (kCauchyScale * kCauchyScale));
}

Eigen::Isometry3d moved(const Eigen::Isometry3d& pose, const Vector6d& step) {
  Eigen::Isometry3d result = pose;
  // By way of a quaternion: a product of matrices drifts from a rotation.
  result.linear() = Eigen::Quaterniond(rotationOf(step.tail<3>()) * pose.linear()).normalized().toRotationMatrix();
  result.translation() += step.head<3>();
  return result;
}

Vector6d stepBetween(const Eigen::Isometry3d& from, const Eigen::Isometry3d& to) {
  Vector6d step;
  step << to.translation() - from.translation(), rotationVector(to.linear() * from.linear().transpose());
  return step;
}

std::optional<PointMeasurement> measurePoint(const Eigen::Vector3d& p_body, const Eigen::Vector2d& pixel,
                                             const CameraModel& camera, double std_px) {
  if (!pixel.allFinite()) return std::nullopt;
  constexpr double kStep_px = 0.5;  // bearings are smooth over a pixel
  Eigen::Matrix2d bearing_per_px;
  for (int axis = 0; axis < 2; ++axis) {
    const Eigen::Vector2d step = kStep_px * Eigen::Vector2d::Unit(axis);
    bearing_per_px.col(axis) = (camera.bearing(pixel + step) - camera.bearing(pixel - step)) / (2.0 * kStep_px);
  }
  PointMeasurement point;
  point.p_body = p_body;
  point.std_px = std_px;
  point.bearing = camera.bearing(pixel);
  // A lens model may fold the image over outside the range that it was fitted to.
  if (!point.bearing.allFinite() || !(bearing_per_px.determinant() > 0.0)) return std::nullopt;
  point.px_per_bearing = bearing_per_px.inverse();
  if (!point.px_per_bearing.allFinite()) return std::nullopt;
  return point;
}

Eigen::Vector2d pointResidual(const PointMeasurement& measurement, const Eigen::Isometry3d& T_camera_body,
                              Eigen::Matrix<double, 2, 6>* jacobian) {
  const Eigen::Vector3d arm = T_camera_body.linear() * measurement.p_body;
  const Eigen::Vector3d p = arm + T_camera_body.translation();
  const double per_z = 1.0 / p.z();
  if (jacobian) {
    Eigen::Matrix<double, 2, 3> by_point;  // of (x/z, y/z)
    by_point << per_z, 0.0, -p.x() * per_z * per_z, 0.0, per_z, -p.y() * per_z * per_z;
    by_point = (measurement.px_per_bearing * by_point).eval();
    jacobian->leftCols<3>() = by_point;
    jacobian->rightCols<3>() = -by_point * skew(arm);  // exp(dr) arm = arm + dr x arm
  }
  return measurement.px_per_bearing * (p.head<2>() * per_z - measurement.bearing);
}

Eigen::Vector3d planeResidual(const PlaneMeasurement& measurement, const Eigen::Isometry3d& T_camera_body,
                              Eigen::Matrix<double, 3, 6>* jacobian) {
  const DepthPlane& plane = measurement.plane;
  const Eigen::Vector3d n = T_camera_body.linear() * measurement.n_body;
  const Eigen::Vector3d arm = T_camera_body.linear() * measurement.p_body;
  const Eigen::Vector3d q = arm + T_camera_body.translation() - plane.middle;
  // The body's plane meets the line middle + offset normal where n . (offset normal - q) = 0.
  const double facing = n.dot(plane.normal);
  const double height = n.dot(q);
  if (jacobian) {
    jacobian->setZero();
    jacobian->block<1, 3>(0, 3) = -n.cross(plane.axis_v).transpose();
    jacobian->block<1, 3>(1, 3) = n.cross(plane.axis_u).transpose();
    jacobian->block<1, 3>(2, 0) = n.transpose() / facing;
    jacobian->block<1, 3>(2, 3) =
        ((n.cross(q) + arm.cross(n)) / facing - height / (facing * facing) * n.cross(plane.normal)).transpose();
  }
  // A turn by a about axis_u takes the normal to normal - a axis_v, about axis_v to normal + a axis_u.
  return {-n.dot(plane.axis_v), n.dot(plane.axis_u), height / facing};
}

// An own Levenberg-Marquardt, called some 20 times a tag: it takes 53 us for four corners, 84 us with a plane. Ceres
// finds the same minima in 270 and 326 us: a problem of this size costs more to set up than to solve. Its TinySolver
// takes 69 and 76 us, but stops above the minimum from 29 of 500 starts: it has no loss functions, and the roots of
// robust costs are far from linear.
std::optional<RefinedPose> refinePose(const PoseProblem& problem, const Eigen::Isometry3d& T_camera_body_start) {
  if (!T_camera_body_start.matrix().allFinite() || !isInFront(problem, T_camera_body_start)) return std::nullopt;
  std::vector<Eigen::Matrix3d> whitenings;
  for (const PlaneMeasurement& measurement : problem.planes) {
    Eigen::Matrix3d own = measurement.plane.covariance;
    own(2, 2) -= measurement.plane.shared_offset_m * measurement.plane.shared_offset_m;
    const Eigen::LLT<Eigen::Matrix3d> factor(own);
    if (factor.info() != Eigen::Success) return std::nullopt;
    whitenings.push_back(factor.matrixL().solve(Eigen::Matrix3d::Identity()));
  }

  Eigen::Isometry3d pose = T_camera_body_start;
  double shared = 0.0;
  NormalEquations sums = build(problem, whitenings, pose, shared);
  double damping = 1e-4;
  for (int i = 0; i < kMaxIterations; ++i) {
    Matrix7d damped = sums.information;
    damped.diagonal() *= 1.0 + damping;
    const Vector7d step = -damped.ldlt().solve(sums.gradient);
    if (!step.allFinite()) return std::nullopt;
    const Eigen::Isometry3d tried = moved(pose, step.head<6>());
    bool is_better = false;
    if (isInFront(problem, tried)) {
      NormalEquations next = build(problem, whitenings, tried, shared + step(6));
      is_better = next.cost <= sums.cost;
      if (is_better) {
        pose = tried;
        shared += step(6);
        sums = std::move(next);
      }
    }
    if (step.norm() < kSmallestStep) break;
    damping = is_better ? std::max(1e-12, damping * 0.1) : damping * 10.0;
    if (damping > 1e12) break;
  }

  // Metres and radians differ by orders of magnitude in information: scale before asking whether it can be inverted.
  const Vector7d scale = sums.information.diagonal().cwiseSqrt();
  if (!(scale.minCoeff() > 0.0) || !scale.allFinite()) return std::nullopt;
  const Matrix7d scaled = scale.cwiseInverse().asDiagonal() * sums.information * scale.cwiseInverse().asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Matrix7d> eigen(scaled);
  if (eigen.info() != Eigen::Success || !(eigen.eigenvalues()(0) > 1e-12)) return std::nullopt;
  const Matrix7d inverse = scale.cwiseInverse().asDiagonal() * eigen.eigenvectors() *
                           eigen.eigenvalues().cwiseInverse().asDiagonal() * eigen.eigenvectors().transpose() *
                           scale.cwiseInverse().asDiagonal();
  RefinedPose refined;
  refined.T_camera_body = pose;
  refined.covariance = 0.5 * (inverse + inverse.transpose()).topLeftCorner<6, 6>();
  refined.cost = sums.cost;
  return refined;
}

}  // namespace brick_detection
