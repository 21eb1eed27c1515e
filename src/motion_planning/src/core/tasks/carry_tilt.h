// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "tasks/task_context.h"

namespace motion_planning {

constexpr double kTiltReserve_rad = 0.02;  // kept while planning, for the motion between checked states

/// While the magnet holds a brick: the direction that pointed up when it was taken stays within this of up.
struct TiltConstraint {
  Eigen::Vector3d up_tip{Eigen::Vector3d::UnitZ()};  // unit, in the tip's frame
  double max_tilt_rad{0.0};
};
using Tilt = std::optional<TiltConstraint>;  // none: any tilt is allowed

double tiltOf(const ArmKinematics& arm, const TiltConstraint& tilt, const ArmVector& joints_rad);

/// Direction of the brick's edge that is nearest to `up_tip`; all unit, in the tip's frame.
Eigen::Vector3d uprightEdge(const HeldBrick& held, const Eigen::Vector3d& up_tip);

/// The constraint on carrying the held brick. Fails if it is tilted by more at the start.
Result<Tilt> tiltOfHeld(const TaskContext& task, bool keep_level);

/// Draws postures that keep the constraint. Most of them keep the angle that the tool has in one of the references (start
/// and goals). Joints 2, 3 and 4 turn about parallel axes, joint 1 about an upright one: all postures with the same sum of
/// the three and the same joint 5 have that angle, and so has every straight line between two of them. Trees grow along
/// these lines without being cut by the constraint. The other samples draw a tip in the arm's reach with any allowed tilt,
/// and a random branch for it. The arm outlives the sampler.
std::function<ArmVector(const std::function<double()>& uniform01)> tiltSampler(const ArmKinematics& arm,
                                                                               const TiltConstraint& tilt,
                                                                               std::vector<ArmVector> references);

/// Shortest rotation that turns unit vector `from` into `to`.
Eigen::Matrix3d turning(const Eigen::Vector3d& from, const Eigen::Vector3d& to);
Eigen::Matrix3d aboutZ(double angle_rad);

}  // namespace motion_planning
