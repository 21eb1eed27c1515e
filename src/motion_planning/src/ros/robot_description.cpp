// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning_ros/robot_description.h"

#include <stdexcept>
#include <string>

#include <mp700_ur5e_description/robot_model.h>
#include <ros/console.h>

namespace motion_planning_ros {

using motion_planning::ArmKinematics;

std::shared_ptr<const ArmKinematics> kinematicsFromServer(const ros::NodeHandle& nh) {
  std::string urdf;
  const std::string name = nh.resolveName("robot_description");
  if (!nh.getParam("robot_description", urdf)) {
    throw std::invalid_argument("parameter " + name +
                                " is not set: start description.launch of mp700_ur5e_description");
  }
  const auto arm = std::make_shared<const ArmKinematics>(mp700_ur5e_description::RobotModel::parse(urdf, name));
  if (!arm->isClosedForm()) {
    ROS_WARN(
        "%s: the arm has not the structure of a UR. Its inverse kinematics is numerical, and planning takes longer",
        name.c_str());
  }
  return arm;
}

}  // namespace motion_planning_ros
