// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common_ros/node_main.h>

#include "brick_detection_ros/brick_detection_ros.h"

int main(int argc, char** argv) {
  return interactive_mapping_ros::runNode<brick_detection_ros::BrickDetectionRos>(
      argc, argv, "brick_detection", 4);  // images, camera info, services, timers
}
