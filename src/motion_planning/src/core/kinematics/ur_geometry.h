// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>

#include <Eigen/Geometry>

#include "motion_planning/arm_kinematics.h"

namespace motion_planning {

/// A joint's axis in base_link with all joints at zero.
struct AxisLine {
  Eigen::Vector3d point;
  Eigen::Vector3d direction;  // unit
};

/// The arm as Universal Robots designed it, which has a closed form: axis 2 crosses axis 1 at a right angle, axes 2, 3
/// and 4 are parallel, axis 5 crosses axis 4 and axis 6 axis 5 at right angles. A calibrated arm misses this by
/// millimetres and tenths of a degree; then this is the nearest arm that has it.
///
/// Everything is in frame S: origin where axis 2 crosses axis 1 (the shoulder), z along axis 1, y along axes 2, 3 and 4.
/// With the axes L_i at zero and M = T_S_tip at zero, T_S_tip(q) = e1(q1) ... e6(q6) M, e_i the turn about L_i.
class UrGeometry {
 public:
  /// Joint angles of the branches, any winding; not finite where there is none. A branch has the same place at all goals.
  using Branches = std::array<ArmVector, ArmKinematics::kMaxBranches>;

  /// Throws std::invalid_argument saying which axes are not as they must be.
  UrGeometry(const std::array<AxisLine, 6>& axes, const Eigen::Isometry3d& T_base_tip_at_zero);

  Eigen::Isometry3d tipPose(const ArmVector& joints_rad) const;

  /// Numbers that the border of what is solvable is softened by: a goal that this geometry misses by less counts as on the
  /// border, and branches that meet there are kept apart so that each can be polished to its own solution.
  struct Softness {
    double position_m;
    double rotation_rad;
  };

  /// At a wrist singularity wrist_3 is `wrist_3_rad` or, where the arm is too short for that, the nearest to it.
  void solve(const Eigen::Isometry3d& T_base_tip, double wrist_3_rad, const Softness& softness,
             Branches* branches) const;

 private:
  double toReach(double theta, const Eigen::Vector3d& centre_1) const;

  Eigen::Isometry3d T_S_base_;
  Eigen::Isometry3d T_S_tip_zero_;  // M
  Eigen::Isometry3d T_tip_S_zero_;
  // The upper arm and the forearm in the plane of x and z, angles at zero counted from z towards x: as turns about y do.
  double upper_length_m_;
  double upper_angle_rad_;
  double forearm_length_m_;
  double forearm_angle_rad_;
  double wrist_offset_m_;      // y of the point where axis 5 crosses axis 4
  double wrist_height_m_;      // from there along axis 5 to where axis 6 crosses it
  Eigen::Vector3d axis_5_;     // at zero
  Eigen::Vector3d axis_6_;     // at zero
  Eigen::Vector3d elbow_;      // a point of axis 3
  Eigen::Vector3d wrist_;      // where axis 5 crosses axis 4
  Eigen::Vector3d centre_;     // where axis 6 crosses axis 5
  double wrist_2_offset_rad_;  // see solve()
};

}  // namespace motion_planning
