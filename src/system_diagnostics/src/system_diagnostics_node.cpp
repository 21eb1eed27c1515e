// SPDX-License-Identifier: BSD-3-Clause
#include <exception>

#include <ros/ros.h>

#include "system_diagnostics_ros/system_diagnostics_ros.h"

int main(int argc, char** argv) {
  ros::init(argc, argv, "system_diagnostics");
  // Outside the block that may throw: with the last handle goes ROS's log, and with that the reason.
  const ros::NodeHandle nh;
  const ros::NodeHandle private_nh("~");
  try {
    const system_diagnostics_ros::SystemDiagnosticsRos diagnostics(nh, private_nh);
    ros::spin();
    return 0;
  } catch (const std::exception& error) {
    ROS_FATAL("%s", error.what());
    return 1;
  }
}
