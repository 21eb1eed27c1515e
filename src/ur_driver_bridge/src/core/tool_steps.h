// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "step.h"

namespace ur_driver_bridge {

/// One call, its answer, and what must be seen of its effect.
class CallStep : public Step {
 public:
  using Step::Step;
  std::optional<Verdict> advance(StepContext& context) final;

 protected:
  /// Before the call, again and again until true.
  virtual bool isReady(StepContext&) { return true; }
  virtual std::uint64_t makeCall(StepContext& context) = 0;
  virtual const char* what() const = 0;  // for messages
  /// After the answer, until the effect is there or it is too late.
  virtual std::optional<Verdict> awaitEffect(StepContext&, double /*answered_s*/) { return Verdict{}; }

 private:
  std::uint64_t call_{0};
  double asked_s_{0.0};
  std::optional<double> answered_s_;
};

/// Switches the magnet, looks whether the driver tells that its output has changed, and gives it time.
class MagnetStep final : public CallStep {
 public:
  MagnetStep(std::string stage, bool is_on) : CallStep(std::move(stage)), is_on_(is_on) {}

 private:
  std::uint64_t makeCall(StepContext& context) override { return context.call(MagnetCall{is_on_}); }
  const char* what() const override { return is_on_ ? "magnet on" : "magnet off"; }
  std::optional<Verdict> awaitEffect(StepContext& context, double answered_s) override;

  bool is_on_;
  std::optional<double> changed_s_;
};

/// At rest, for a while, then the sensor's zero.
class ZeroForceStep final : public CallStep {
 public:
  using CallStep::CallStep;

 private:
  bool isReady(StepContext& context) override;
  std::uint64_t makeCall(StepContext& context) override { return context.call(ZeroForceCall{}); }
  const char* what() const override { return "zero_ftsensor"; }

  std::optional<double> rest_since_s_;
};

class PayloadStep final : public CallStep {
 public:
  PayloadStep(std::string stage, const Payload& payload) : CallStep(std::move(stage)), payload_(payload) {}

 private:
  std::uint64_t makeCall(StepContext& context) override { return context.call(PayloadCall{payload_}); }
  const char* what() const override { return "set_payload"; }

  Payload payload_;
};

/// Tells that the brick hangs on the magnet, or that nothing does.
class AttachStep final : public Step {
 public:
  AttachStep(std::string stage, bool is_attached) : Step(std::move(stage)), is_attached_(is_attached) {}
  std::optional<Verdict> advance(StepContext& context) override;

 private:
  bool is_attached_;
};

/// What hangs there, at rest: has it the brick's mass?
class WeighStep final : public Step {
 public:
  WeighStep(std::string stage, double brick_mass_kg) : Step(std::move(stage)), brick_mass_kg_(brick_mass_kg) {}
  std::optional<Verdict> advance(StepContext& context) override;

 private:
  double brick_mass_kg_;
  std::optional<double> begun_s_;
};

/// With the payload declared: what the force says now is what it says while the brick is there.
class HoldStep final : public Step {
 public:
  HoldStep(std::string stage, double brick_mass_kg) : Step(std::move(stage)), brick_mass_kg_(brick_mass_kg) {}
  std::optional<Verdict> advance(StepContext& context) override;

 private:
  double brick_mass_kg_;
  std::optional<double> begun_s_;
};

/// The magnet is off: is the weight gone? Without a weight that was known before, nothing can be said, and nothing is.
class GoneStep final : public Step {
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
