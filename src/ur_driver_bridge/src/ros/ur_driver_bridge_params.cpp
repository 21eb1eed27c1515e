// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge_ros/ur_driver_bridge_params.h"

#include <interactive_mapping_common_ros/params.h>

#include "ur_driver_bridge_ros/attached_memory.h"

namespace ur_driver_bridge_ros {

UrDriverBridgeParams loadUrDriverBridgeParams(const ros::NodeHandle& private_nh) {
  return interactive_mapping_ros::loadParams<UrDriverBridgeParams>(private_nh, {AttachedMemory::kParam, "gripper/own"});
}

}  // namespace ur_driver_bridge_ros
