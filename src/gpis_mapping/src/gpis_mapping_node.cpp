// SPDX-License-Identifier: BSD-3-Clause
#include <exception>

#include <ros/ros.h>

#include "gpis_mapping_ros/gpis_mapping_ros.h"

int main(int argc, char** argv) {
  ros::init(argc, argv, "gpis_mapping");
  try {
    const ros::NodeHandle nh;
    const ros::NodeHandle private_nh("~");
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
