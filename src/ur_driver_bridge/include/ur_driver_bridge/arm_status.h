// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace ur_driver_bridge {

/// What became of something the arm was told to do; values are those of interactive_mapping_msgs/ArmOutcome.
enum class ArmStatus {
  kSuccess,
  kCancelled,
  kBadRequest,
  kBeyondLimits,
  kStartMismatch,
  kNotReady,
  kStaleState,
  kStaleMap,
  kMonitorGone,
  kPathBlocked,
  kHeartbeatLost,
  kHeld,
  kProtectiveStop,
  kEmergencyStop,
  kProgramStopped,
  kDriverGone,
  kTrajectoryRefused,
  kTrajectoryAborted,
  kStalled,
  kIoRefused,
  kNoContact,
  kContactTooEarly,
  kNotAttached,
  kLostOnTheWay,
  kNotLetGo,
  kNothingHeld,
  kFault,
  kBusy,
};
constexpr int kNumArmStatus = 28;

/// "SUCCESS", "CANCELLED", ... as in the message.
const char* toString(ArmStatus status);

/// A status with its sentence; the sentence is empty on success.
struct Verdict {
  ArmStatus status{ArmStatus::kSuccess};
  std::string message;

  bool isFine() const { return status == ArmStatus::kSuccess; }
};

}  // namespace ur_driver_bridge
