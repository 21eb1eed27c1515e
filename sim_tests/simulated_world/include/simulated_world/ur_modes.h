// SPDX-License-Identifier: BSD-3-Clause
#pragma once

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

/// As the dashboard server spells them.
const char* toString(RobotMode mode);
const char* toString(SafetyMode mode);
const char* toString(ProgramState state);

}  // namespace simulated_world
