// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common_ros/node_main.h>

#include "octomap_baseline_ros/octomap_baseline_ros.h"

int main(int argc, char** argv) {
  return interactive_mapping_ros::runNode<octomap_baseline_ros::OctomapBaselineRos>(
      argc, argv, "octomap_baseline", 3);  // image and camera info, services, timer
}
