// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/recovery.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <interactive_mapping_common/formatted.h>

#include "ur_driver_bridge/safety_gate.h"

namespace ur_driver_bridge {
namespace {

using interactive_mapping::formatted;

constexpr char kUnlock[] = "dashboard/unlock_protective_stop";
constexpr char kRestartSafety[] = "dashboard/restart_safety";
constexpr char kPowerOn[] = "dashboard/power_on";
constexpr char kBrakeRelease[] = "dashboard/brake_release";
constexpr char kPlay[] = "dashboard/play";
constexpr char kResend[] = "resend_robot_program";

std::string whatRobotSays(const ArmState& arm) {
  return "safety mode " + (arm.safety_mode ? safetyModeName(*arm.safety_mode) : "never heard") + ", robot mode " +
         (arm.robot_mode ? robotModeName(*arm.robot_mode) : "never heard") + ", program " +
         (!arm.is_program_running   ? "never heard of"
          : *arm.is_program_running ? "running"
                                    : "not running");
}

}  // namespace

/// What stands between the arm and taking trajectories, and what is to be done about it.
struct Recovery::Need {
  ArmStatus status{ArmStatus::kSuccess};  // kSuccess: nothing
  std::string state{};                    // "safety mode ROBOT_EMERGENCY_STOP (7)"
  std::string command{};                  // empty: only waiting helps
  std::string wait_for{};                 // if there is no command
  bool is_hopeless{false};                // not even waiting helps; `wait_for` says what would
};

Recovery::Recovery(const RecoveryConfig& config)
    : config_(interactive_mapping::requireValid("impossible recovery:", config)) {}

void Recovery::begin(const RecoveryPermit& permit, double now_s) {
  if (!std::isfinite(now_s)) throw std::invalid_argument("now_s is not finite");
  permit_ = permit;
  done_.clear();
  begun_s_ = now_s;
  impossible_.reset();
  given_.reset();
  protective_since_s_.reset();
  waiting_since_s_.reset();
}

Recovery::Need Recovery::need(const ArmState& arm) const {
  if (!arm.safety_mode || !arm.robot_mode || !arm.is_program_running) {
    return {ArmStatus::kDriverGone, whatRobotSays(arm), "", "the arm's driver to report all of these"};
  }
  const std::string safety = "safety mode " + safetyModeName(*arm.safety_mode);
  switch (*arm.safety_mode) {
    case safety_mode::kNormal:
    case safety_mode::kReduced:
      break;
    case safety_mode::kProtectiveStop: {
      const bool is_given = std::find(done_.begin(), done_.end(), kUnlock) != done_.end();
      const bool is_followed = is_given && !(given_ && given_->command == kUnlock);
      if (config_.unlocks_by_itself) {
        return {ArmStatus::kProtectiveStop, safety, kUnlock};
      }
      if (!permit_.unlock_protective_stop) {
        return {ArmStatus::kProtectiveStop, safety, "",
                "the operator has to check what the arm ran into, clear it, and ask again with unlock_protective_stop",
                true};
      }
      if (is_followed) {
        return {ArmStatus::kProtectiveStop, safety + " again, after it was unlocked", "",
                "the operator has to check what the arm ran into, and ask again with unlock_protective_stop", true};
      }
      return {ArmStatus::kProtectiveStop, safety, kUnlock};
    }
    case safety_mode::kViolation:
    case safety_mode::kFault: {
      const bool is_given = std::find(done_.begin(), done_.end(), kRestartSafety) != done_.end();
      const bool is_followed = is_given && !(given_ && given_->command == kRestartSafety);
      if (!permit_.restart_safety || is_followed) {
        return {ArmStatus::kEmergencyStop, safety + (is_followed ? " again, after safety was restarted" : ""), "",
                "the operator has to read the robot's log, and ask again with restart_safety", true};
      }
      return {ArmStatus::kEmergencyStop, safety, kRestartSafety};
    }
    case safety_mode::kSafeguardStop:
    case safety_mode::kAutomaticModeSafeguardStop:
      return {ArmStatus::kEmergencyStop, safety, "", "the operator to close or reset the safeguard"};
    case safety_mode::kSystemEmergencyStop:
    case safety_mode::kRobotEmergencyStop:
      return {ArmStatus::kEmergencyStop, safety, "", "the operator to release the emergency stop"};
    default:  // passes while safety is restarted
      return {ArmStatus::kNotReady, safety, "",
              "safety mode NORMAL (1) or REDUCED (2), maybe by the operator at the robot"};
  }
  const std::string mode = "robot mode " + robotModeName(*arm.robot_mode);
  switch (*arm.robot_mode) {
    case robot_mode::kPowerOff:
      return {ArmStatus::kNotReady, mode, kPowerOn};
    case robot_mode::kPowerOn:
      return {ArmStatus::kNotReady, mode, "", "robot mode IDLE (5)"};
    case robot_mode::kIdle:
      return {ArmStatus::kNotReady, mode, kBrakeRelease};
    case robot_mode::kRunning:
      break;
    case robot_mode::kConfirmSafety:
      return {ArmStatus::kNotReady, mode, "", "the operator to confirm the safety configuration on the pendant"};
    default:
      return {ArmStatus::kNotReady, mode, "",
              "robot mode POWER_OFF (3) to RUNNING (7), maybe by the operator at the robot"};
  }
  if (!*arm.is_program_running) {
    return {ArmStatus::kProgramStopped, "the robot's program does not run", config_.is_headless ? kResend : kPlay};
  }
  if (!arm.is_controller_there) {
    return {ArmStatus::kDriverGone, "no server for the trajectory controller's action", "", "the controller"};
  }
  return {};
}

Recovery::Step Recovery::impossible(ArmStatus status, const std::string& message) {
  impossible_ = Verdict{status, message};
  return {Action::kImpossible, "", *impossible_};
}

Recovery::Step Recovery::wait(const Need& need, double now_s) {
  if (!waiting_since_s_) waiting_since_s_ = now_s;
  const double waited_s = now_s - *waiting_since_s_;
  if (waited_s < config_.step_timeout_s) {
    return {Action::kWait, "", {need.status, need.state + "; waiting for " + need.wait_for}};
  }
  return impossible(need.status, need.state + ": waited " + formatted("%g s", waited_s) + ", allowed " +
                                     formatted("%g s", config_.step_timeout_s) + ", for " + need.wait_for +
                                     (done_.empty() ? "" : "; last command: " + done_.back()));
}

Recovery::Step Recovery::next(const ArmState& arm, double now_s) {
  if (!begun_s_) throw std::logic_error("no recovery has begun");
  if (!std::isfinite(now_s)) throw std::invalid_argument("now_s is not finite");
  if (impossible_) return {Action::kImpossible, "", *impossible_};

  if (given_ && !given_->success) {
    const double silent_s = now_s - given_->since_s;
    if (silent_s >= config_.step_timeout_s) {
      return impossible(ArmStatus::kDriverGone, given_->command + ": no answer for " + formatted("%g s", silent_s) +
                                                    ", allowed " + formatted("%g s", config_.step_timeout_s) + "; " +
                                                    whatRobotSays(arm));
    }
    return {Action::kWait, "", {ArmStatus::kNotReady, "waiting for the answer to " + given_->command}};
  }

  const bool is_protective = arm.safety_mode == safety_mode::kProtectiveStop;
  if (!is_protective) {
    protective_since_s_.reset();
  } else if (!protective_since_s_) {
    protective_since_s_ = now_s;
  }

  // A command that the robot needs no more has been followed, or something graver has come between.
  if (given_ && need(arm).command != given_->command) given_.reset();
  const Need now = need(arm);
  if (now.status == ArmStatus::kSuccess) return {};
  if (now.is_hopeless) return impossible(now.status, now.state + ": " + now.wait_for);
  if (now.command.empty()) return wait(now, now_s);

  if (given_) {
    if (!*given_->success) {
      return impossible(now.status,
                        given_->command + " was refused: \"" + given_->answer + "\"; " + whatRobotSays(arm));
    }
    const double passed_s = now_s - given_->since_s;
    if (passed_s >= config_.step_timeout_s) {
      return impossible(now.status, given_->command + " was accepted, but the robot has not followed for " +
                                        formatted("%g s", passed_s) + ", allowed " +
                                        formatted("%g s", config_.step_timeout_s) + "; " + whatRobotSays(arm));
    }
    return {Action::kWait, "", {now.status, now.state + "; waiting for the robot to follow " + given_->command}};
  }
  if (now.command == kUnlock && now_s - *protective_since_s_ < config_.unlock_wait_s) {
    return {Action::kWait,
            "",
            {now.status,
             now.state + "; waiting " + formatted("%g s", config_.unlock_wait_s) + " before it can be unlocked"}};
  }
  if (static_cast<int>(done_.size()) >= config_.max_commands) {
    return impossible(now.status, std::to_string(done_.size()) + " commands given, allowed " +
                                      std::to_string(config_.max_commands) + ", the next would be " + now.command +
                                      "; " + whatRobotSays(arm));
  }
  waiting_since_s_.reset();
  done_.push_back(now.command);
  given_ = Given{now.command, now_s, std::nullopt, ""};
  return {Action::kCommand, now.command, {}};
}

void Recovery::answered(bool success, const std::string& message, double now_s) {
  if (!given_ || given_->success) throw std::logic_error("no command waits for an answer");
  if (!std::isfinite(now_s)) throw std::invalid_argument("now_s is not finite");
  given_->success = success;
  given_->answer = message;
  given_->since_s = now_s;
}

}  // namespace ur_driver_bridge
