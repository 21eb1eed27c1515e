// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>

#include <ros/node_handle.h>

#include "ur_driver_bridge/arm_call.h"
#include "ur_driver_bridge/arm_state.h"

namespace ur_driver_bridge_ros {

/// What holds the bricks. A class of your own derives from this and is exported with pluginlib as in gripper_plugins.xml;
/// the parameter gripper/type names it.
class Gripper {
 public:
  using OnState = std::function<void(const ur_driver_bridge::GripperState&)>;

  virtual ~Gripper() = default;

  /// Called once, before set(). Names of the arm's driver are relative to `nh`, whose queue is to serve all callbacks;
  /// `own_nh` has the parameters of this class. `on_state` takes each report of the gripper: at least every
  /// gripper/io_timeout_s, and after each switch. Throws std::invalid_argument for wrong parameters.
  virtual void start(const ros::NodeHandle& nh, const ros::NodeHandle& own_nh, OnState on_state) = 0;

  /// Asks the driver to grip or to let go, and waits for its answer; the answer's id is not looked at. Called on a thread
  /// of its own.
  virtual ur_driver_bridge::CallReply set(bool is_on) = 0;
};

}  // namespace ur_driver_bridge_ros
