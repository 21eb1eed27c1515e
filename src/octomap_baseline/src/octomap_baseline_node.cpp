// SPDX-License-Identifier: BSD-3-Clause
#include <exception>

#include <ros/ros.h>

#include "octomap_baseline_ros/octomap_baseline_ros.h"

int main(int argc, char** argv) {
  ros::init(argc, argv, "octomap_baseline");
  // Outside the block that may throw: with the last handle goes ROS's log, and with that the reason.
  const ros::NodeHandle nh;
  const ros::NodeHandle private_nh("~");
  try {
    octomap_baseline_ros::OctomapBaselineRos map(nh, private_nh);
    ros::AsyncSpinner spinner(3);  // image and camera info, services, timer
    spinner.start();
    ros::waitForShutdown();
    return 0;
  } catch (const std::exception& error) {
    ROS_FATAL("%s", error.what());
    return 1;
  }
}
