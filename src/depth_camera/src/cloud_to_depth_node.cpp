// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common_ros/node_main.h>

#include "depth_camera_ros/cloud_to_depth.h"

int main(int argc, char** argv) {
  return interactive_mapping_ros::runNode<depth_camera_ros::CloudToDepth>(argc, argv, "cloud_to_depth", 1);
}
