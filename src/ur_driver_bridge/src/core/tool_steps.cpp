// SPDX-License-Identifier: BSD-3-Clause
#include "tool_steps.h"

#include <algorithm>
#include <cmath>

namespace ur_driver_bridge {
namespace {

Verdict unanswered(const char* what, double after_s) {
  return {ArmStatus::kDriverGone, formatted("%s: no answer within %.2f s", what, after_s)};
}

}  // namespace

std::optional<Verdict> CallStep::advance(StepContext& context) {
  if (call_ == 0) {
    if (duty_ != Duty::kAlways && context.stop_asked) return context.stop_asked;
    if (duty_ == Duty::kIfGateIsOpen) {
      const Verdict gate = context.gate.check(context.inputs.gate, {});
      if (!gate.isFine()) return gate;
    }
    const std::optional<Verdict> ready = prepare(context);
    if (!ready || !ready->isFine()) return ready;
    call_ = makeCall(context);
    asked_s_ = context.time_s;
    return std::nullopt;
  }
  if (!is_answered_) {
    // What has been asked for is waited for, also when told to stop: its answer decides what the magnet holds.
    const CallReply* reply = context.replyTo(call_);
    if (reply == nullptr) {
      const double limit_s = context.config.motion.answer_timeout_s;
      return context.time_s - asked_s_ > limit_s ? std::optional<Verdict>(unanswered(what(), limit_s)) : std::nullopt;
    }
    if (reply->is_gone) return Verdict{ArmStatus::kDriverGone, std::string(what()) + ": " + reply->message};
    if (!reply->success) {
      return Verdict{ArmStatus::kIoRefused, std::string(what()) + " refused by the driver" +
                                                (reply->message.empty() ? "" : ": " + reply->message)};
    }
    is_answered_ = true;
  }
  return awaitEffect(context);
}

std::optional<Verdict> MagnetStep::awaitEffect(StepContext& context) {
  if (!answered_) answered_ = Answered{context.now_s, context.time_s};
  if (!changed_s_) {
    const auto& gripper = context.arm().gripper;
    const double limit_s = context.config.gripper.io_timeout_s;
    // A message from before the switch says nothing.
    const bool is_switched = gripper && gripper->stamp_s >= answered_->stamp_s && gripper->value.is_on == is_on_;
    const bool grips_nothing = is_switched && is_on_ && !gripper->value.is_holding.value_or(true);
    if (is_switched && !grips_nothing) {
      changed_s_ = context.time_s;
    } else if (context.time_s - answered_->since_s <= limit_s) {
      return std::nullopt;
    } else if (grips_nothing) {
      return Verdict{ArmStatus::kNotAttached, formatted("the gripper is on, and holds nothing after %.2f s", limit_s)};
    } else {
      return Verdict{ArmStatus::kIoRefused, formatted("the gripper is not %s %.2f s after the driver has switched it",
                                                      is_on_ ? "on" : "off", limit_s)};
    }
  }
  if (context.time_s - *changed_s_ < context.config.pick.magnet_settle_s) return std::nullopt;
  return Verdict{};
}

std::optional<Verdict> ZeroForceStep::prepare(StepContext& context) {
  if (!begun_s_) begun_s_ = context.time_s;
  if (!context.isAtRest()) {
    rest_since_s_.reset();
    const double limit_s = context.config.motion.rest_timeout_s;
    if (context.time_s - *begun_s_ <= limit_s) return std::nullopt;
    return Verdict{ArmStatus::kNotReady, formatted("the arm has not come to rest within %.2f s, which the force "
                                                   "sensor's zero needs",
                                                   limit_s)};
  }
  if (!rest_since_s_) rest_since_s_ = context.time_s;
  if (context.time_s - *rest_since_s_ < context.config.pick.settle_s) return std::nullopt;
  return Verdict{};
}

std::optional<Verdict> ZeroForceStep::awaitEffect(StepContext& context) {
  context.load.reset();
  return Verdict{};
}

std::optional<Verdict> AttachStep::advance(StepContext& context) {
  context.call(AttachCall{is_attached_});
  context.is_holding = is_attached_;
  if (!is_attached_) context.load.release();
  return Verdict{};
}

std::optional<Verdict> ForceStep::advance(StepContext& context) {
  if (context.stop_asked) return context.stop_asked;
  GateDemand demand;
  demand.needs_force = true;
  const Verdict gate = context.gate.check(context.inputs.gate, demand);
  if (!gate.isFine()) return gate;
  if (!begun_) begun_ = Begun{context.now_s, context.time_s};
  std::string why;
  if (const auto weight = context.load.weigh(begun_->stamp_s + context.config.pick.settle_s, &why)) {
    return judge(context, *weight);
  }
  if (context.time_s - begun_->since_s < context.config.pick.weigh_timeout_s) return std::nullopt;
  return unsteady(why);
}

Verdict WeighStep::judge(StepContext& context, const LoadCell::Weight& weight) {
  context.figures.load_kg = weight.mass_kg;
  const double least_kg = context.config.load.min_share * brick_mass_kg_;
  const double most_kg = context.config.load.max_share * brick_mass_kg_;
  if (weight.mass_kg >= least_kg && weight.mass_kg <= most_kg) return {};
  const std::string load =
      formatted("%.2f kg hang on the magnet, must be in [%.2f, %.2f] kg", weight.mass_kg, least_kg, most_kg);
  if (no_contact_->empty() || weight.mass_kg > most_kg) return {ArmStatus::kNotAttached, load};
  return {ArmStatus::kNoContact, *no_contact_ + "; " + load};
}

Verdict WeighStep::unsteady(const std::string& why) const {
  return {ArmStatus::kNotAttached, "what hangs on the magnet cannot be weighed: " + why};
}

Verdict HoldStep::judge(StepContext& context, const LoadCell::Weight& weight) {
  // The robot takes the declared mass out of the force: what remains is what the brick weighs beside it. Much less, and
  // it has fallen since it was weighed.
  const double expected_kg = context.figures.load_kg - brick_mass_kg_;
  const double missing_kg = expected_kg - weight.mass_kg;
  if (missing_kg >= context.load.loss(brick_mass_kg_, context.figures.load_kg)) {
    return {ArmStatus::kLostOnTheWay,
            formatted("the brick's weight is gone since it was weighed: %.2f kg beside the declared payload, expected "
                      "were %.2f kg",
                      weight.mass_kg, expected_kg)};
  }
  const double hangs_kg = std::min(context.figures.load_kg, brick_mass_kg_ + weight.mass_kg);
  context.load.hold(brick_mass_kg_, hangs_kg, weight);
  return {};
}

Verdict HoldStep::unsteady(const std::string& why) const {
  return {ArmStatus::kStaleState, "the force with the declared payload does not come to rest: " + why};
}

std::optional<Verdict> FirstWeighStep::advance(StepContext& context) {
  if (context.stop_asked) return context.stop_asked;
  GateDemand demand;
  demand.needs_force = true;
  if (!context.gate.check(context.inputs.gate, demand).isFine()) return Verdict{};
  if (!begun_) begun_ = Begun{context.now_s, context.time_s};
  std::string why;
  const auto weight = context.load.weigh(begun_->stamp_s + context.config.pick.settle_s, &why);
  if (!weight) {
    const bool is_late = context.time_s - begun_->since_s >= context.config.pick.weigh_timeout_s;
    return is_late ? std::optional<Verdict>(Verdict{}) : std::nullopt;
  }
  const double load_kg = weight->mass_kg + context.payload_kg - context.model.tool.mass_kg;
  const double least_kg = context.config.load.min_share * brick_mass_kg_;
  // Pressed against something, it tells nothing of what hangs there.
  if (std::abs(load_kg) >= least_kg) return Verdict{};
  return Verdict{ArmStatus::kLostOnTheWay,
                 formatted("the pick was broken off before the brick was weighed, and %.2f kg hang on the magnet, must "
                           "be at least %.2f kg",
                           load_kg, least_kg)};
}

std::optional<Verdict> GoneStep::advance(StepContext& context) {
  if (!context.load.isHolding()) return Verdict{};
  if (!begun_s_) begun_s_ = context.time_s;
  if (context.load.isLost()) return Verdict{};
  if (context.time_s - *begun_s_ < context.config.pick.settle_s + context.config.load.lost_s) return std::nullopt;
  const std::optional<double> load_kg = context.load.load();
  return Verdict{
      ArmStatus::kNotLetGo,
      load_kg
          ? formatted("the magnet is off, but the load has not changed: %.2f kg beside the declared payload", *load_kg)
          : "the magnet is off, and the force sensor is silent"};
}

std::optional<Verdict> StillThereStep::advance(StepContext& context) {
  if (!context.load.isHolding()) return Verdict{};
  if (context.stop_asked) return context.stop_asked;
  if (!begun_s_) begun_s_ = context.time_s;
  if (context.time_s - *begun_s_ < context.config.pick.settle_s + context.config.load.lost_s) return std::nullopt;
  return lossOf(context).value_or(Verdict{});
}

RecoverStep::RecoverStep(const RecoveryConfig& config, const RecoveryPermit& permit)
    : Step("recover"), recovery_(config), permit_(permit) {}

std::optional<Verdict> RecoverStep::advance(StepContext& context) {
  if (!has_begun_) {
    has_begun_ = true;
    context.call(CancelCall{});  // what ran before the stop must not go on after it
    recovery_.begin(permit_, context.time_s);
  }
  if (call_ != 0) {
    const CallReply* reply = context.replyTo(call_);
    if (reply == nullptr) {
      const double limit_s = context.config.recovery.step_timeout_s;
      return context.time_s - asked_s_ > limit_s ? std::optional<Verdict>(unanswered("dashboard", limit_s))
                                                 : std::nullopt;
    }
    if (reply->is_gone) return Verdict{ArmStatus::kDriverGone, "dashboard: " + reply->message};
    recovery_.answered(reply->success, reply->message, context.time_s);
    call_ = 0;
  }
  if (context.stop_asked) return context.stop_asked;
  const Recovery::Step next = recovery_.next(context.arm(), context.time_s);
  switch (next.action) {
    case Recovery::Action::kDone:
      return Verdict{};
    case Recovery::Action::kImpossible:
      return next.verdict;
    case Recovery::Action::kWait:
      return std::nullopt;
    case Recovery::Action::kCommand:
      call_ = context.call(DashboardCall{next.command});
      asked_s_ = context.time_s;
      return std::nullopt;
  }
  return std::nullopt;
}

}  // namespace ur_driver_bridge
