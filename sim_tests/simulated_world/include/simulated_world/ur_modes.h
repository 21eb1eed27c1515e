// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <interactive_mapping_common/enums/enum_names.h>

namespace simulated_world {

/// Values of ur_dashboard_msgs/RobotMode.
enum class RobotMode {
  kNoController = -1,
  kDisconnected = 0,
  kConfirmSafety = 1,
  kBooting = 2,
  kPowerOff = 3,
  kPowerOn = 4,
  kIdle = 5,
  kBackdrive = 6,
  kRunning = 7,
  kUpdatingFirmware = 8,
};

/// Values of ur_dashboard_msgs/SafetyMode.
enum class SafetyMode {
  kNormal = 1,
  kReduced = 2,
  kProtectiveStop = 3,
  kRecovery = 4,
  kSafeguardStop = 5,
  kSystemEmergencyStop = 6,
  kRobotEmergencyStop = 7,
  kViolation = 8,
  kFault = 9,
  kValidateJointId = 10,
  kUndefined = 11,
  kAutomaticModeSafeguardStop = 12,
  kSystemThreePositionEnablingStop = 13,
};

enum class ProgramState { kStopped, kPlaying, kPaused };

// Names as the dashboard server spells them.
inline constexpr interactive_mapping::Names<RobotMode> kRobotModeNames = {
    {"NO_CONTROLLER", RobotMode::kNoController},
    {"DISCONNECTED", RobotMode::kDisconnected},
    {"CONFIRM_SAFETY", RobotMode::kConfirmSafety},
    {"BOOTING", RobotMode::kBooting},
    {"POWER_OFF", RobotMode::kPowerOff},
    {"POWER_ON", RobotMode::kPowerOn},
    {"IDLE", RobotMode::kIdle},
    {"BACKDRIVE", RobotMode::kBackdrive},
    {"RUNNING", RobotMode::kRunning},
    {"UPDATING_FIRMWARE", RobotMode::kUpdatingFirmware},
};
constexpr const char* toString(RobotMode mode) {
  return interactive_mapping::nameOf(mode, kRobotModeNames);
}

inline constexpr interactive_mapping::Names<SafetyMode> kSafetyModeNames = {
    {"NORMAL", SafetyMode::kNormal},
    {"REDUCED", SafetyMode::kReduced},
    {"PROTECTIVE_STOP", SafetyMode::kProtectiveStop},
    {"RECOVERY", SafetyMode::kRecovery},
    {"SAFEGUARD_STOP", SafetyMode::kSafeguardStop},
    {"SYSTEM_EMERGENCY_STOP", SafetyMode::kSystemEmergencyStop},
    {"ROBOT_EMERGENCY_STOP", SafetyMode::kRobotEmergencyStop},
    {"VIOLATION", SafetyMode::kViolation},
    {"FAULT", SafetyMode::kFault},
    {"VALIDATE_JOINT_ID", SafetyMode::kValidateJointId},
    {"UNDEFINED_SAFETY_MODE", SafetyMode::kUndefined},
    {"AUTOMATIC_MODE_SAFEGUARD_STOP", SafetyMode::kAutomaticModeSafeguardStop},
    {"SYSTEM_THREE_POSITION_ENABLING_STOP", SafetyMode::kSystemThreePositionEnablingStop},
};
constexpr const char* toString(SafetyMode mode) {
  return interactive_mapping::nameOf(mode, kSafetyModeNames);
}

inline constexpr interactive_mapping::Names<ProgramState> kProgramStateNames = {
    {"STOPPED", ProgramState::kStopped},
    {"PLAYING", ProgramState::kPlaying},
    {"PAUSED", ProgramState::kPaused},
};
constexpr const char* toString(ProgramState state) {
  return interactive_mapping::nameOf(state, kProgramStateNames);
}

}  // namespace simulated_world
