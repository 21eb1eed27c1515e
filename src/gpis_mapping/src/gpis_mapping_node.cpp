// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common_ros/node_main.h>

#include "gpis_mapping_ros/gpis_mapping_ros.h"

int main(int argc, char** argv) {
  return interactive_mapping_ros::runNode<gpis_mapping_ros::GpisMappingRos>(argc, argv, "gpis_mapping",
                                                                            4);  // image, camera info, services, timers
}
