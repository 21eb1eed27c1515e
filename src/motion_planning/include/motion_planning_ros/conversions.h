// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_msgs/PlanOutcome.h>
#include <interactive_mapping_msgs/SurfaceMesh.h>
#include <trajectory_msgs/JointTrajectory.h>

#include "motion_planning/motion_planner.h"
#include "motion_planning/surface.h"

namespace motion_planning_ros {

using interactive_mapping_ros::toIsometry;
using interactive_mapping_ros::toPose;
using interactive_mapping_ros::withoutSlash;

/// Throws std::invalid_argument if normals and vertices differ in number. Bad triangles are left to the scene builder.
motion_planning::Surface toSurface(const interactive_mapping_msgs::SurfaceMesh& mesh);

/// Joints by their names, header stamp zero: to be executed at once.
trajectory_msgs::JointTrajectory toMessage(const motion_planning::JointTrajectory& trajectory);

/// Joints in any order; other joints beside the arm's are not allowed. Throws std::invalid_argument that says what is
/// wrong: missing joints, sizes, numbers that are not finite, times that do not rise. Velocities may be missing: zero.
motion_planning::JointTrajectory fromMessage(const trajectory_msgs::JointTrajectory& message);

/// Six finite angles. Throws std::invalid_argument; `what` begins the sentence.
motion_planning::ArmVector toArmVector(const std::vector<double>& joints_rad, const std::string& what);

interactive_mapping_msgs::PlanOutcome toMessage(const motion_planning::PlanFailure& failure);

}  // namespace motion_planning_ros
