// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/joint_spline.h"

#include <algorithm>
#include <stdexcept>
#include <string>

namespace simulated_world {

JointMotion JointMotion::atRest(const Eigen::VectorXd& position_rad) {
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(position_rad.size());
  return {position_rad, zero, zero};
}

JointSpline::JointSpline(const JointWaypoint& start, const JointWaypoint& end)
    : start_s_(start.time_s), end_s_(end.time_s) {
  const Eigen::Index joints = start.position_rad.size();
  const auto fits = [joints](const Eigen::VectorXd& values) { return values.size() == 0 || values.size() == joints; };
  if (!(end_s_ > start_s_)) {
    throw std::invalid_argument("JointSpline: end = " + std::to_string(end_s_) +
                                " s, must be after start = " + std::to_string(start_s_) + " s");
  }
  if (end.position_rad.size() != joints || !fits(start.velocity_rad_s) || !fits(end.velocity_rad_s) ||
      !fits(start.acceleration_rad_s2) || !fits(end.acceleration_rad_s2)) {
    throw std::invalid_argument("JointSpline: all arrays must have " + std::to_string(joints) + " entries");
  }
  coefficients_.setZero(joints, 6);
  const double T = end_s_ - start_s_;
  const Eigen::VectorXd step = end.position_rad - start.position_rad;
  coefficients_.col(0) = start.position_rad;
  if (joints == 0 || start.velocity_rad_s.size() == 0 || end.velocity_rad_s.size() == 0) {
    coefficients_.col(1) = step / T;
    return;
  }
  const Eigen::VectorXd& v0 = start.velocity_rad_s;
  const Eigen::VectorXd& v1 = end.velocity_rad_s;
  coefficients_.col(1) = v0;
  if (start.acceleration_rad_s2.size() == 0 || end.acceleration_rad_s2.size() == 0) {
    coefficients_.col(2) = (3.0 / T * step - 2.0 * v0 - v1) / T;
    coefficients_.col(3) = (-2.0 / T * step + v0 + v1) / (T * T);
    return;
  }
  // Six conditions, position, velocity and acceleration at both ends, fix the six coefficients.
  const Eigen::VectorXd& a0 = start.acceleration_rad_s2;
  const Eigen::VectorXd& a1 = end.acceleration_rad_s2;
  const double T2 = T * T;
  coefficients_.col(2) = 0.5 * a0;
  coefficients_.col(3) = (20.0 * step - T * (12.0 * v0 + 8.0 * v1) + T2 * (a1 - 3.0 * a0)) / (2.0 * T2 * T);
  coefficients_.col(4) = (-30.0 * step + T * (16.0 * v0 + 14.0 * v1) + T2 * (3.0 * a0 - 2.0 * a1)) / (2.0 * T2 * T2);
  coefficients_.col(5) = (12.0 * step - 6.0 * T * (v0 + v1) + T2 * (a1 - a0)) / (2.0 * T2 * T2 * T);
}

JointMotion JointSpline::sample(double time_s) const {
  const double t = std::clamp(time_s, start_s_, end_s_) - start_s_;
  const double t2 = t * t;
  using Powers = Eigen::Matrix<double, 6, 1>;
  const Powers position = (Powers() << 1.0, t, t2, t2 * t, t2 * t2, t2 * t2 * t).finished();
  if (time_s < start_s_ || time_s > end_s_) {
    return JointMotion::atRest(coefficients_ * position);
  }
  const Powers velocity = (Powers() << 0.0, 1.0, 2.0 * t, 3.0 * t2, 4.0 * t2 * t, 5.0 * t2 * t2).finished();
  const Powers acceleration = (Powers() << 0.0, 0.0, 2.0, 6.0 * t, 12.0 * t2, 20.0 * t2 * t).finished();
  return {coefficients_ * position, coefficients_ * velocity, coefficients_ * acceleration};
}

}  // namespace simulated_world
