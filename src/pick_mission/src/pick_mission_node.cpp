// SPDX-License-Identifier: BSD-3-Clause
#include <exception>

#include <interactive_mapping_common_ros/node_main.h>
#include <ros/ros.h>

#include "pick_mission_ros/pick_mission_ros.h"

namespace {
constexpr double kStop_s = 3.0;  // wall time for what goes on to end
}  // namespace

int main(int argc, char** argv) {
  // Every thread leaves these to the loop below: what goes on has to end before ROS is shut down.
  interactive_mapping_ros::blockSignals();
  ros::init(argc, argv, "pick_mission", ros::init_options::NoSigintHandler);
  // Outside the block that may throw: with the last handle goes ROS's log, and with that the reason.
  const ros::NodeHandle nh;
  const ros::NodeHandle private_nh("~");
  interactive_mapping_ros::blockShutdown();
  try {
    pick_mission_ros::PickMissionRos mission(nh, private_nh);
    while (ros::ok() && !interactive_mapping_ros::waitForEnd(0.0)) mission.spinOnce();
    mission.stop(ros::WallDuration(kStop_s));
    ros::shutdown();  // before the mission's own end, which waits for calls that this breaks off
    return 0;
  } catch (const std::exception& error) {
    ROS_FATAL("%s", error.what());
    return 1;
  }
}
