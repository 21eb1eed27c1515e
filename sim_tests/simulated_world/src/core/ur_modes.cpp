// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/ur_modes.h"

namespace simulated_world {

const char* toString(RobotMode mode) {
  switch (mode) {
    case RobotMode::kNoController:
      return "NO_CONTROLLER";
    case RobotMode::kDisconnected:
      return "DISCONNECTED";
    case RobotMode::kConfirmSafety:
      return "CONFIRM_SAFETY";
    case RobotMode::kBooting:
      return "BOOTING";
    case RobotMode::kPowerOff:
      return "POWER_OFF";
    case RobotMode::kPowerOn:
      return "POWER_ON";
    case RobotMode::kIdle:
      return "IDLE";
    case RobotMode::kBackdrive:
      return "BACKDRIVE";
    case RobotMode::kRunning:
      return "RUNNING";
    case RobotMode::kUpdatingFirmware:
      return "UPDATING_FIRMWARE";
  }
  return "UNKNOWN";
}

const char* toString(SafetyMode mode) {
  switch (mode) {
    case SafetyMode::kNormal:
      return "NORMAL";
    case SafetyMode::kReduced:
      return "REDUCED";
    case SafetyMode::kProtectiveStop:
      return "PROTECTIVE_STOP";
    case SafetyMode::kRecovery:
      return "RECOVERY";
    case SafetyMode::kSafeguardStop:
      return "SAFEGUARD_STOP";
    case SafetyMode::kSystemEmergencyStop:
      return "SYSTEM_EMERGENCY_STOP";
    case SafetyMode::kRobotEmergencyStop:
      return "ROBOT_EMERGENCY_STOP";
    case SafetyMode::kViolation:
      return "VIOLATION";
    case SafetyMode::kFault:
      return "FAULT";
    case SafetyMode::kValidateJointId:
      return "VALIDATE_JOINT_ID";
    case SafetyMode::kUndefined:
      return "UNDEFINED_SAFETY_MODE";
    case SafetyMode::kAutomaticModeSafeguardStop:
      return "AUTOMATIC_MODE_SAFEGUARD_STOP";
    case SafetyMode::kSystemThreePositionEnablingStop:
      return "SYSTEM_THREE_POSITION_ENABLING_STOP";
  }
  return "UNKNOWN";
}

const char* toString(ProgramState state) {
  switch (state) {
    case ProgramState::kStopped:
      return "STOPPED";
    case ProgramState::kPlaying:
      return "PLAYING";
    case ProgramState::kPaused:
      return "PAUSED";
  }
  return "UNKNOWN";
}

}  // namespace simulated_world
