// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

namespace simulated_world {

/// Where joints are and how they move; one entry per joint, in SI units.
struct JointMotion {
  Eigen::VectorXd position_rad;
  Eigen::VectorXd velocity_rad_s;
  Eigen::VectorXd acceleration_rad_s2;

  static JointMotion atRest(const Eigen::VectorXd& position_rad);
};

/// A point that joints pass. Velocity and acceleration may be empty: not given.
struct JointWaypoint {
  double time_s = 0.0;
  Eigen::VectorXd position_rad;
  Eigen::VectorXd velocity_rad_s;
  Eigen::VectorXd acceleration_rad_s2;
};

/// The motion between two waypoints, as the joint trajectory controller interpolates: a quintic where both points give
/// acceleration and velocity, a cubic where both give velocity, else a straight line.
class JointSpline {
 public:
  /// Throws std::invalid_argument unless `end` is later than `start` and all sizes agree.
  JointSpline(const JointWaypoint& start, const JointWaypoint& end);

  /// Before the start and after the end: at rest at that end.
  JointMotion sample(double time_s) const;

  double endTime() const { return end_s_; }

 private:
  double start_s_;
  double end_s_;
  Eigen::Matrix<double, Eigen::Dynamic, 6> coefficients_;  ///< row: joint, column: power of (time - start)
};

}  // namespace simulated_world
