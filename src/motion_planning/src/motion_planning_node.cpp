// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common_ros/node_main.h>

#include "motion_planning_ros/motion_planning_ros.h"

int main(int argc, char** argv) {
  return interactive_mapping_ros::runNode<motion_planning_ros::MotionPlanningRos>(
      argc, argv, "motion_planning", 4);  // joint states, meshes, goals, the monitor
}
