// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <actionlib_msgs/GoalStatus.h>

namespace interactive_mapping_ros {

/// The client of a goal that is accepted wants it cancelled. Servers ask this instead of using their cancel callback,
/// which on another thread may come before the goal's own callback has kept the goal.
template <typename GoalHandle>
bool isCancelAsked(const GoalHandle& goal) {
  return goal.getGoalStatus().status == actionlib_msgs::GoalStatus::PREEMPTING;
}

/// In place of the callback.
struct NoCancelCallback {
  template <typename GoalHandle>
  void operator()(const GoalHandle& /*goal*/) const {}
};

}  // namespace interactive_mapping_ros
