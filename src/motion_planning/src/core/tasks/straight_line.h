// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "tasks/task_context.h"

namespace motion_planning {

constexpr double kLineDeviation_rad = 1e-4;  // rounding of straight lines: 0.1 mm at the arm's full reach

/// Steps of pick/cartesian_step_m on a straight line, at least 1.
std::size_t numSteps(const MotionPlannerConfig& config, double length_m);

/// Postures along a straight line of the tip, all of one branch of the arm. `from`: the posture at `T_base_from`;
/// `offset_base`: from there to the line's end [m]. numSteps() + 1 postures, or fewer: as far as the arm can follow.
JointPath followLine(const TaskContext& task, const ArmVector& from, const Eigen::Isometry3d& T_base_from,
                     const Eigen::Vector3d& offset_base);

/// Directions of straight lines away from where the arm is: up, away from the face that the tool is at, or both.
std::vector<Eigen::Vector3d> directionsOut(const TaskContext& task, const ArmVector& joints_rad);

/// As many directions halfway between up and level, all round.
constexpr std::size_t kSideways = 8;
std::vector<Eigen::Vector3d> upAndAside();

/// A contact on the line, or none. Neighbours share what blocks them, so the far end and the middle come first.
Contact firstContact(const CollisionChecker& checker, const JointPath& line);

JointTrajectory timedLine(const TaskContext& task, const JointPath& line, double speed_m_s);

/// Appends a trajectory that begins where `whole` ends, at rest.
void append(const JointTrajectory& next, JointTrajectory* whole);

}  // namespace motion_planning
