// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "motion_planning/arm_kinematics.h"
#include "ur_driver_bridge/arm_call.h"
#include "ur_driver_bridge/contact_detector.h"
#include "ur_driver_bridge/load_cell.h"
#include "ur_driver_bridge/recovery.h"
#include "ur_driver_bridge/safety_gate.h"

namespace ur_driver_bridge {

struct MotionConfig {
  double start_tolerance_rad{0.02};
  double acceleration_rad_s2{4.0};  // of what is sent; a controlled stop may be harder
  double stop_s{0.1};               // a controlled stop takes so long, on the path
  double latency_s{0.005};          // from the controller's state until what is answered takes effect
  double rest_rad_s{0.01};          // slower than this the arm stands
  double rest_timeout_s{3.0};       // after a stop
  double answer_timeout_s{1.0};     // of the controller and the monitor
  double end_patience_s{2.0};       // beyond the trajectory's own time (that passes slower when the speed is scaled)
  double stall_speed{0.01};         // speed scaling below this ...
  double stall_patience_s{10.0};    // ... for longer: given up
  double watch_drift_s{0.2};        // the monitor is told anew when the arm is so far behind what it believes

  std::vector<std::string> validate() const;
};

struct PickConfig {
  double settle_s{0.2};         // at rest before the force sensor is zeroed or read
  double early_m{0.02};         // contact so far before the plate is with something else
  double contact_stop_s{0.04};  // stop at contact
  double magnet_settle_s{0.3};  // from the switch until it holds, or has let go
  double weigh_height_m{0.03};  // lifted so far to be weighed
  double weigh_timeout_s{3.0};  // for a force that does not come to rest
  double ramp_s{0.3};           // of the stop before weighing and the start after it

  std::vector<std::string> validate() const;
};

struct ExecutorConfig {
  SafetyGateConfig gate;
  MotionConfig motion;
  PickConfig pick;
  ContactDetectorConfig contact;
  LoadCellConfig load;
  RecoveryConfig recovery;
  int magnet_pin{0};         // digital output
  double io_timeout_s{1.0};  // until the driver tells that the output has changed

  std::vector<std::string> validate() const;
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

enum class ExecutorPhase { kIdle, kStarting, kMoving, kStopping, kActing, kRecovering };

struct ExecutorOutput {
  std::vector<ArmCall> calls;  // in this order
  std::optional<Finished> finished;
};

/// Carries out one request at a time on the arm: a motion, a pick, letting go, a recovery. A state machine without threads
/// or clock: step() is called with each joint state, or at once when a reply has come, and says what to do. Every motion is
/// checked, watched by the path monitor and ends in a controlled stop on its own path when the gate closes; the magnet
/// stays on through all of that while a brick is held.
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

  const ExecutorConfig& config() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ur_driver_bridge
