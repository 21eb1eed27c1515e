// SPDX-License-Identifier: BSD-3-Clause
#include <csignal>
#include <exception>

#include <ros/ros.h>

#include "gpis_mapping_ros/gpis_mapping_ros.h"

int main(int argc, char** argv) {
  ros::init(argc, argv, "gpis_mapping");
  // ros::init sees to SIGINT only; service managers and containers end a program by SIGTERM, and the map is to be saved.
  std::signal(SIGTERM, [](int) { ros::requestShutdown(); });
  // Outside the block that may throw: with the last handle goes ROS's log, and with that the reason.
  const ros::NodeHandle nh;
  const ros::NodeHandle private_nh("~");
  try {
    gpis_mapping_ros::GpisMappingRos map(nh, private_nh);
    ros::AsyncSpinner spinner(4);  // image, camera info, services, timers
    spinner.start();
    ros::waitForShutdown();
    return 0;
  } catch (const std::exception& error) {
    ROS_FATAL("%s", error.what());
    return 1;
  }
}
