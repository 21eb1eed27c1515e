// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common_ros/node_main.h>

#include "depth_self_filter_ros/depth_self_filter_ros.h"

int main(int argc, char** argv) {
  return interactive_mapping_ros::runNode<depth_self_filter_ros::DepthSelfFilterRos>(argc, argv, "depth_self_filter",
                                                                                     3);  // images, joint states, tf
}
