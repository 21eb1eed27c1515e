// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common_ros/worker_action_server.h>

#include <chrono>
#include <thread>

#include <ros/time.h>

namespace interactive_mapping_ros {
namespace {
constexpr std::chrono::milliseconds kClockPeriod(2);  // how often a result that is held back looks at the clock
}

bool waitUntil(const ros::Time& due, double stall_s, const std::function<bool()>& is_cancelled) {
  ros::Time clock = ros::Time::now();
  ros::WallTime clock_moved = ros::WallTime::now();
  while (ros::Time::now() < due && !is_cancelled()) {
    const ros::Time now = ros::Time::now();
    if (now < clock) return true;  // time ran back: what was due will not come
    if (now != clock) {
      clock = now;
      clock_moved = ros::WallTime::now();
    } else if ((ros::WallTime::now() - clock_moved).toSec() >= stall_s) {
      return false;
    }
    std::this_thread::sleep_for(kClockPeriod);  // /clock has no event to wait for
  }
  return true;
}

bool charge(double cost_s, const ros::Time& started, double stall_s, const std::function<bool()>& is_cancelled) {
  return ros::Time::isSystemTime() || started.isZero() ||
         waitUntil(started + ros::Duration(cost_s), stall_s, is_cancelled);
}

}  // namespace interactive_mapping_ros
