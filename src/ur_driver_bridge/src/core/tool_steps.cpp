// SPDX-License-Identifier: BSD-3-Clause
#include "tool_steps.h"

#include <algorithm>

namespace ur_driver_bridge {
namespace {

Verdict unanswered(const char* what, double after_s) {
  return {ArmStatus::kDriverGone, formatted("%s: no answer within %.2f s", what, after_s)};
}

}  // namespace

std::optional<Verdict> CallStep::advance(StepContext& context) {
  if (call_ == 0) {
    if (context.stop_asked) return context.stop_asked;
    if (!isReady(context)) return std::nullopt;
    call_ = makeCall(context);
    asked_s_ = context.now_s;
    return std::nullopt;
  }
  if (!answered_s_) {
    // What has been asked for is waited for, also when told to stop: its answer decides what the magnet holds.
    const CallReply* reply = context.replyTo(call_);
    if (reply == nullptr) {
      const double limit_s = context.config.motion.answer_timeout_s;
      return context.now_s - asked_s_ > limit_s ? std::optional<Verdict>(unanswered(what(), limit_s)) : std::nullopt;
    }
    if (reply->is_gone) return Verdict{ArmStatus::kDriverGone, std::string(what()) + ": " + reply->message};
    if (!reply->success) {
      return Verdict{ArmStatus::kIoRefused, std::string(what()) + " refused by the driver" +
                                                (reply->message.empty() ? "" : ": " + reply->message)};
    }
    answered_s_ = context.now_s;
  }
  return awaitEffect(context, *answered_s_);
}

std::optional<Verdict> MagnetStep::awaitEffect(StepContext& context, double answered_s) {
  if (!changed_s_) {
    const auto& output = context.arm().digital_out;
    const auto pin = static_cast<std::size_t>(context.config.magnet_pin);
    // A message from before the switch says nothing.
    if (output && output->stamp_s >= answered_s && output->value[pin] == is_on_) {
      changed_s_ = context.now_s;
    } else if (context.now_s - answered_s > context.config.io_timeout_s) {
      return Verdict{ArmStatus::kIoRefused,
                     formatted("digital output %d is not %s %.2f s after the driver has set it",
                               context.config.magnet_pin, is_on_ ? "on" : "off", context.config.io_timeout_s)};
    } else {
      return std::nullopt;
    }
  }
  if (context.now_s - *changed_s_ < context.config.pick.magnet_settle_s) return std::nullopt;
  return Verdict{};
}

bool ZeroForceStep::isReady(StepContext& context) {
  if (!context.isAtRest()) {
    rest_since_s_.reset();
    return false;
  }
  if (!rest_since_s_) rest_since_s_ = context.now_s;
  return context.now_s - *rest_since_s_ >= context.config.pick.settle_s;
}

std::optional<Verdict> AttachStep::advance(StepContext& context) {
  context.call(AttachCall{is_attached_});
  context.is_holding = is_attached_;
  if (!is_attached_) context.load.release();
  return Verdict{};
}

std::optional<Verdict> WeighStep::advance(StepContext& context) {
  if (context.stop_asked) return context.stop_asked;
  if (!begun_s_) begun_s_ = context.now_s;
  std::string why;
  const double from_s = *begun_s_ + context.config.pick.settle_s;
  const std::optional<LoadCell::Weight> weight = context.load.weigh(from_s, &why);
  if (!weight) {
    if (context.now_s - *begun_s_ < context.config.pick.weigh_timeout_s) return std::nullopt;
    return Verdict{ArmStatus::kNotAttached, "what hangs on the magnet cannot be weighed: " + why};
  }
  context.figures.load_kg = weight->mass_kg;
  const double least_kg = context.config.load.min_share * brick_mass_kg_;
  const double most_kg = context.config.load.max_share * brick_mass_kg_;
  if (weight->mass_kg >= least_kg && weight->mass_kg <= most_kg) return Verdict{};
  return Verdict{ArmStatus::kNotAttached, formatted("%.2f kg hang on the magnet, must be in [%.2f, %.2f] kg",
                                                    weight->mass_kg, least_kg, most_kg)};
}

std::optional<Verdict> HoldStep::advance(StepContext& context) {
  if (context.stop_asked) return context.stop_asked;
  if (!begun_s_) begun_s_ = context.now_s;
  std::string why;
  const std::optional<LoadCell::Weight> weight = context.load.weigh(*begun_s_ + context.config.pick.settle_s, &why);
  if (weight) {
    context.load.hold(brick_mass_kg_, *weight);
    return Verdict{};
  }
  if (context.now_s - *begun_s_ < context.config.pick.weigh_timeout_s) return std::nullopt;
  return Verdict{ArmStatus::kStaleState, "the force with the declared payload does not come to rest: " + why};
}

std::optional<Verdict> GoneStep::advance(StepContext& context) {
  if (!context.load.isHolding()) return Verdict{};
  if (!begun_s_) begun_s_ = context.now_s;
  if (context.load.isLost()) return Verdict{};
  if (context.now_s - *begun_s_ < context.config.pick.settle_s + context.config.load.lost_s) return std::nullopt;
  const std::optional<double> load_kg = context.load.load();
  return Verdict{
      ArmStatus::kNotLetGo,
      load_kg ? formatted("the magnet is off, and %.2f kg beside the declared payload tell of no change", *load_kg)
              : "the magnet is off, and the force sensor is silent"};
}

RecoverStep::RecoverStep(const RecoveryConfig& config, const RecoveryPermit& permit)
    : Step("recover"), recovery_(config), permit_(permit) {}

std::optional<Verdict> RecoverStep::advance(StepContext& context) {
  if (!has_begun_) {
    has_begun_ = true;
    context.call(CancelCall{});  // what ran before the stop must not go on after it
    recovery_.begin(permit_, context.now_s);
  }
  if (call_ != 0) {
    const CallReply* reply = context.replyTo(call_);
    if (reply == nullptr) {
      const double limit_s = context.config.recovery.step_timeout_s;
      return context.now_s - asked_s_ > limit_s ? std::optional<Verdict>(unanswered("dashboard", limit_s))
                                                : std::nullopt;
    }
    if (reply->is_gone) return Verdict{ArmStatus::kDriverGone, "dashboard: " + reply->message};
    recovery_.answered(reply->success, reply->message, context.now_s);
    call_ = 0;
  }
  if (context.stop_asked) return context.stop_asked;
  const Recovery::Step next = recovery_.next(context.arm(), context.now_s);
  switch (next.action) {
    case Recovery::Action::kDone:
      return Verdict{};
    case Recovery::Action::kImpossible:
      return next.verdict;
    case Recovery::Action::kWait:
      return std::nullopt;
    case Recovery::Action::kCommand:
      call_ = context.call(DashboardCall{next.command});
      asked_s_ = context.now_s;
      return std::nullopt;
  }
  return std::nullopt;
}

}  // namespace ur_driver_bridge
