// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning_ros/robot_description.h"

#include <stdexcept>
#include <string>

#include <mp700_ur5e_description/robot_model.h>

namespace motion_planning_ros {

using motion_planning::ArmKinematics;

std::shared_ptr<const ArmKinematics> kinematicsFromServer(const ros::NodeHandle& nh) {
  std::string urdf;
  const std::string name = nh.resolveName("robot_description");
  if (!nh.getParam("robot_description", urdf)) {
    throw std::invalid_argument("parameter " + name +
                                " is not set: start description.launch of mp700_ur5e_description");
  }
  return std::make_shared<ArmKinematics>(mp700_ur5e_description::RobotModel::parse(urdf, name));
}

}  // namespace motion_planning_ros
