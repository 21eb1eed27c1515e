// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common_ros/node_main.h>

#include "base_navigation_ros/base_navigation_ros.h"

int main(int argc, char** argv) {
  constexpr double kStop_s = 6.0;  // wall time to brake from full speed (0.8 m/s at 0.2 m/s^2), and some
  using Node = base_navigation_ros::BaseNavigationRos;
  // Goals, services, diagnostics; control has a thread of its own.
  return interactive_mapping_ros::runNode<Node>(argc, argv, "base_navigation", 3,
                                                [](Node& node) { node.stop(ros::WallDuration(kStop_s)); });
}
