// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include <interactive_mapping_msgs/AttachedBrick.h>
#include <ros/node_handle.h>

#include "ur_driver_bridge_ros/ur_driver.h"

namespace ur_driver_bridge_ros {

/// What hangs on the magnet, kept where a crash of this node does not reach: in its parameter `attached_brick`, on the
/// parameter server. A new start by roslaunch clears it (clear_params), a respawn does not.
class AttachedMemory {
 public:
  static constexpr char kParam[] = "attached_brick";

  explicit AttachedMemory(const ros::NodeHandle& private_nh) : nh_(private_nh) {}

  /// What was told last to keep; none: that nothing is attached, or nothing that can be read. Asks the master.
  std::optional<interactive_mapping_msgs::AttachedBrick> recall() const;

  /// Does not wait for the master: it may not be reachable.
  void keep(const interactive_mapping_msgs::AttachedBrick& attached);

 private:
  ros::NodeHandle nh_;
  CallThread calls_;
};

}  // namespace ur_driver_bridge_ros
