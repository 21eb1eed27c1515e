// SPDX-License-Identifier: BSD-3-Clause
#include "interactive_mapping_common_ros/node_main.h"

#include <pthread.h>

#include <atomic>
#include <csignal>
#include <ctime>

#include <ros/xmlrpc_manager.h>

namespace interactive_mapping_ros {
namespace {

sigset_t endingSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);   // the terminal, roslaunch
  sigaddset(&signals, SIGTERM);  // service managers and containers
  return signals;
}

std::atomic<bool> is_shutdown_asked{false};

void onShutdown(XmlRpc::XmlRpcValue& /*parameters*/, XmlRpc::XmlRpcValue& result) {
  is_shutdown_asked = true;
  result = ros::xmlrpc::responseInt(1, "", 0);
}

}  // namespace

void blockSignals() {
  const sigset_t signals = endingSignals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
}

void blockShutdown() {
  ros::XMLRPCManager::instance()->unbind("shutdown");
  ros::XMLRPCManager::instance()->bind("shutdown", onShutdown);
}

bool waitForEnd(double timeout_s) {
  if (is_shutdown_asked) return true;
  const sigset_t signals = endingSignals();
  const auto whole_s = static_cast<std::time_t>(timeout_s);
  const timespec timeout{whole_s, static_cast<long>(1e9 * (timeout_s - static_cast<double>(whole_s)))};
  return sigtimedwait(&signals, nullptr, &timeout) >= 0;
}

}  // namespace interactive_mapping_ros
