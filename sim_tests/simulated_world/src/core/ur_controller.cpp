// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/ur_controller.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

namespace simulated_world {
namespace {

constexpr const char* kDriverGone = "The driver is not connected to the robot";

// Values of ur_msgs/SetIO.
constexpr int kSetDigitalOut = 1;
constexpr int kSetAnalogOut = 3;
constexpr int kSetToolVoltage = 4;

UrControllerConfig requireValid(const UrControllerConfig& config) {
  const std::vector<std::string> problems = config.validate();
  if (!problems.empty()) {
    std::string message = "UrController:";
    for (const std::string& problem : problems) {
      message += "\n  " + problem;
    }
    throw std::invalid_argument(message);
  }
  return config;
}

void requireFraction(const char* name, double value) {
  if (!(value >= 0.0 && value <= 1.0)) {
    throw std::invalid_argument(std::string("UrController: ") + name + " = " + std::to_string(value) +
                                ", must be in [0, 1]");
  }
}

CommandAnswer failed(const std::string& command, const std::string& why) {
  return {false, "Failed to execute: " + command + " (" + why + ")"};
}

}  // namespace

std::vector<std::string> UrControllerConfig::validate() const {
  std::vector<std::string> problems = follower.validate();
  const auto requireAtLeastZero = [&problems](const char* key, double value, const char* unit) {
    if (!(value >= 0.0) || !std::isfinite(value)) {
      std::ostringstream line;
      line << key << " = " << value << ' ' << unit << ", must be at least 0 and finite";
      problems.push_back(line.str());
    }
  };
  requireAtLeastZero("unlock_delay_s", unlock_delay_s, "s");
  requireAtLeastZero("power_on_s", power_on_s, "s");
  requireAtLeastZero("brake_release_s", brake_release_s, "s");
  requireAtLeastZero("speed_ramp_s", speed_ramp_s, "s");
  requireAtLeastZero("max_payload_kg", max_payload_kg, "kg");
  if (program.empty()) {
    problems.emplace_back("program = \"\", must be a name");
  }
  return problems;
}

UrController::UrController(std::vector<JointLimits> joints, const UrControllerConfig& config)
    : config_(requireValid(config)), follower_(std::move(joints), config.follower), loaded_program_(config.program) {}

const JointMotion& UrController::update(double now_s, double dt_s, const Eigen::VectorXd& measured_rad,
                                        const Eigen::VectorXd& measured_rad_s) {
  now_s_ = now_s;
  advanceMode(now_s);
  advanceSpeedScaling(dt_s);
  return follower_.update(now_s, dt_s, speed_scaling_, measured_rad, measured_rad_s);
}

CommandAnswer UrController::powerOn() {
  if (!connected_) return {false, kDriverGone};
  if (!isSafe()) return failed("power on", std::string("safety mode ") + toString(safety_mode_));
  if (robot_mode_ == RobotMode::kPowerOff) {
    robot_mode_ = RobotMode::kPowerOn;
    releases_brakes_ = false;
    next_mode_s_ = now_s_ + config_.power_on_s;
  }
  return {true, "Powering on"};
}

CommandAnswer UrController::powerOff() {
  if (!connected_) return {false, kDriverGone};
  losePower("robot powered off");
  return {true, "Powering off"};
}

CommandAnswer UrController::brakeRelease() {
  if (!connected_) return {false, kDriverGone};
  if (!isSafe()) return failed("brake release", std::string("safety mode ") + toString(safety_mode_));
  powerOn();
  if (robot_mode_ == RobotMode::kIdle && !releases_brakes_) {
    next_mode_s_ = now_s_ + config_.brake_release_s;
  }
  releases_brakes_ = true;
  return {true, "Brake releasing"};
}

CommandAnswer UrController::play() {
  if (!connected_) return {false, kDriverGone};
  if (!canRunProgram()) {
    return failed("play",
                  std::string("robot mode ") + toString(robot_mode_) + ", safety mode " + toString(safety_mode_));
  }
  if (program_running_) {
    program_state_ = ProgramState::kPlaying;
  } else {
    startProgram();
  }
  return {true, "Starting program"};
}

CommandAnswer UrController::pause() {
  if (!connected_) return {false, kDriverGone};
  if (program_state_ != ProgramState::kPlaying) return failed("pause", "no program is playing");
  program_state_ = ProgramState::kPaused;
  return {true, "Pausing program"};
}

CommandAnswer UrController::stop() {
  if (!connected_) return {false, kDriverGone};
  if (program_state_ == ProgramState::kStopped) return failed("stop", "no program is playing");
  endProgram(ProgramState::kStopped, "robot program stopped");
  return {true, "Stopped"};
}

CommandAnswer UrController::unlockProtectiveStop() {
  if (!connected_) return {false, kDriverGone};
  if (safety_mode_ != SafetyMode::kProtectiveStop) {
    return failed("unlock protective stop", std::string("safety mode ") + toString(safety_mode_));
  }
  if (now_s_ - protective_stop_s_ < config_.unlock_delay_s) {
    std::ostringstream text;
    text << "Cannot unlock protective stop until " << config_.unlock_delay_s
         << "s after occurrence. Always inspect cause of protective stop before unlocking";
    return {false, text.str()};
  }
  safety_mode_ = SafetyMode::kNormal;
  return {true, "Protective stop releasing"};
}

CommandAnswer UrController::restartSafety() {
  if (!connected_) return {false, kDriverGone};
  if (safety_mode_ == SafetyMode::kViolation || safety_mode_ == SafetyMode::kFault) {
    safety_mode_ = SafetyMode::kNormal;
  }
  losePower("safety restarted");
  return {true, "Restarting safety"};
}

CommandAnswer UrController::closePopup() const {
  return connected_ ? CommandAnswer{true, "closing popup"} : CommandAnswer{false, kDriverGone};
}

CommandAnswer UrController::closeSafetyPopup() const {
  return connected_ ? CommandAnswer{true, "closing safety popup"} : CommandAnswer{false, kDriverGone};
}

CommandAnswer UrController::loadProgram(const std::string& name) {
  if (!connected_) return {false, kDriverGone};
  if (name != config_.program) return {false, "File not found: " + name};
  if (program_state_ != ProgramState::kStopped) return failed("load", "a program is playing");
  loaded_program_ = name;
  return {true, "Loading program: " + name};
}

CommandAnswer UrController::resendRobotProgram() {
  if (!connected_) return {false, kDriverGone};
  if (!config_.headless_mode) return {false, "The robot program can be sent in headless mode only"};
  if (program_state_ != ProgramState::kStopped) {
    endProgram(ProgramState::kStopped, "robot program sent again");
  }
  if (canRunProgram()) {
    startProgram();
  }
  return {true, "Robot program sent"};
}

CommandAnswer UrController::handBackControl() {
  if (!connected_) return {false, kDriverGone};
  if (program_running_) {
    endProgram(ProgramState::kStopped, "control handed back to the robot");
  }
  return {true, "Control handed back to the robot"};
}

CommandAnswer UrController::setSpeedSlider(double fraction) {
  if (!connected_) return {false, kDriverGone};
  if (!(fraction >= 0.01 && fraction <= 1.0)) {
    return {false, "speed_slider_fraction = " + std::to_string(fraction) + ", must be in [0.01, 1]"};
  }
  speed_slider_ = fraction;
  return {true, {}};
}

CommandAnswer UrController::setIo(int function, int pin, double state) {
  if (!connected_) return {false, kDriverGone};
  if (refuses_io_) return {false, "the robot refuses to set outputs"};
  const auto refuse = [](const char* what, double value, const char* allowed) {
    std::ostringstream text;
    text << what << " = " << value << ", must be " << allowed;
    return CommandAnswer{false, text.str()};
  };
  switch (function) {
    case kSetDigitalOut:
      if (pin < 0 || pin >= static_cast<int>(UrIo::kDigitalPins)) return refuse("pin", pin, "in [0, 17]");
      if (state != 0.0 && state != 1.0) return refuse("state", state, "0 or 1");
      io_.digital_out[static_cast<std::size_t>(pin)] = state == 1.0;
      return {true, {}};
    case kSetAnalogOut:
      if (pin < 0 || pin >= static_cast<int>(UrIo::kAnalogPins)) return refuse("pin", pin, "0 or 1");
      if (!(state >= 0.0 && state <= 1.0)) return refuse("state", state, "in [0, 1]");
      io_.analog_out[static_cast<std::size_t>(pin)] = state;
      return {true, {}};
    case kSetToolVoltage:
      if (state != 0.0 && state != 12.0 && state != 24.0) return refuse("state", state, "0, 12 or 24 V");
      io_.tool_voltage_V = static_cast<int>(state);
      return {true, {}};
    default:
      return refuse("fun", function, "1, 3 or 4; the driver supports no other (flags are 2)");
  }
}

CommandAnswer UrController::setPayload(const UrPayload& payload) {
  if (!connected_) return {false, kDriverGone};
  if (!(payload.mass_kg >= 0.0 && payload.mass_kg <= config_.max_payload_kg) ||
      !payload.center_of_gravity_m.allFinite()) {
    std::ostringstream text;
    text << "mass = " << payload.mass_kg << " kg, must be in [0, " << config_.max_payload_kg
         << "] kg, with a finite center_of_gravity";
    return {false, text.str()};
  }
  payload_ = payload;
  return {true, {}};
}

CommandAnswer UrController::zeroFtSensor() {
  if (!connected_) return {false, kDriverGone};
  if (!config_.remote_control) return {false, "The robot is not in remote control"};
  ft_sensor_zeroed_ = true;
  return {true, "Force-torque sensor zeroed"};
}

GoalAnswer UrController::acceptGoal(const TrajectoryGoal& goal) {
  if (!connected_ || !program_running_) {
    return {false, GoalError::kInvalidGoal, "Can't accept new action goals. Controller is not running."};
  }
  return follower_.acceptGoal(goal, now_s_);
}

void UrController::protectiveStop(const std::string& reason) {
  if (robot_mode_ != RobotMode::kRunning || !isSafe()) return;
  safety_mode_ = SafetyMode::kProtectiveStop;
  protective_stop_s_ = now_s_;
  endProgram(program_state_ == ProgramState::kStopped ? ProgramState::kStopped : ProgramState::kPaused,
             "protective stop: " + reason);
}

void UrController::emergencyStop() {
  safety_mode_ = SafetyMode::kRobotEmergencyStop;
  losePower("emergency stop");
}

void UrController::releaseEmergencyStop() {
  if (safety_mode_ == SafetyMode::kRobotEmergencyStop) {
    safety_mode_ = SafetyMode::kNormal;
  }
}

void UrController::safetyFault(SafetyMode mode) {
  if (mode != SafetyMode::kViolation && mode != SafetyMode::kFault) {
    throw std::invalid_argument(std::string("UrController: safety fault = ") + toString(mode) +
                                ", must be VIOLATION or FAULT");
  }
  safety_mode_ = mode;
  losePower(std::string("safety mode ") + toString(mode));
}

void UrController::setInternalSpeedFactor(double factor) {
  requireFraction("internal speed factor", factor);
  internal_speed_factor_ = factor;
}

void UrController::setDriverConnected(bool connected) {
  if (connected_ && !connected) {
    endProgram(ProgramState::kStopped, kDriverGone);
  }
  connected_ = connected;
}

bool UrController::takeFtSensorZeroed() {
  const bool zeroed = ft_sensor_zeroed_;
  ft_sensor_zeroed_ = false;
  return zeroed;
}

void UrController::startProgram() {
  program_state_ = ProgramState::kPlaying;
  program_running_ = true;
  follower_.restart();
}

void UrController::endProgram(ProgramState state, const std::string& reason) {
  program_state_ = state;
  speed_scaling_ = 0.0;
  if (program_running_) {
    program_running_ = false;
    follower_.halt(reason);
  }
}

void UrController::losePower(const std::string& reason) {
  endProgram(ProgramState::kStopped, reason);
  robot_mode_ = RobotMode::kPowerOff;
}

void UrController::advanceMode(double now_s) {
  if (robot_mode_ == RobotMode::kPowerOn && now_s >= next_mode_s_) {
    robot_mode_ = RobotMode::kIdle;
    next_mode_s_ += config_.brake_release_s;
  }
  if (robot_mode_ == RobotMode::kIdle && releases_brakes_ && now_s >= next_mode_s_) {
    robot_mode_ = RobotMode::kRunning;
  }
}

void UrController::advanceSpeedScaling(double dt_s) {
  const bool plays = program_running_ && program_state_ == ProgramState::kPlaying;
  const double target = plays ? speed_slider_ * internal_speed_factor_ : 0.0;
  const double step = config_.speed_ramp_s > 0.0 ? dt_s / config_.speed_ramp_s : 1.0;
  speed_scaling_ += std::clamp(target - speed_scaling_, -step, step);
}

}  // namespace simulated_world
