// SPDX-License-Identifier: BSD-3-Clause
#include <csignal>
#include <exception>

#include <ros/ros.h>

#include "simulated_world_ros/simulated_world_ros.h"

int main(int argc, char** argv) {
  ros::init(argc, argv, "simulated_world");
  // roscpp ends on SIGINT alone; service managers send SIGTERM, and the judge has a report to write.
  std::signal(SIGTERM, [](int) { ros::requestShutdown(); });
  const ros::NodeHandle keep_log;  // with the last handle goes ROS's log, and with that the reason for a failure
  try {
    const ros::NodeHandle private_nh("~");
    simulated_world_ros::SimulatedWorldRos world(ros::NodeHandle(), private_nh,
                                                 simulated_world_ros::loadSimulationParams(private_nh));
    world.run();
  } catch (const std::exception& error) {
    ROS_FATAL("%s", error.what());
    return 1;
  }
  return 0;
}
