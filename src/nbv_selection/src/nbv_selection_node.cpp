// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common_ros/node_main.h>

#include "nbv_selection_ros/nbv_selection_ros.h"

int main(int argc, char** argv) {
  return interactive_mapping_ros::runNode<nbv_selection_ros::NbvSelectionRos>(argc, argv, "nbv_selection",
                                                                              3);  // goals, services, meshes and grids
}
