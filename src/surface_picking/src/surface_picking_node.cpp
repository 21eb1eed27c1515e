// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common_ros/node_main.h>

#include "surface_picking_ros/surface_picking_ros.h"

int main(int argc, char** argv) {
  return interactive_mapping_ros::runNode<surface_picking_ros::SurfacePickingRos>(
      argc, argv, "surface_picking", 3);  // updates of the map, services, timers
}
