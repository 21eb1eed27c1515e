// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <interactive_mapping_enums/arm_bridge_state.h>

#include "motion_planning/arm_kinematics.h"
#include "ur_driver_bridge/arm_call.h"
#include "ur_driver_bridge/contact_detector.h"
#include "ur_driver_bridge/load_cell.h"
#include "ur_driver_bridge/recovery.h"
#include "ur_driver_bridge/safety_gate.h"

namespace ur_driver_bridge {

struct MotionConfig {
  double start_tolerance_rad{0.02};
  double acceleration_rad_s2{4.0};
  double stop_s{0.1};
  double latency_s{0.005};
  double rest_rad_s{0.01};
  double rest_timeout_s{3.0};
  double answer_timeout_s{1.0};
  double end_patience_s{2.0};
  double stall_speed{0.01};
  double stall_patience_s{10.0};
  double watch_drift_s{0.2};

  static void fields(MotionConfig& c, interactive_mapping::Fields& f) {
    f("start_tolerance_rad", c.start_tolerance_rad, 1e-4, 0.2, "rad",
      "distance of each joint from the trajectory's first point");
    f("acceleration_rad_s2", c.acceleration_rad_s2, 0.1, 50.0, "rad/s^2",
      "limit of a trajectory that is accepted; a controlled stop may be harder");
    f("stop_s", c.stop_s, 0.02, 1.0, "s", "duration of a controlled stop, on the path");
    f("latency_s", c.latency_s, 0.0, 0.1, "s", "time from the controller's state until an answer to it takes effect");
    f("rest_rad_s", c.rest_rad_s, 1e-4, 0.1, "rad/s", "an arm slower than this is at rest");
    f("rest_timeout_s", c.rest_timeout_s, 0.5, 30.0, "s", "time to come to rest after a stop");
    f("answer_timeout_s", c.answer_timeout_s, 0.05, 10.0, "s",
      "time for an answer of controller, services and monitor");
    f("end_patience_s", c.end_patience_s, 0.5, 60.0, "s",
      "time beyond the trajectory's own, which passes slower when the speed is scaled");
    f("stall_speed", c.stall_speed, 1e-4, 0.5, "", "speed scaling below which the arm is stalled");
    f("stall_patience_s", c.stall_patience_s, 0.5, 600.0, "s", "a motion is given up when it is stalled for longer");
    f("watch_drift_s", c.watch_drift_s, 0.05, 5.0, "s",
      "the monitor is informed again when the arm is this far behind what the monitor assumes");
  }
};

struct PickConfig {
  double settle_s{0.2};
  double early_m{0.02};
  double contact_stop_s{0.04};
  double magnet_settle_s{0.3};
  double weigh_height_m{0.03};
  double weigh_timeout_s{3.0};
  double ramp_s{0.3};

  static void fields(PickConfig& c, interactive_mapping::Fields& f) {
    f("settle_s", c.settle_s, 0.0, 5.0, "s", "time at rest before the force sensor is zeroed or read");
    f("early_m", c.early_m, 1e-3, 0.2, "m", "contact this far before the plate is with something else");
    f("contact_stop_s", c.contact_stop_s, 0.01, 0.5, "s", "duration of the stop at contact");
    f("magnet_settle_s", c.magnet_settle_s, 0.0, 5.0, "s",
      "time from the switch until the magnet holds, or has let go");
    f("weigh_height_m", c.weigh_height_m, 2e-3, 0.3, "m", "height to which the brick is lifted to be weighed");
    f("weigh_timeout_s", c.weigh_timeout_s, 0.5, 30.0, "s", "time for the force to come to rest");
    f("ramp_s", c.ramp_s, 0.02, 2.0, "s", "duration of the stop before weighing and of the start after it");
  }
};

struct GripperConfig {
  std::string type{"ur_driver_bridge/Magnet"};
  double io_timeout_s{1.0};

