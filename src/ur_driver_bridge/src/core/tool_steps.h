// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>

#include "step.h"

namespace ur_driver_bridge {

/// What may keep a call from being made. Once made it is always waited for.
enum class Duty {
  kIfGateIsOpen,  // nor when told to stop
  kUnlessStopped,
  kAlways,  // it ends what has been begun
};

/// One call, its answer, and what must be seen of its effect.
class CallStep : public Step {
 public:
  CallStep(std::string stage, Duty duty) : Step(std::move(stage)), duty_(duty) {}
  std::optional<Verdict> advance(StepContext& context) final;

 protected:
  /// Before the call, again and again until success; nothing: not yet.
  virtual std::optional<Verdict> prepare(StepContext&) { return Verdict{}; }
  virtual std::uint64_t makeCall(StepContext& context) = 0;
  virtual const char* what() const = 0;  // for messages
  /// After the answer, until the effect is there or it is too late.
  virtual std::optional<Verdict> awaitEffect(StepContext&) { return Verdict{}; }

 private:
  Duty duty_;
  std::uint64_t call_{0};
  double asked_s_{0.0};
  bool is_answered_{false};
};

/// Switches the magnet, looks whether the driver tells that its output has changed, and gives it time.
class MagnetStep final : public CallStep {
 public:
  MagnetStep(std::string stage, bool is_on, Duty duty) : CallStep(std::move(stage), duty), is_on_(is_on) {}

 private:
  std::uint64_t makeCall(StepContext& context) override { return context.call(MagnetCall{is_on_}); }
  const char* what() const override { return is_on_ ? "magnet on" : "magnet off"; }
  std::optional<Verdict> awaitEffect(StepContext& context) override;

  bool is_on_;
  struct Answered {
    double stamp_s;  // ROS time
    double since_s;
  };
  std::optional<Answered> answered_;
  std::optional<double> changed_s_;
};

/// At rest, for a while, then the sensor's zero.
class ZeroForceStep final : public CallStep {
 public:
  explicit ZeroForceStep(std::string stage) : CallStep(std::move(stage), Duty::kIfGateIsOpen) {}

 private:
  std::optional<Verdict> prepare(StepContext& context) override;
  std::optional<Verdict> awaitEffect(StepContext& context) override;
  std::uint64_t makeCall(StepContext& context) override { return context.call(ZeroForceCall{}); }
  const char* what() const override { return "zero_ftsensor"; }

  std::optional<double> begun_s_;
  std::optional<double> rest_since_s_;
};

class PayloadStep final : public CallStep {
 public:
  PayloadStep(std::string stage, const Payload& payload, Duty duty)
      : CallStep(std::move(stage), duty), payload_(payload) {}

 private:
  std::uint64_t makeCall(StepContext& context) override { return context.call(PayloadCall{payload_}); }
  const char* what() const override { return "set_payload"; }
  std::optional<Verdict> awaitEffect(StepContext& context) override {
    context.payload_kg = payload_.mass_kg;
    return Verdict{};
  }

  Payload payload_;
};

/// What is known at once.
class CheckStep final : public Step {
 public:
  using Check = std::function<Verdict(const StepContext&)>;

  CheckStep(std::string stage, Check check) : Step(std::move(stage)), check_(std::move(check)) {}
  std::optional<Verdict> advance(StepContext& context) override {
    return context.stop_asked ? *context.stop_asked : check_(context);
  }

 private:
  Check check_;
};

/// Tells that the brick hangs on the magnet, or that nothing does.
class AttachStep final : public Step {
 public:
  AttachStep(std::string stage, bool is_attached) : Step(std::move(stage)), is_attached_(is_attached) {}
  std::optional<Verdict> advance(StepContext& context) override;

 private:
  bool is_attached_;
};

/// The force of an arm that stands, once it is steady.
class ForceStep : public Step {
 public:
  using Step::Step;
  std::optional<Verdict> advance(StepContext& context) final;

 protected:
  virtual Verdict judge(StepContext& context, const LoadCell::Weight& weight) = 0;
  virtual Verdict unsteady(const std::string& why) const = 0;

 private:
  struct Begun {
    double stamp_s;  // ROS time
    double since_s;
  };
  std::optional<Begun> begun_;
};

/// What hangs there: has it the brick's mass?
class WeighStep final : public ForceStep {
 public:
  /// `no_contact`: what the touch says of it, when the time has come; empty: there was contact.
  WeighStep(std::string stage, double brick_mass_kg, const std::string* no_contact)
      : ForceStep(std::move(stage)), brick_mass_kg_(brick_mass_kg), no_contact_(no_contact) {}

 private:
  Verdict judge(StepContext& context, const LoadCell::Weight& weight) override;
  Verdict unsteady(const std::string& why) const override;

  double brick_mass_kg_;
  const std::string* no_contact_;
};

/// With the payload declared: what the force says now is what it says while the brick is there.
class HoldStep final : public ForceStep {
 public:
  HoldStep(std::string stage, double brick_mass_kg) : ForceStep(std::move(stage)), brick_mass_kg_(brick_mass_kg) {}

 private:
  Verdict judge(StepContext& context, const LoadCell::Weight& weight) override;
  Verdict unsteady(const std::string& why) const override;

  double brick_mass_kg_;
};

/// A pick that was broken off before it came to weigh: does anything hang there at all? Where the force says nothing, nothing
/// is said, and nothing kept from being let go.
class FirstWeighStep final : public Step {
 public:
  FirstWeighStep(std::string stage, double brick_mass_kg) : Step(std::move(stage)), brick_mass_kg_(brick_mass_kg) {}
  std::optional<Verdict> advance(StepContext& context) override;

 private:
  double brick_mass_kg_;
  struct Begun {
    double stamp_s;  // ROS time
    double since_s;
  };
  std::optional<Begun> begun_;
};

/// The magnet is off: is the weight gone? Without a weight that was known before, nothing can be said, and nothing is.
class GoneStep final : public Step {
 public:
  using Step::Step;
  std::optional<Verdict> advance(StepContext& context) override;

 private:
  std::optional<double> begun_s_;
};

/// Nothing has been asked of the arm for a while: is the brick still there? Without a weight that was known before,
/// nothing can be said, and nothing is.
class StillThereStep final : public Step {
 public:
  using Step::Step;
  std::optional<Verdict> advance(StepContext& context) override;

 private:
  std::optional<double> begun_s_;
};

/// Back to an arm that takes trajectories.
class RecoverStep final : public Step {
 public:
  RecoverStep(const RecoveryConfig& config, const RecoveryPermit& permit);
  std::optional<Verdict> advance(StepContext& context) override;
  ExecutorPhase phase() const override { return ExecutorPhase::kRecovering; }
  const std::vector<std::string>& commands() const { return recovery_.done(); }

 private:
  Recovery recovery_;
  RecoveryPermit permit_;
  bool has_begun_{false};
  std::uint64_t call_{0};
  double asked_s_{0.0};
};

}  // namespace ur_driver_bridge
