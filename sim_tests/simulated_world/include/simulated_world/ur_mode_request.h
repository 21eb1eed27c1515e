// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "simulated_world/ur_controller.h"

namespace simulated_world {

/// Brings the robot to a mode through everything that lies between, as the driver's action set_mode: unlocks a
/// protective stop, restarts the safety after a fault, powers, releases brakes, and plays the program if wanted.
class UrModeRequest {
 public:
  /// The modes that can be asked for are POWER_OFF, IDLE and RUNNING.
  UrModeRequest(RobotMode target, bool stop_program, bool play_program)
      : target_(target), stop_program_(stop_program), play_program_(play_program) {}

  /// Does what can be done now; to be called after each update of the robot until it returns an answer.
  std::optional<CommandAnswer> step(UrController& robot);

 private:
  RobotMode target_;
  bool stop_program_;
  bool play_program_;
};

}  // namespace simulated_world