  static void fields(GripperConfig& c, interactive_mapping::Fields& f) {
    f("type", c.type,
      "plugin: ur_driver_bridge/Magnet, ur_driver_bridge/Vacuum or yours; its own parameters are in the section own");
    f("io_timeout_s", c.io_timeout_s, 0.1, 10.0, "s",
      "time for the gripper to report that it is switched, and holds if it can tell");
  }
};

struct ExecutorConfig {
  SafetyGateConfig gate;
  MotionConfig motion;
  ContactDetectorConfig contact;
  PickConfig pick;
  LoadCellConfig load;
  GripperConfig gripper;
  RecoveryConfig recovery;

  static void fields(ExecutorConfig& c, interactive_mapping::Fields& f) {
    f.section("gate", c.gate);
    f.section("motion", c.motion);
    f.section("contact", c.contact);
    f.section("pick", c.pick);
    f.section("load", c.load);
    f.section("gripper", c.gripper, "own/digital_output, ...: config/vacuum.yaml");
    f.section("recovery", c.recovery);
  }
};

/// What is fixed about this robot.
struct ArmModel {
  std::shared_ptr<const motion_planning::ArmKinematics> kinematics;
  TrajectoryLimits limits;  // of position and velocity; acceleration is MotionConfig's
  Payload tool;             // hangs on the flange without a brick
  double max_payload_kg{5.0};
};

struct PickRequest {
  double brick_mass_kg{0.0};
  Eigen::Isometry3d T_tip_brick{Eigen::Isometry3d::Identity()};  // once it is attached
  double contact_travel_m{0.0};                                  // of the tip along `touch`, until it meets the plate
  JointTrajectory approach;
  JointTrajectory touch;
  JointTrajectory lift;
  JointTrajectory stow;  // may be empty
  bool lets_go{false};
};

struct PickFigures {
  double contact_travel_m{std::numeric_limits<double>::quiet_NaN()};
  double contact_force_N{std::numeric_limits<double>::quiet_NaN()};
  double load_kg{std::numeric_limits<double>::quiet_NaN()};
};

struct ExecutorInputs {
  GateInputs gate;
  std::vector<CallReply> replies;
  std::vector<TrajectoryEvent> events;
};

struct Finished {
  Verdict verdict;
  std::string stage;
  PickFigures figures;
  std::vector<std::string> recovery_commands;
};

using interactive_mapping::ExecutorPhase;

struct ExecutorOutput {
  std::vector<ArmCall> calls;  // in this order
  std::optional<Finished> finished;
};

/// Carries out one request at a time on the arm: a motion, a pick, letting go, a recovery. A state machine without
/// threads or clock. step() is called with each joint state, or at once when a reply has come, and says what to do.
/// Every motion is checked and watched by the path monitor. It ends in a controlled stop on its own path when the gate
/// closes. The magnet stays on through all of that while a brick is held.
class Executor {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  Executor(const ExecutorConfig& config, const ArmModel& model);
  ~Executor();

  /// Takes effect with the next step. Throws std::logic_error unless idle, std::invalid_argument for a pick that makes no
  /// sense. A pick while a brick is held: std::logic_error, too. letGo() without a brick ends with kNothingHeld if the
  /// magnet is known to be off.
  void move(const JointTrajectory& trajectory);
  void pick(const PickRequest& request);
  void letGo();
  void recover(const RecoveryPermit& permit);

  /// The request ends with `verdict` after a controlled stop. Nothing without a request.
  void stop(const Verdict& verdict);

  ExecutorOutput step(const ExecutorInputs& inputs);

  bool isIdle() const;
  ExecutorPhase phase() const;
  std::string stage() const;           // "approach", "touch", ...; empty when idle
  double progress() const;             // of the stage's trajectory
  bool isHolding() const;              // the magnet is on and a brick is taken to hang there
  bool isWaitingForReply() const;      // a call is open, and nothing else goes on: for lock step
  std::optional<double> load() const;  // beside the declared payload [kg]
  Verdict gate() const;                // whether a motion could begin, as of the last step

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ur_driver_bridge
