// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "simulated_world/trajectory_follower.h"
#include "simulated_world/ur_modes.h"

namespace simulated_world {

struct UrControllerConfig {
  TrajectoryFollowerConfig follower;
  bool headless_mode = false;  ///< the driver sends its program; else it must be played
  bool remote_control = true;
  std::string program = "external_control.urp";  ///< the one that can be loaded and is loaded at the start
  double unlock_delay_s = 5.0;                   ///< from a protective stop until it may be unlocked
  double power_on_s = 2.0;                       ///< POWER_OFF to IDLE; varies from robot to robot
  double brake_release_s = 1.0;                  ///< IDLE to RUNNING; varies from robot to robot
  double speed_ramp_s = 0.2;                     ///< the speed scaling's way from 0 to 1
  double max_payload_kg = 5.0;                   ///< UR5e

  /// One line per impossible value; empty: valid.
  std::vector<std::string> validate() const;
};

/// What the dashboard server or a service of the driver answers.
struct CommandAnswer {
  bool success = false;
  std::string text;
};

/// Digital pins: 0 to 7 standard, 8 to 15 configurable, 16 and 17 at the tool.
struct UrIo {
  static constexpr std::size_t kDigitalPins = 18;
  static constexpr std::size_t kAnalogPins = 2;
  std::array<bool, kDigitalPins> digital_in{};
  std::array<bool, kDigitalPins> digital_out{};
  std::array<double, kAnalogPins> analog_in_V{};
  std::array<double, kAnalogPins> analog_out{};  ///< share of full scale, [0, 1]
  int tool_voltage_V = 0;
};

struct UrPayload {
  double mass_kg = 0.0;
  Eigen::Vector3d center_of_gravity_m = Eigen::Vector3d::Zero();  ///< in the tool flange
};

/// A UR robot as seen through ur_robot_driver with its scaled_pos_joint_traj_controller: modes, program, dashboard,
/// inputs and outputs, and trajectories. No threads and no clock: time is what update() is told. Commands act at the
/// time of the last update. The arm is stiff: update() returns a setpoint for its servos, to be followed always.
///
/// Starts powered off, as a robot does: powerOn, brakeRelease, then play or (headless) resendRobotProgram; the modes
/// follow in the course of updates.
class UrController {
 public:
  /// `joints` in kinematic order. Throws std::invalid_argument listing everything that is impossible.
  UrController(std::vector<JointLimits> joints, const UrControllerConfig& config);

  /// Advances to now_s, by dt_s > 0. Returns the setpoint in the order of the joints.
  const JointMotion& update(double now_s, double dt_s, const Eigen::VectorXd& measured_rad,
                            const Eigen::VectorXd& measured_rad_s);

  // Dashboard.
  CommandAnswer powerOn();
  CommandAnswer powerOff();
  CommandAnswer brakeRelease();  ///< powers on as well
  CommandAnswer play();
  CommandAnswer pause();
  CommandAnswer stop();
  CommandAnswer unlockProtectiveStop();
  CommandAnswer restartSafety();
  CommandAnswer closePopup() const;
  CommandAnswer closeSafetyPopup() const;
  CommandAnswer loadProgram(const std::string& name);

  // Services of the driver.
  CommandAnswer resendRobotProgram();  ///< true: sent; whether it runs is to be seen from robotProgramRunning()
  CommandAnswer handBackControl();
  CommandAnswer setSpeedSlider(double fraction);
  CommandAnswer setIo(int function, int pin, double state);  ///< values of ur_msgs/SetIO
  CommandAnswer setPayload(const UrPayload& payload);
  CommandAnswer zeroFtSensor();

  /// Voltage of a sensor at an analog input. Throws std::out_of_range unless pin is 0 or 1.
  void setAnalogIn(std::size_t pin, double voltage_V) { io_.analog_in_V.at(pin) = voltage_V; }

  // The controller's trajectories.
  GoalAnswer acceptGoal(const TrajectoryGoal& goal);
  bool cancelGoal(const std::string& goal_id) { return follower_.cancelGoal(goal_id); }
  std::vector<GoalResult> takeResults() { return follower_.takeResults(); }
  const TrajectoryFollower& follower() const { return follower_; }

  // What happens to the robot.
  void protectiveStop(const std::string& reason);
  void emergencyStop();
  void releaseEmergencyStop();  ///< ends in POWER_OFF
  /// VIOLATION or FAULT, mended by restartSafety(); others throw std::invalid_argument.
  void safetyFault(SafetyMode mode);
  /// How far the robot slows itself down, [0, 1].
  void setInternalSpeedFactor(double factor);
  /// false: every command is refused and the program ends. After true it has to be started again.
  void setDriverConnected(bool connected);
  /// true: setIo() is refused.
  void setRefusesIo(bool refuses) { refuses_io_ = refuses; }

  RobotMode robotMode() const { return robot_mode_; }
  SafetyMode safetyMode() const { return safety_mode_; }
  ProgramState programState() const { return program_state_; }
  /// Whether the robot takes commands from the driver; stays true while paused.
  bool robotProgramRunning() const { return program_running_; }
  bool driverConnected() const { return connected_; }
  bool isInRemoteControl() const { return config_.remote_control; }
  const std::string& loadedProgram() const { return loaded_program_; }
  /// Slider times internal factor, with ramps; 0 while paused or stopped.
  double speedScaling() const { return speed_scaling_; }
  const UrIo& io() const { return io_; }
  const UrPayload& payload() const { return payload_; }
  /// Whether zeroing the force-torque sensor was asked for since the last call.
  bool takeFtSensorZeroed();
  const UrControllerConfig& config() const { return config_; }

 private:
  bool isSafe() const { return safety_mode_ == SafetyMode::kNormal || safety_mode_ == SafetyMode::kReduced; }
  bool canRunProgram() const { return connected_ && robot_mode_ == RobotMode::kRunning && isSafe(); }
  void startProgram();
  void endProgram(ProgramState state, const std::string& reason);
  void losePower(const std::string& reason);
  void advanceMode(double now_s);
  void advanceSpeedScaling(double dt_s);

  UrControllerConfig config_;
  TrajectoryFollower follower_;
  double now_s_ = 0.0;
  bool connected_ = true;
  bool refuses_io_ = false;
  RobotMode robot_mode_ = RobotMode::kPowerOff;
  bool releases_brakes_ = false;  ///< once the joints are powered
  double next_mode_s_ = 0.0;      ///< when robot_mode_ takes its next step
  SafetyMode safety_mode_ = SafetyMode::kNormal;
  double protective_stop_s_ = 0.0;
  ProgramState program_state_ = ProgramState::kStopped;
  bool program_running_ = false;
  std::string loaded_program_;
  double speed_slider_ = 1.0;
  double internal_speed_factor_ = 1.0;
  double speed_scaling_ = 0.0;
  UrIo io_;
  UrPayload payload_;
  bool ft_sensor_zeroed_ = false;
};

}  // namespace simulated_world
