// SPDX-License-Identifier: BSD-3-Clause
#include "interactive_mapping_common_ros/clock_timer.h"

#include <chrono>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>

#include <ros/time.h>

namespace interactive_mapping_ros {
namespace {

constexpr double kLongestWait_s = 1.0;  // far more than a busy machine keeps a thread waiting

std::uint64_t checked(ros::Duration period) {
  if (period > ros::Duration(0)) return static_cast<std::uint64_t>(period.toNSec());
  throw std::invalid_argument("a timer's period = " + std::to_string(period.toSec()) + " s, must be positive");
}

}  // namespace

ClockTimer::ClockTimer(ros::NodeHandle handle, ros::Duration period, std::function<void()> callback)
    : period_ns_(checked(period)), callback_(std::move(callback)), periods_(ros::Time::now().toNSec() / period_ns_) {
  if (ros::Time::isSimTime()) {
    clock_ = handle.subscribe("/clock", 1, &ClockTimer::onClock, this, ros::TransportHints().tcpNoDelay());
  } else {
    timer_ = handle.createTimer(period, [this](const ros::TimerEvent&) { callback_(); });
  }
}

void ClockTimer::onClock(const rosgraph_msgs::Clock& clock) {
  const std::uint64_t periods = clock.clock.toNSec() / period_ns_;
  if (periods == periods_) return;
  const std::uint64_t last = std::exchange(periods_, periods);
  // roscpp's own thread sets ros::Time::now() by the same message, and may be behind. Not for long: if the clock has been
  // set once more since, the time waited for does not come.
  const auto isBehind = [&] {
    const ros::Time now = ros::Time::now();
    return periods > last ? now < clock.clock : now.toNSec() / period_ns_ >= last;
  };
  const ros::SteadyTime end = ros::SteadyTime::now() + ros::WallDuration(kLongestWait_s);
  while (isBehind() && ros::SteadyTime::now() < end) std::this_thread::sleep_for(std::chrono::microseconds(50));
  callback_();
}

}  // namespace interactive_mapping_ros
