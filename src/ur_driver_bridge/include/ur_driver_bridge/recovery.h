// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <interactive_mapping_common/config/schema.h>

#include "ur_driver_bridge/arm_state.h"
#include "ur_driver_bridge/arm_status.h"

namespace ur_driver_bridge {

struct RecoveryConfig {
  bool is_headless{false};
  bool unlocks_by_itself{false};
  double unlock_wait_s{5.5};
  double step_timeout_s{15.0};
  int max_commands{12};

  static void fields(RecoveryConfig& c, interactive_mapping::Fields& f) {
    f("is_headless", c.is_headless, "true: the driver sends its program itself (headless_mode); false: it is played");
    f("unlocks_by_itself", c.unlocks_by_itself,
      "true: a protective stop is unlocked without the operator's word, for simulation only");
    f("unlock_wait_s", c.unlock_wait_s, 0.0, 60.0, "s",
      "time from a protective stop until it is unlocked; the robot allows it after 5 s");
    f("step_timeout_s", c.step_timeout_s, 0.1, 600.0, "s", "time for the robot to follow one command");
    f("max_commands", c.max_commands, 1, 100, "", "commands in one recovery");
  }
};

/// The operator's word of one request.
struct RecoveryPermit {
  bool unlock_protective_stop{false};
  bool restart_safety{false};
};

/// What to do next on the way back to an arm that takes trajectories, from what the robot says now. Order (driver's
/// documentation): emergency stop released -> power_on -> brake_release -> program; protective stop -> unlock -> program;
/// violation or fault -> restart_safety -> power_on -> brake_release -> program. Whether to wait, and for what, is part of
/// the answer; nothing here moves the arm. A word of the operator is for one stop: a second one in the same recovery needs
/// another. kImpossible is final until begin().
class Recovery {
 public:
  enum class Action { kDone, kCommand, kWait, kImpossible };
  struct Step {
    Action action{Action::kDone};
    std::string command;  // kCommand: name of a service, e.g. "dashboard/power_on", "resend_robot_program"
    Verdict verdict;      // kImpossible: why; kWait: what still stands in the way, and for what is waited
  };

  /// Throws std::invalid_argument listing every impossible value.
  explicit Recovery(const RecoveryConfig& config);

  void begin(const RecoveryPermit& permit, double now_s);
  /// Called again and again, with a clock that does not stand still. After kCommand its answer is waited for (answered()),
  /// for step_timeout_s as well. Throws std::logic_error before begin(), std::invalid_argument for a time that is not
  /// finite.
  Step next(const ArmState& arm, double now_s);
  /// Throws std::logic_error if no command waits for an answer.
  void answered(bool success, const std::string& message, double now_s);

  const std::vector<std::string>& done() const { return done_; }  // commands given, in order

 private:
  struct Need;
  struct Given {
    std::string command;
    double since_s;               // given; answered once there is an answer
    std::optional<bool> success;  // nothing: no answer yet
    std::string answer;
  };

  Need need(const ArmState& arm) const;
  Step impossible(ArmStatus status, const std::string& message);
  Step wait(const Need& need, double now_s);

  RecoveryConfig config_;
  RecoveryPermit permit_;
  std::vector<std::string> done_;
  std::optional<double> begun_s_;
  std::optional<Verdict> impossible_;
  std::optional<Given> given_;                // the last command, until the robot has followed
  std::optional<double> protective_since_s_;  // seen since then
  std::optional<double> waiting_since_s_;     // for anything but the last command, since that was given
};

}  // namespace ur_driver_bridge
