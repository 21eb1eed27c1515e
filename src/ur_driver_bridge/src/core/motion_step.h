// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>

#include "step.h"

namespace ur_driver_bridge {

/// `trajectory` from where the arm is, a little off its first point: the difference fades within `ramp_s`. Velocity is
/// continuous. A trajectory shorter than the ramp is slowed down until it is as long. Throws std::invalid_argument for an
/// empty trajectory or a ramp <= 0.
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
  /// What the end of the trajectory means, once the arm stands there.
  virtual Verdict atEnd(StepContext&) { return {}; }
  virtual bool needsForce() const { return false; }
  /// look() is asked for so long after the end.
  virtual double lookOn(const StepContext&) const { return 0.0; }
  /// When the arm stands again, however the motion has ended.
  virtual void atRest(StepContext&) {}
  /// What it means that the arm has not come to rest although the robot is fine.
  virtual Verdict atUnrest() const { return {ArmStatus::kNotReady, "the arm has not come to rest"}; }
  /// Also an arm that has not come to rest moves.
  virtual bool endsUnrest() const { return false; }

  const JointTrajectory& trajectory() const { return trajectory_; }
  double place() const { return at_s_; }  // on the trajectory

 private:
  enum class State { kBegin, kWatching, kSending, kMoving, kStopping, kResting };

  Verdict begin(StepContext& context, bool may_wait);
  bool hasRested(const StepContext& context);
  void watch(StepContext& context, double start_s);
  std::optional<Verdict> onWatchReply(StepContext& context);
  std::optional<Verdict> checkGate(const StepContext& context) const;
  std::optional<Verdict> followEvents(const StepContext& context);
  void locate(const StepContext& context);
  std::optional<Verdict> reasonToStop(StepContext& context);
  void follow(StepContext& context);
  void stop(StepContext& context, const Verdict& verdict, double stop_s);
  void rest(const StepContext& context, const Verdict& verdict);
  void followStop(StepContext& context);
  bool isWaitingForRest(const StepContext& context);
  /// What the robot tells that is not verdict_ itself, and may be its cause; fine: nothing.
  Verdict causeOf(const StepContext& context) const;
  std::optional<Verdict> finish(StepContext& context);

  WatchPhase watch_phase_;
  Make make_;
  JointTrajectory trajectory_;
  State state_{State::kBegin};
  Verdict verdict_;  // how it will end, once it stops

  std::uint64_t watch_call_{0};  // open; 0: none
  std::uint64_t send_call_{0};   // of the trajectory that the controller follows or is to follow
  std::optional<std::uint32_t> watch_id_;
  double watch_since_s_{0.0};  // ROS time
  double watch_start_s_{0.0};  // ROS time
  double watch_asked_s_{0.0};
  std::optional<double> begun_s_;
  std::optional<double> rest_since_s_;
  double asked_s_{0.0};        // when the call was made that is waited for
  bool has_succeeded_{false};  // the controller has come to the trajectory's end
  bool is_braking_{false};     // send_call_ is of a stop
  bool is_taken_{false};       // the controller has accepted send_call_
  double at_s_{0.0};           // on the trajectory
  double elapsed_s_{0.0};      // trajectory time that has passed by the speed scaling
  std::optional<double> stalled_since_s_;
};

/// Until the magnet meets something, or to the trajectory's end.
class TouchStep : public MotionStep {
 public:
  /// As it was carried out, and where on it the arm stands.
  struct Touched {
    JointTrajectory trajectory;
    double at_s{0.0};
    std::string no_contact;  // why there was none, if so; the magnet may hold a plate all the same
  };

  TouchStep(Make make, double expected_travel_m, Touched* touched);

 protected:
  std::optional<Ending> look(StepContext& context) override;
  Verdict atEnd(StepContext& context) override;
  bool needsForce() const override { return true; }
  double lookOn(const StepContext& context) const override { return context.config.contact.debounce_s; }
  void atRest(StepContext&) override {
    touched_->trajectory = trajectory();
    touched_->at_s = place();
  }
  Verdict atUnrest() const override {
    return {ArmStatus::kNotAttached, "the arm has not come to rest: what the magnet touches moves under it"};
  }

 private:
  double travel(const StepContext& context) const;

  double expected_travel_m_;
  Touched* touched_;
  std::optional<ContactDetector> detector_;
};

/// Away from what the magnet touches. What rocks under the magnet would keep the arm from rest as long as it stays there.
class RetreatStep : public MotionStep {
 public:
  explicit RetreatStep(Make make) : MotionStep("retreat", WatchPhase::kContact, std::move(make)) {}

 protected:
  bool endsUnrest() const override { return true; }
};

/// With a brick. Once that is weighed, until it takes another along.
class LiftStep : public MotionStep {
 public:
  /// As it was carried out, and where on it the arm stands.
  struct Lifted {
    JointTrajectory trajectory;
    double at_s{0.0};
  };

  LiftStep(const char* stage, Make make, double brick_mass_kg, std::shared_ptr<Lifted> lifted);

 protected:
  std::optional<Ending> look(StepContext& context) override;
  void atRest(StepContext&) override { *lifted_ = {trajectory(), place()}; }

 private:
  double brick_mass_kg_;
  std::shared_ptr<Lifted> lifted_;
};

/// Down again with what hangs on the magnet, to where it came from.
class PutBackStep : public MotionStep {
 public:
  explicit PutBackStep(Make make) : MotionStep("put_back", WatchPhase::kLift, std::move(make)) {}

 protected:
  std::optional<Ending> look(StepContext& context) override;
};

}  // namespace ur_driver_bridge
