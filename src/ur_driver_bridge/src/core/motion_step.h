// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>

#include "step.h"

namespace ur_driver_bridge {

/// `trajectory` from where the arm is, at most a start's tolerance off its first point: the difference fades within `ramp_s`.
/// Velocity is continuous. Throws std::invalid_argument for an empty trajectory or a ramp <= 0.
JointTrajectory joined(const JointTrajectory& trajectory, const ArmVector& from_rad, double ramp_s);

/// Checks, watches, sends and follows one trajectory to its end, or to a controlled stop.
class MotionStep : public Step {
 public:
  /// Made when the step begins: some depend on where the step before has ended.
  using Make = std::function<JointTrajectory()>;

  MotionStep(std::string stage, WatchPhase watch, Make make);

  std::optional<Verdict> advance(StepContext& context) override;
  ExecutorPhase phase() const override;
  double progress() const override;

 protected:
  /// Something other than the gate that ends the motion, looked for after each joint state while it moves. The verdict may
  /// be success: then the arm stops within `stop_s`.
  struct Ending {
    Verdict verdict;
    double stop_s;
  };
  virtual std::optional<Ending> look(StepContext&) { return std::nullopt; }
  /// What the end of the trajectory means.
  virtual Verdict atEnd(StepContext&) { return {}; }
  virtual bool needsForce() const { return false; }
  /// When the arm stands again after look() has ended the motion.
  virtual void atRest(StepContext&) {}

  const JointTrajectory& trajectory() const { return trajectory_; }

 private:
  enum class State { kBegin, kWatching, kSending, kMoving, kStopping, kResting };

  Verdict begin(StepContext& context, bool may_wait);
  bool hasRested(const StepContext& context);
  void watch(StepContext& context, double start_s);
  std::optional<Verdict> onWatchReply(StepContext& context);
  std::optional<Verdict> checkGate(const StepContext& context) const;
  std::optional<Verdict> followEvents(StepContext& context, bool* has_ended);
  void follow(StepContext& context);
  void stop(StepContext& context, const Verdict& verdict, double stop_s);
  void rest(const StepContext& context, const Verdict& verdict);
  std::optional<Verdict> finish(StepContext& context);

  WatchPhase watch_phase_;
  Make make_;
  JointTrajectory trajectory_;
  State state_{State::kBegin};
  Verdict verdict_;  // how it will end, once it stops

  std::uint64_t watch_call_{0};  // open; 0: none
  std::uint64_t send_call_{0};   // of the trajectory that the controller follows or is to follow
  std::optional<std::uint32_t> watch_id_;
  double watch_since_s_{0.0};
  double watch_start_s_{0.0};
  double asked_s_{0.0};    // when the call was made that is waited for
  double at_s_{0.0};       // on the trajectory
  double elapsed_s_{0.0};  // trajectory time that has passed by the speed scaling
  std::optional<double> stalled_since_s_;
  std::optional<double> begun_s_;
  std::optional<double> rest_since_s_;
};

/// Until the magnet meets something.
class TouchStep : public MotionStep {
 public:
  TouchStep(Make make, double expected_travel_m, double* ended_at_s);

 protected:
  std::optional<Ending> look(StepContext& context) override;
  Verdict atEnd(StepContext& context) override;
  bool needsForce() const override { return true; }

 private:
  double travel(const StepContext& context) const;

  double expected_travel_m_;
  double* ended_at_s_;  // on the touch's trajectory
  std::optional<ContactDetector> detector_;
};

}  // namespace ur_driver_bridge
