// SPDX-License-Identifier: BSD-3-Clause
#include <exception>

#include <ros/ros.h>

#include "synthetic_depth_ros/synthetic_depth_publisher.h"

int main(int argc, char** argv) {
  ros::init(argc, argv, "synthetic_depth");
  const ros::NodeHandle keep_log;  // with the last handle goes ROS's log, and with that the reason for a failure
  try {
    const synthetic_depth_ros::SyntheticDepthPublisher publisher(
        ros::NodeHandle(), synthetic_depth_ros::loadPublisherParams(ros::NodeHandle("~")));
    ros::spin();
  } catch (const std::exception& error) {
    ROS_FATAL("%s", error.what());
    return 1;
  }
  return 0;
}
