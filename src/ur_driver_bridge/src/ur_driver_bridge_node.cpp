// SPDX-License-Identifier: BSD-3-Clause
#include <pthread.h>

#include <csignal>
#include <ctime>
#include <exception>

#include <ros/ros.h>

#include "ur_driver_bridge_ros/ur_driver_bridge_ros.h"

namespace {
constexpr double kStop_s = 3.0;  // wall time for a controlled stop, and some
}

int main(int argc, char** argv) {
  // Every thread leaves these to the loop below: ROS must not be shut down before the arm stands.
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  ros::init(argc, argv, "ur_driver_bridge", ros::init_options::NoSigintHandler);
  // Outside the block that may throw: with the last handle goes ROS's log, and with that the reason.
  const ros::NodeHandle nh;
  const ros::NodeHandle private_nh("~");
  try {
    ur_driver_bridge_ros::UrDriverBridgeRos bridge(nh, private_nh);
    ros::AsyncSpinner spinner(2);  // goals, services, diagnostics; control has a thread of its own
    spinner.start();
    const timespec period{0, 100000000};  // how soon a shutdown by the master is noticed
    while (ros::ok() && sigtimedwait(&signals, nullptr, &period) < 0) {
    }
    bridge.stop(ros::WallDuration(kStop_s));
    spinner.stop();
    return 0;
  } catch (const std::exception& error) {
    ROS_FATAL("%s", error.what());
    return 1;
  }
}
