// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>

#include <ros/node_handle.h>

#include "motion_planning/arm_kinematics.h"

namespace motion_planning_ros {

/// The arm of the URDF in the parameter robot_description. Throws std::invalid_argument, with the parameter's full name,
/// if it is not set or is not this robot's.
std::shared_ptr<const motion_planning::ArmKinematics> kinematicsFromServer(const ros::NodeHandle& nh);

}  // namespace motion_planning_ros
