// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/safety_gate.h"

#include <cmath>

#include <interactive_mapping_common/formatted.h>

namespace ur_driver_bridge {
namespace {

std::string seconds(double value_s) {
  // Ages as they are compared: 0.1004 s must not read as the 0.1 s that are allowed.
  return interactive_mapping::formatted("%.4g s", value_s);
}

/// What is wrong with a stamp, or nothing. Nothing that is not a number passes.
std::string ageProblem(const std::string& what, double stamp_s, double now_s, double max_age_s, double max_future_s) {
  const double age_s = now_s - stamp_s;
  if (!std::isfinite(age_s)) return what + ": stamp or clock is not finite";
  if (age_s > max_age_s) return what + ": " + seconds(age_s) + " old, allowed " + seconds(max_age_s);
  if (age_s < -max_future_s) {
    return what + ": stamped " + seconds(-age_s) + " ahead of the clock, allowed " + seconds(max_future_s);
  }
  return {};
}

template <typename Value>
std::string ageProblem(const std::string& what, const std::optional<Stamped<Value>>& heard, double now_s,
                       double max_age_s, double max_future_s) {
  if (!heard) return what + ": never heard";
  return ageProblem(what, heard->stamp_s, now_s, max_age_s, max_future_s);
}

std::string withNumber(const char* name, int mode) {
  return std::string(name) + " (" + std::to_string(mode) + ")";
}

Verdict checkSafetyMode(const ArmState& arm) {
  if (!arm.safety_mode) return {ArmStatus::kNotReady, "safety mode: never heard"};
  const std::string text = "safety mode " + safetyModeName(*arm.safety_mode);
  switch (*arm.safety_mode) {
    case safety_mode::kNormal:
    case safety_mode::kReduced:
      return {};
    case safety_mode::kProtectiveStop:
      return {ArmStatus::kProtectiveStop, text};
    case safety_mode::kSafeguardStop:
    case safety_mode::kSystemEmergencyStop:
    case safety_mode::kRobotEmergencyStop:
    case safety_mode::kViolation:
    case safety_mode::kFault:
    case safety_mode::kAutomaticModeSafeguardStop:
      return {ArmStatus::kEmergencyStop, text};
    default:
      return {ArmStatus::kNotReady, text + ", must be NORMAL (1) or REDUCED (2)"};
  }
}

bool saysToStop(const GateInputs& inputs, const GateDemand& demand) {
  return inputs.monitor && demand.watch_id && inputs.monitor->must_stop && inputs.monitor->watch_id == *demand.watch_id;
}

}  // namespace

SafetyGate::SafetyGate(const SafetyGateConfig& config)
    : config_(interactive_mapping::requireValid("impossible safety gate:", config)) {}

Verdict SafetyGate::checkRobot(const ArmState& arm, double now_s) const {
  if (!arm.joints && !arm.safety_mode && !arm.robot_mode && !arm.is_program_running) {
    return {ArmStatus::kDriverGone, "no message of the arm's driver has come"};
  }
  const Verdict safety = checkSafetyMode(arm);
  if (!safety.isFine()) return safety;
  if (!arm.robot_mode) return {ArmStatus::kNotReady, "robot mode: never heard"};
  if (*arm.robot_mode != robot_mode::kRunning) {
    return {ArmStatus::kNotReady, "robot mode " + robotModeName(*arm.robot_mode) + ", must be RUNNING (7)"};
  }
  if (!arm.is_program_running) return {ArmStatus::kNotReady, "whether the robot's program runs: never heard"};
  if (!*arm.is_program_running) return {ArmStatus::kProgramStopped, "the robot's program does not run"};
  if (!arm.is_controller_there) {
    return {ArmStatus::kDriverGone, "no server for the trajectory controller's action"};
  }
  if (!arm.joints) return {ArmStatus::kDriverGone, "joint states: never heard"};
  const std::string problem =
      ageProblem("joint states", arm.joints, now_s, config_.max_joint_age_s, config_.max_future_s);
  if (!problem.empty()) {
    const bool is_gone = now_s - arm.joints->stamp_s > kGone_s;
    return {is_gone ? ArmStatus::kDriverGone : ArmStatus::kStaleState, problem};
  }
  if (!arm.joints->value.position_rad.allFinite() || !arm.joints->value.velocity_rad_s.allFinite()) {
    return {ArmStatus::kStaleState, "joint states: not finite"};
  }
  return {};
}

Verdict SafetyGate::check(const GateInputs& inputs, const GateDemand& demand) const {
  const Verdict robot = checkRobot(inputs.arm, inputs.now_s);
  if (!robot.isFine()) return robot;
  if (inputs.is_held) return {ArmStatus::kHeld, "the operator holds the arm"};
  // However old: a monitor that told to stop and fell silent has not taken it back.
  if (saysToStop(inputs, demand)) {
    return {ArmStatus::kPathBlocked, "the path monitor says stop: " + inputs.monitor->reason};
  }

  if (demand.needs_force) {
    std::string problem =
        ageProblem("force at the tool", inputs.arm.force, inputs.now_s, config_.max_force_age_s, config_.max_future_s);
    if (problem.empty() &&
        !(inputs.arm.force->value.force_N.allFinite() && inputs.arm.force->value.torque_Nm.allFinite())) {
      problem = "force at the tool: not finite";
    }
    if (!problem.empty()) return {ArmStatus::kStaleState, problem};
  }
  std::string problem = ageProblem("speed scaling", inputs.arm.speed_scaling, inputs.now_s,
                                   config_.max_speed_scaling_age_s, config_.max_future_s);
  if (problem.empty() && !std::isfinite(inputs.arm.speed_scaling->value)) problem = "speed scaling: not finite";
  if (!problem.empty()) return {ArmStatus::kStaleState, problem};

  if (config_.max_map_age_s > 0.0) {
    if (!inputs.map_stamp_s) return {ArmStatus::kStaleMap, "newest image in the map: never heard of one"};
    problem = ageProblem("newest image in the map", *inputs.map_stamp_s, inputs.now_s, config_.max_map_age_s,
                         config_.max_future_s);
    if (!problem.empty()) return {ArmStatus::kStaleMap, problem};
  }
  problem = monitorProblem(inputs, demand);
  if (!problem.empty()) return {ArmStatus::kMonitorGone, problem};

  if (config_.max_heartbeat_age_s > 0.0) {
    if (!inputs.heartbeat_s) return {ArmStatus::kHeartbeatLost, "heartbeat of the mission: never heard"};
    problem = ageProblem("heartbeat of the mission", *inputs.heartbeat_s, inputs.now_s, config_.max_heartbeat_age_s,
                         config_.max_future_s);
    if (!problem.empty()) return {ArmStatus::kHeartbeatLost, problem};
  }
  if (config_.max_heartbeat_silence_s > 0.0) {
    const std::string what = "heartbeat of the mission by the wall clock";
    if (!inputs.heartbeat_wall_s) return {ArmStatus::kHeartbeatLost, what + ": never heard"};
    problem = ageProblem(what, *inputs.heartbeat_wall_s, inputs.wall_s, config_.max_heartbeat_silence_s,
                         config_.max_future_s);
    if (!problem.empty()) return {ArmStatus::kHeartbeatLost, problem};
  }
  return {};
}

std::string SafetyGate::monitorProblem(const GateInputs& inputs, const GateDemand& demand) const {
  if (config_.max_monitor_age_s <= 0.0) return {};
  const auto age = [&](const std::string& what, double stamp_s) {
    return ageProblem(what, stamp_s, inputs.now_s, config_.max_monitor_age_s, config_.max_future_s);
  };
  if (!demand.watch_id) return {};  // a monitor with nothing to watch may be silent; its answer will tell
  const std::string what = "path monitor's watch " + std::to_string(*demand.watch_id);
  const bool is_mine = inputs.monitor && inputs.monitor->is_watching && inputs.monitor->watch_id == *demand.watch_id;
  // A word that is no number must not be hidden by the grace that a new watch has.
  if (is_mine && !(inputs.monitor->stamp_s < demand.watch_since_s)) return age(what, inputs.monitor->stamp_s);
  std::string problem = age(what + ", started and not reported yet", demand.watch_since_s);
  if (problem.empty() || !inputs.monitor || is_mine) return problem;
  if (!inputs.monitor->is_watching) return problem + "; the monitor watches nothing";
  return problem + "; the monitor watches " + std::to_string(inputs.monitor->watch_id);
}

std::string robotModeName(int mode) {
  switch (mode) {
    case robot_mode::kNoController:
      return withNumber("NO_CONTROLLER", mode);
    case robot_mode::kDisconnected:
      return withNumber("DISCONNECTED", mode);
    case robot_mode::kConfirmSafety:
      return withNumber("CONFIRM_SAFETY", mode);
    case robot_mode::kBooting:
      return withNumber("BOOTING", mode);
    case robot_mode::kPowerOff:
      return withNumber("POWER_OFF", mode);
    case robot_mode::kPowerOn:
      return withNumber("POWER_ON", mode);
    case robot_mode::kIdle:
      return withNumber("IDLE", mode);
    case robot_mode::kBackdrive:
      return withNumber("BACKDRIVE", mode);
    case robot_mode::kRunning:
      return withNumber("RUNNING", mode);
    case robot_mode::kUpdatingFirmware:
      return withNumber("UPDATING_FIRMWARE", mode);
    default:
      return withNumber("unknown", mode);
  }
}

std::string safetyModeName(int mode) {
  switch (mode) {
    case safety_mode::kNormal:
      return withNumber("NORMAL", mode);
    case safety_mode::kReduced:
      return withNumber("REDUCED", mode);
    case safety_mode::kProtectiveStop:
      return withNumber("PROTECTIVE_STOP", mode);
    case safety_mode::kRecovery:
      return withNumber("RECOVERY", mode);
    case safety_mode::kSafeguardStop:
      return withNumber("SAFEGUARD_STOP", mode);
    case safety_mode::kSystemEmergencyStop:
      return withNumber("SYSTEM_EMERGENCY_STOP", mode);
    case safety_mode::kRobotEmergencyStop:
      return withNumber("ROBOT_EMERGENCY_STOP", mode);
    case safety_mode::kViolation:
      return withNumber("VIOLATION", mode);
    case safety_mode::kFault:
      return withNumber("FAULT", mode);
    case safety_mode::kValidateJointId:
      return withNumber("VALIDATE_JOINT_ID", mode);
    case safety_mode::kUndefined:
      return withNumber("UNDEFINED_SAFETY_MODE", mode);
    case safety_mode::kAutomaticModeSafeguardStop:
      return withNumber("AUTOMATIC_MODE_SAFEGUARD_STOP", mode);
    case safety_mode::kThreePositionEnablingStop:
      return withNumber("SYSTEM_THREE_POSITION_ENABLING_STOP", mode);
    default:
      return withNumber("unknown", mode);
  }
}

}  // namespace ur_driver_bridge
