// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include <Eigen/Core>

#include "motion_planning/arm_kinematics.h"

namespace ur_driver_bridge {

using motion_planning::ArmVector;  // joint angles [rad], base to tool

constexpr double kGone_s = 1.0;       // joint states this old are not late: nobody sends them any more
constexpr double kRounding_s = 1e-6;  // of differences of ROS times, which have 2e-7 s as doubles

/// Of ur_dashboard_msgs/RobotMode and SafetyMode; controllers may report values that are not named here.
namespace robot_mode {
constexpr int kNoController = -1, kDisconnected = 0, kConfirmSafety = 1, kBooting = 2, kPowerOff = 3, kPowerOn = 4,
              kIdle = 5, kBackdrive = 6, kRunning = 7, kUpdatingFirmware = 8;
}  // namespace robot_mode
namespace safety_mode {
constexpr int kNormal = 1, kReduced = 2, kProtectiveStop = 3, kRecovery = 4, kSafeguardStop = 5,
              kSystemEmergencyStop = 6, kRobotEmergencyStop = 7, kViolation = 8, kFault = 9, kValidateJointId = 10,
              kUndefined = 11, kAutomaticModeSafeguardStop = 12, kThreePositionEnablingStop = 13;
}  // namespace safety_mode

template <typename Value>
struct Stamped {
  double stamp_s{0.0};  // ROS time
  Value value{};
};

struct JointState {
  ArmVector position_rad{ArmVector::Zero()};
  ArmVector velocity_rad_s{ArmVector::Zero()};
};

/// What the surroundings exert on the tool, as the robot reports it. It is without the weight of tool and declared
/// payload, relative to its value when the sensor was zeroed. Axes of the tool flange (z out of the tool).
struct ToolForce {
  Eigen::Vector3d force_N{Eigen::Vector3d::Zero()};
  Eigen::Vector3d torque_Nm{Eigen::Vector3d::Zero()};
};

struct GripperState {
  bool is_on{false};               // told to hold
  std::optional<bool> is_holding;  // nothing: no sensor tells
};

/// What the arm's driver has told last. Nothing: never heard. Modes and program_running come on change only, so they have
/// no age: joint states tell whether the driver lives.
struct ArmState {
  std::optional<Stamped<JointState>> joints;
  std::optional<Stamped<ArmVector>> commanded_rad;  // where the controller wants the arm to be; not all drivers tell
  std::optional<Stamped<ToolForce>> force;
  std::optional<Stamped<double>> speed_scaling;  // [0, 1]: slider times the robot's own; 0 while paused
  std::optional<Stamped<GripperState>> gripper;
  std::optional<int> robot_mode;
  std::optional<int> safety_mode;
  std::optional<bool> is_program_running;  // takes commands
  bool is_controller_there{false};         // somebody serves follow_joint_trajectory
};

}  // namespace ur_driver_bridge
