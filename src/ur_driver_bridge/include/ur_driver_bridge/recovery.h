// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "ur_driver_bridge/arm_state.h"
#include "ur_driver_bridge/arm_status.h"

namespace ur_driver_bridge {

enum class ProtectiveStopPolicy {
  kOperator,   // only on the operator's word
  kAutomatic,  // the configuration allows it: for simulation and soak
};

struct RecoveryConfig {
  bool is_headless{false};  // the driver sends its program (resend_robot_program); else play
  ProtectiveStopPolicy protective_stop{ProtectiveStopPolicy::kOperator};
  double unlock_wait_s{5.5};    // a protective stop can be unlocked 5 s after it
  double step_timeout_s{15.0};  // for the robot to follow one command
  int max_commands{12};         // in one recovery

  std::vector<std::string> validate() const;
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
