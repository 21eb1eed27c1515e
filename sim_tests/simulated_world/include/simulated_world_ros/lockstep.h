// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <ros/node_handle.h>
#include <topic_tools/shape_shifter.h>

#include "simulated_world/clock_gate.h"

namespace simulated_world_ros {

/// Feeds a ClockGate from topics: any message whose first field is a Header answers a wait rule; goals and results of
/// actions are read likewise, of whatever type. Lives in the thread of the callback queue.
class Lockstep {
 public:
  Lockstep(ros::NodeHandle nh, const std::vector<simulated_world::WaitRule>& wait_for,
           const std::vector<simulated_world::ComputingRule>& computing);

  simulated_world::ClockGate& gate() { return gate_; }

  /// Topics of wait rules that nobody publishes: there is no sense in beginning without them.
  std::vector<std::string> missing() const;

  /// Messages that could not be read, one sentence each, since the last call.
  std::vector<std::string> takeComplaints();

 private:
  void watchAction(const std::string& action);

  ros::NodeHandle nh_;
  simulated_world::ClockGate gate_;
  std::vector<ros::Subscriber> answers_;  // one per wait rule
  std::vector<ros::Subscriber> actions_;
  std::vector<std::string> complaints_;
};

/// The stamp of a serialised message that begins with a std_msgs/Header. False if it is too short to hold one.
bool headerStamp(const std::vector<std::uint8_t>& serialised, std::int64_t* stamp_ns);

/// Goal id and stamp of a serialised action goal: Header, then actionlib_msgs/GoalID. False if cut short.
bool goalId(const std::vector<std::uint8_t>& serialised, std::string* id, std::int64_t* stamp_ns);

/// Goal id of a serialised action result: Header, then actionlib_msgs/GoalStatus. False if cut short.
bool resultGoalId(const std::vector<std::uint8_t>& serialised, std::string* id);

}  // namespace simulated_world_ros
