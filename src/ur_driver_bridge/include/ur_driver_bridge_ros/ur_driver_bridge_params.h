// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <ros/node_handle.h>

#include "ur_driver_bridge/executor.h"

namespace ur_driver_bridge_ros {

/// All parameters of the node. SI units.
struct UrDriverBridgeParams {
  std::string base_frame{"base_link"};
  std::string bricks_file;
  double max_payload_kg{5.0};
  double watchdog_rate_hz{50.0};
  double lockstep_wait_s{0.0};
  ur_driver_bridge::ExecutorConfig executor;

  static void fields(UrDriverBridgeParams& c, interactive_mapping::Fields& f) {
    f("base_frame", c.base_frame, "tf2 frame, z up: weights are measured along it");
    f.require(!c.base_frame.empty() && c.base_frame.front() != '/',
              "base_frame = '" + c.base_frame + "', must be a tf2 frame: no leading slash");
    f("bricks_file", c.bricks_file, "absolute path of a bricks.yaml, with the bricks' masses; set by the launch file");
    f.require(!c.bricks_file.empty() && c.bricks_file.front() == '/',
              "bricks_file = '" + c.bricks_file + "', must be the absolute path of a bricks.yaml");
    f("max_payload_kg", c.max_payload_kg, 0.1, 100.0, "kg", "tool and brick together; UR5e");
    f("watchdog_rate_hz", c.watchdog_rate_hz, 10.0, 500.0, "Hz",
      "rate of the checks, in ROS time, while no joint states come");
    f("lockstep_wait_s", c.lockstep_wait_s, 0.0, 60.0, "s",
      "wall time that a step waits for its calls before the clock may go on; 0: it does not wait");
    ur_driver_bridge::ExecutorConfig::fields(c.executor, f);
  }
};

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value.
UrDriverBridgeParams loadUrDriverBridgeParams(const ros::NodeHandle& private_nh);

}  // namespace ur_driver_bridge_ros
