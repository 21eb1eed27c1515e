// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <control_msgs/FollowJointTrajectoryGoal.h>
#include <control_msgs/JointTrajectoryControllerState.h>
#include <ros/time.h>
#include <sensor_msgs/JointState.h>
#include <ur_msgs/IOStates.h>

#include "simulated_world/ur_controller.h"

namespace simulated_world_ros {

/// What the arm's sensors say; arrays in the order of the controller's joints.
struct ArmMeasurement {
  Eigen::VectorXd position_rad;
  Eigen::VectorXd velocity_rad_s;
  Eigen::VectorXd current_A;  ///< the driver's effort is the motors' current
  Eigen::Vector3d force_tool_N = Eigen::Vector3d::Zero();
  Eigen::Vector3d torque_tool_Nm = Eigen::Vector3d::Zero();
};

simulated_world::TrajectoryGoal fromMessage(const std::string& id, const control_msgs::FollowJointTrajectoryGoal& goal);
simulated_world::TrajectoryGoal fromMessage(const std::string& id, const trajectory_msgs::JointTrajectory& trajectory);

/// Joints in alphabetical order, as ros_control publishes them.
sensor_msgs::JointState toMessage(const ros::Time& stamp, const std::vector<simulated_world::JointLimits>& joints,
                                  const ArmMeasurement& measured);

ur_msgs::IOStates toMessage(const simulated_world::UrIo& io);

/// Joints in the controller's order.
control_msgs::JointTrajectoryControllerState toMessage(const ros::Time& stamp,
                                                       const simulated_world::TrajectoryFollower& follower);

}  // namespace simulated_world_ros
