// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <exception>
#include <functional>
#include <string>

#include <ros/console.h>
#include <ros/init.h>
#include <ros/node_handle.h>

#include "interactive_mapping_common_ros/spinner.h"

namespace interactive_mapping_ros {

/// Leaves SIGINT and SIGTERM of every thread to waitForEnd(). Call it before ros::init and before any thread is made.
void blockSignals();

/// Leaves requests to shut down to waitForEnd(), too: of `rosnode kill`, and of the master when another node takes the
/// name. roscpp's own answer shuts ROS down at once, and nothing could be brought to rest. Call it after the first
/// NodeHandle is made.
void blockShutdown();

/// True if SIGINT, SIGTERM or a request to shut down has come; signals also if they come within `timeout_s` of wall time.
bool waitForEnd(double timeout_s);

/// The main() of a node: builds Node(nh, private_nh) and serves its callbacks from `num_threads` threads until a signal or
/// a request to shut down. Then it calls `stop` while ROS is still there, for what has to be brought to rest. Returns
/// the exit code: 1 if the constructor throws, which is logged as fatal.
template <typename Node>
int runNode(int argc, char** argv, const std::string& name, int num_threads,
            const std::function<void(Node&)>& stop = nullptr) {
  blockSignals();
  ros::init(argc, argv, name, ros::init_options::NoSigintHandler);
  // Outside the block that may throw: with the last handle goes ROS's log, and with that the reason.
  const ros::NodeHandle nh;
  const ros::NodeHandle private_nh("~");
  blockShutdown();
  try {
    Node node(nh, private_nh);
    Spinner spinner(num_threads, ros::getGlobalCallbackQueue());
    while (ros::ok() && !waitForEnd(0.1)) {  // so soon is a request to shut down noticed
    }
    if (stop) {
      stop(node);
      spinner.stop();
    }
    ros::shutdown();  // breaks off the calls that the node's threads may wait for
    return 0;
  } catch (const std::exception& error) {
    ROS_FATAL("%s", error.what());
    return 1;
  }
}

}  // namespace interactive_mapping_ros
