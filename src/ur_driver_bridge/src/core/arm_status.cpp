// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/arm_status.h"

namespace ur_driver_bridge {

const char* toString(ArmStatus status) {
  switch (status) {
    case ArmStatus::kSuccess:
      return "SUCCESS";
    case ArmStatus::kCancelled:
      return "CANCELLED";
    case ArmStatus::kBadRequest:
      return "BAD_REQUEST";
    case ArmStatus::kBeyondLimits:
      return "BEYOND_LIMITS";
    case ArmStatus::kStartMismatch:
      return "START_MISMATCH";
    case ArmStatus::kNotReady:
      return "NOT_READY";
    case ArmStatus::kStaleState:
      return "STALE_STATE";
    case ArmStatus::kStaleMap:
      return "STALE_MAP";
    case ArmStatus::kMonitorGone:
      return "MONITOR_GONE";
    case ArmStatus::kPathBlocked:
      return "PATH_BLOCKED";
    case ArmStatus::kHeartbeatLost:
      return "HEARTBEAT_LOST";
    case ArmStatus::kHeld:
      return "HELD";
    case ArmStatus::kProtectiveStop:
      return "PROTECTIVE_STOP";
    case ArmStatus::kEmergencyStop:
      return "EMERGENCY_STOP";
    case ArmStatus::kProgramStopped:
      return "PROGRAM_STOPPED";
    case ArmStatus::kDriverGone:
      return "DRIVER_GONE";
    case ArmStatus::kTrajectoryRefused:
      return "TRAJECTORY_REFUSED";
    case ArmStatus::kTrajectoryAborted:
      return "TRAJECTORY_ABORTED";
    case ArmStatus::kStalled:
      return "STALLED";
    case ArmStatus::kIoRefused:
      return "IO_REFUSED";
    case ArmStatus::kNoContact:
      return "NO_CONTACT";
    case ArmStatus::kContactTooEarly:
      return "CONTACT_TOO_EARLY";
    case ArmStatus::kNotAttached:
      return "NOT_ATTACHED";
    case ArmStatus::kLostOnTheWay:
      return "LOST_ON_THE_WAY";
    case ArmStatus::kNotLetGo:
      return "NOT_LET_GO";
    case ArmStatus::kNothingHeld:
      return "NOTHING_HELD";
    case ArmStatus::kFault:
      return "FAULT";
    case ArmStatus::kBusy:
      return "BUSY";
  }
  return "UNKNOWN";
}

}  // namespace ur_driver_bridge
