// SPDX-License-Identifier: BSD-3-Clause
#include "interactive_mapping_common_ros/node_main.h"

#include <pthread.h>

#include <csignal>
#include <ctime>

namespace interactive_mapping_ros {
namespace {

sigset_t endingSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);   // the terminal, roslaunch
  sigaddset(&signals, SIGTERM);  // service managers and containers
  return signals;
}

}  // namespace

void blockSignals() {
  const sigset_t signals = endingSignals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
}

bool waitForSignal(double timeout_s) {
  const sigset_t signals = endingSignals();
  const auto whole_s = static_cast<std::time_t>(timeout_s);
  const timespec timeout{whole_s, static_cast<long>(1e9 * (timeout_s - static_cast<double>(whole_s)))};
  return sigtimedwait(&signals, nullptr, &timeout) >= 0;
}

}  // namespace interactive_mapping_ros
