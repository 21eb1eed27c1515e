// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common_ros/node_main.h>

#include "ur_driver_bridge_ros/ur_driver_bridge_ros.h"

int main(int argc, char** argv) {
  constexpr double kStop_s = 3.0;  // wall time for a controlled stop, and some
  using Node = ur_driver_bridge_ros::UrDriverBridgeRos;
  // Goals, services, diagnostics; control has a thread of its own.
  return interactive_mapping_ros::runNode<Node>(argc, argv, "ur_driver_bridge", 2,
                                                [](Node& node) { node.stop(ros::WallDuration(kStop_s)); });
}
