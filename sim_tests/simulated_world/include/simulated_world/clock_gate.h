// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <interactive_mapping_common/enums/enum_names.h>

namespace simulated_world {

/// What the simulated drivers publish that somebody may have to answer.
enum class ClockEvent { kImage, kOdometry, kJointStates, kScan, kActionResult };
inline constexpr interactive_mapping::Names<ClockEvent> kClockEventNames = {
    {"image", ClockEvent::kImage},
    {"odometry", ClockEvent::kOdometry},
    {"joint_states", ClockEvent::kJointStates},
    {"scan", ClockEvent::kScan},
    {"action_result", ClockEvent::kActionResult}};
constexpr const char* toString(ClockEvent event) {
  return interactive_mapping::nameOf(event, kClockEventNames);
}

/// "After each <event> stamped t the clock waits at t + cost until <topic> has carried a stamp >= t."
struct WaitRule {
  std::string topic;
  ClockEvent after{ClockEvent::kImage};
  double cost_s{0.0};        ///< simulated time that the answer takes
  std::string while_action;  ///< only while a goal of this action is open; empty: always
  std::string subscriber;    ///< node that must hear them before the clock begins; empty: for images anyone
};

/// "While a goal of <action> is open, the clock does not pass the goal's stamp + cost."
struct ComputingRule {
  std::string action;
  double cost_s{0.0};  ///< simulated time charged for the computation
};

/// Decides how far the simulated clock may go: to the point where something is due that has not arrived. What is due
/// depends on messages alone, never on how fast they came, so a loaded machine changes how long a run takes and not
/// what happens in it. Times in nanoseconds of simulated time. Not thread-safe.
class ClockGate {
 public:
  static constexpr std::int64_t kNoLimit = std::numeric_limits<std::int64_t>::max();
  static constexpr double kLongestCost_s = 60.0;

  /// Throws std::invalid_argument for an empty name or a cost outside [0, kLongestCost_s].
  ClockGate(const std::vector<WaitRule>& wait_rules, const std::vector<ComputingRule>& computing_rules);

  /// The drivers have published something with this stamp.
  void published(ClockEvent event, std::int64_t stamp_ns);

  /// A message with this stamp has come on the topic of wait rule `rule`.
  void answered(std::size_t rule, std::int64_t stamp_ns);

  /// A goal of an action has been seen, or its result. A result that overtakes its goal counts.
  void goalOpened(const std::string& action, const std::string& goal_id, std::int64_t stamp_ns);
  void goalClosed(const std::string& action, const std::string& goal_id);

  /// The latest time the clock may show now.
  std::int64_t limit() const;

  /// Topic or action that holds the clock at limit(); the first of the rules if there are several, empty if none.
  std::string awaited() const;

  /// One line for each thing that holds the clock at limit(): what is due, from where, since when.
  std::vector<std::string> waitingFor() const;

  /// Gives up on everything that is due now, so that the clock runs on; says what it was.
  std::vector<std::string> giveUp();

 private:
  struct Due {
    std::size_t rule;
    std::int64_t stamp_ns;
  };

  bool isOpen(const std::string& action) const;
  bool applies(const WaitRule& rule) const;
  std::int64_t limitOf(const Due& due) const;

  std::vector<WaitRule> wait_rules_;
  std::map<std::string, double> cost_of_action_s_;
  std::vector<std::int64_t> answered_ns_;  // newest stamp per wait rule
  std::vector<Due> due_;
  std::map<std::string, std::map<std::string, std::int64_t>> open_;  // action -> goal -> stamp
  std::map<std::string, std::set<std::string>> closed_early_;        // result seen before its goal
};

}  // namespace simulated_world
