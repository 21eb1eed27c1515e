// SPDX-License-Identifier: BSD-3-Clause
#include <pthread.h>

#include <csignal>
#include <ctime>
#include <exception>

#include <ros/ros.h>

#include "base_navigation_ros/base_navigation_ros.h"

namespace {
constexpr double kStop_s = 6.0;  // wall time to brake from full speed (0.8 m/s at 0.2 m/s^2), and some
}

int main(int argc, char** argv) {
  // Every thread leaves these to the loop below: ROS must not be shut down before the base stands.
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  ros::init(argc, argv, "base_navigation", ros::init_options::NoSigintHandler);
  // Outside the block that may throw: with the last handle goes ROS's log, and with that the reason.
  const ros::NodeHandle nh;
  const ros::NodeHandle private_nh("~");
  try {
    base_navigation_ros::BaseNavigationRos navigation(nh, private_nh);
    ros::AsyncSpinner spinner(3);  // goals, services, diagnostics; control has a thread of its own
    spinner.start();
    const timespec period{0, 100000000};  // how soon a shutdown by the master is noticed
    while (ros::ok() && sigtimedwait(&signals, nullptr, &period) < 0) {
    }
    navigation.stop(ros::WallDuration(kStop_s));
    spinner.stop();
    return 0;
  } catch (const std::exception& error) {
    ROS_FATAL("%s", error.what());
    return 1;
  }
}
