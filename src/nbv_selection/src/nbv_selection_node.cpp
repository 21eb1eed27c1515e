// SPDX-License-Identifier: BSD-3-Clause
#include <csignal>
#include <exception>

#include <ros/ros.h>

#include "nbv_selection_ros/nbv_selection_ros.h"

int main(int argc, char** argv) {
  ros::init(argc, argv, "nbv_selection");
  // ros::init sees to SIGINT only; service managers and containers end a program by SIGTERM.
  std::signal(SIGTERM, [](int) { ros::requestShutdown(); });
  // Outside the block that may throw: with the last handle goes ROS's log, and with that the reason.
  const ros::NodeHandle nh;
  const ros::NodeHandle private_nh("~");
  try {
    nbv_selection_ros::NbvSelectionRos selection(nh, private_nh);
    ros::AsyncSpinner spinner(3);  // goals, services, meshes and grids
    spinner.start();
    ros::waitForShutdown();
    return 0;
  } catch (const std::exception& error) {
    ROS_FATAL("%s", error.what());
    return 1;
  }
}
