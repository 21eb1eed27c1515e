// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "ur_driver_bridge/executor.h"

namespace ur_driver_bridge_ros {

/// All parameters of the node, with the only copy of the defaults. SI units.
struct UrDriverBridgeParams {
  std::string base_frame{"base_link"};
  std::string bricks_file;        // absolute path of a bricks.yaml: mass and size of what is picked
  double max_payload_kg{5.0};     // UR5e
  double watchdog_rate_hz{50.0};  // looks so often, in ROS time, when no joint states come
  double lockstep_wait_s{0.0};  // wall time that a step waits for open calls before the clock may go on; 0: not at all

  bool unlocks_by_itself{false};  // recovery: a protective stop without the operator's word; for simulation
  ur_driver_bridge::ExecutorConfig executor;

  /// Every problem as "key = value unit, must be ...".
  std::vector<std::string> validate() const;
};

/// In the layout of config/ur_driver_bridge.yaml.
std::string toYaml(const UrDriverBridgeParams& params);

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value.
UrDriverBridgeParams loadUrDriverBridgeParams(const ros::NodeHandle& private_nh);

}  // namespace ur_driver_bridge_ros
