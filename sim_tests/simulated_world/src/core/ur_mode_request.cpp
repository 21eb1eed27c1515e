// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/ur_mode_request.h"

#include <string>

namespace simulated_world {

std::optional<CommandAnswer> UrModeRequest::step(UrController& robot) {
  if (target_ != RobotMode::kPowerOff && target_ != RobotMode::kIdle && target_ != RobotMode::kRunning) {
    return CommandAnswer{false, "target_robot_mode = " + std::to_string(static_cast<int>(target_)) +
                                    ", must be POWER_OFF (3), IDLE (5) or RUNNING (7)"};
  }
  if (!robot.driverConnected()) {
    return CommandAnswer{false, "The driver is not connected to the robot"};
  }
  if (stop_program_) {
    stop_program_ = false;
    robot.stop();  // refused if none is playing: as good
  }
  const SafetyMode safety = robot.safetyMode();
  if (safety == SafetyMode::kProtectiveStop) {
    robot.unlockProtectiveStop();  // refused until its time has come
    return std::nullopt;
  }
  if (safety == SafetyMode::kViolation || safety == SafetyMode::kFault) {
    robot.restartSafety();
    return std::nullopt;
  }
  if (safety != SafetyMode::kNormal && safety != SafetyMode::kReduced) {
    return CommandAnswer{false, std::string("Somebody has to go to the robot: safety mode ") + toString(safety)};
  }
  const RobotMode mode = robot.robotMode();
  if (mode == target_) {
    if (!play_program_ || target_ != RobotMode::kRunning) {
      return CommandAnswer{true, "Reached target robot mode."};
    }
    return robot.config().headless_mode ? robot.resendRobotProgram() : robot.play();
  }
  if (mode > target_) {
    robot.powerOff();
  } else if (target_ == RobotMode::kRunning) {
    robot.brakeRelease();
  } else {
    robot.powerOn();
  }
  return std::nullopt;
}

}  // namespace simulated_world
