// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "ur_driver_bridge/arm_state.h"
#include "ur_driver_bridge/arm_status.h"

namespace ur_driver_bridge {

enum class ProtectiveStopPolicy {
  kOperator,  // only on the operator's word
  kAutomatic,  // the configuration allows it: for simulation and soak
};

struct RecoveryConfig {
  bool is_headless{false};              // the driver sends its program (resend_robot_program); else play
  ProtectiveStopPolicy protective_stop{ProtectiveStopPolicy::kOperator};
  double unlock_wait_s{5.5};            // a protective stop can be unlocked 5 s after it
  double step_timeout_s{15.0};          // for the robot to follow one command
  int max_commands{12};                 // in one recovery

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
/// the answer; nothing here moves the arm.
class Recovery {
 public:
  enum class Action { kDone, kCommand, kWait, kImpossible };
  struct Step {
    Action action{Action::kDone};
    std::string command;  // kCommand: name of a service, e.g. "dashboard/power_on", "resend_robot_program"
    Verdict verdict;      // kImpossible: why; kWait: message says for what
  };

  /// Throws std::invalid_argument listing every impossible value.
  explicit Recovery(const RecoveryConfig& config);

  void begin(const RecoveryPermit& permit, double now_s);
  /// Called again and again. After kCommand the next call must come with that command's answer (answered()).
  Step next(const ArmState& arm, double now_s);
  void answered(bool success, const std::string& message, double now_s);

  const std::vector<std::string>& done() const { return done_; }  // commands given, in order

 private:
  RecoveryConfig config_;
  RecoveryPermit permit_;
  std::vector<std::string> done_;
};

}  // namespace ur_driver_bridge
