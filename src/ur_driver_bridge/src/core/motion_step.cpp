// SPDX-License-Identifier: BSD-3-Clause
#include "motion_step.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "ur_driver_bridge/time_law.h"

namespace ur_driver_bridge {
namespace {

constexpr double kJoinRamp_s = 0.3;
constexpr double kFirstPoint_s = 0.03;  // of a stop: what was commanded meanwhile is made up for within it
constexpr double kRest_s = 0.05;        // an arm that swings stands for a moment at each end
constexpr double kSearch_s = 0.25;      // of trajectory time, about where the arm is believed to be

}  // namespace

JointTrajectory joined(const JointTrajectory& trajectory, const ArmVector& from_rad, double ramp_s) {
  if (trajectory.empty()) throw std::invalid_argument("joined: trajectory without points");
  if (!(ramp_s > 0.0)) throw std::invalid_argument("joined: ramp_s = " + std::to_string(ramp_s) + " s, must be > 0 s");
  const ArmVector offset_rad = from_rad - trajectory.points.front().position_rad;
  JointTrajectory result = trajectory;
  const double start_s = trajectory.points.front().time_s;
  for (TrajectoryPoint& point : result.points) {
    const double u = std::min((point.time_s - start_s) / ramp_s, 1.0);
    // 1 at the start, 0 after the ramp, at rest at both.
    point.position_rad += offset_rad * (1.0 - u * u * (3.0 - 2.0 * u));
    point.velocity_rad_s -= offset_rad * (6.0 * u * (1.0 - u) / ramp_s);
    if (u < 1.0) point.acceleration_rad_s2 -= offset_rad * ((6.0 - 12.0 * u) / (ramp_s * ramp_s));
  }
  if (result.duration() - start_s < ramp_s) {
    // Too short for the ramp: the end is where it was to be, all the same.
    result.points.back() = trajectory.points.back();
    if (result.points.size() == 1) result.points.front().position_rad = trajectory.points.front().position_rad;
  }
  return result;
}

MotionStep::MotionStep(std::string stage, WatchPhase watch, Make make)
    : Step(std::move(stage)), watch_phase_(watch), make_(std::move(make)) {}

ExecutorPhase MotionStep::phase() const {
  switch (state_) {
    case State::kBegin:
    case State::kWatching:
    case State::kSending:
      return ExecutorPhase::kStarting;
    case State::kMoving:
      return ExecutorPhase::kMoving;
    case State::kStopping:
    case State::kResting:
      return ExecutorPhase::kStopping;
  }
  return ExecutorPhase::kStopping;
}

double MotionStep::progress() const {
  const double duration_s = trajectory_.duration();
  return duration_s > 0.0 ? std::clamp(at_s_ / duration_s, 0.0, 1.0) : 0.0;
}

std::optional<Verdict> MotionStep::advance(StepContext& context) {
  if (state_ == State::kBegin) {
    if (!begun_s_) begun_s_ = context.now_s;
    const bool may_wait = context.now_s - *begun_s_ < context.config.motion.rest_timeout_s;
    const Verdict verdict = context.stop_asked ? *context.stop_asked : begin(context, may_wait);
    if (!verdict.isFine()) return verdict;
    if (trajectory_.empty()) return std::nullopt;  // the arm still swings
    // A trajectory to where the arm is already.
    if (trajectory_.duration() <= 0.0) return atEnd(context);
    asked_s_ = context.now_s;
    if (context.config.gate.max_monitor_age_s > 0.0) {
      watch(context, context.now_s);
      state_ = State::kWatching;
    } else {
      send_call_ = context.call(SendCall{trajectory_});
      state_ = State::kSending;
    }
    return std::nullopt;
  }

  if (state_ == State::kWatching) {
    if (context.stop_asked) return context.stop_asked;
    const std::optional<Verdict> refusal = onWatchReply(context);
    if (refusal) return refusal;
    if (watch_call_ != 0) {
      if (context.now_s - asked_s_ > context.config.motion.answer_timeout_s) {
        return Verdict{ArmStatus::kMonitorGone, formatted("the path monitor has not answered within %.2f s",
                                                          context.config.motion.answer_timeout_s)};
      }
      return std::nullopt;
    }
    asked_s_ = context.now_s;
    send_call_ = context.call(SendCall{trajectory_});
    state_ = State::kSending;
    return std::nullopt;
  }

  if (state_ == State::kSending || state_ == State::kMoving) {
    follow(context);
  }
  return state_ == State::kStopping || state_ == State::kResting ? finish(context) : std::nullopt;
}

/// Leaves the trajectory empty while the arm comes to rest.
Verdict MotionStep::begin(StepContext& context, bool may_wait) {
  GateDemand demand;
  demand.needs_force = needsForce() || context.load.isHolding();
  Verdict verdict = context.gate.check(context.inputs.gate, demand);
  if (!verdict.isFine()) return verdict;
  const ArmVector& arm_rad = context.arm().joints->value.position_rad;
  if (!hasRested(context)) {
    if (may_wait) return {};
    return {
        ArmStatus::kNotReady,
        formatted("the arm moves at %.3f rad/s before the motion begins, must be below %.3f rad/s",
                  context.arm().joints->value.velocity_rad_s.cwiseAbs().maxCoeff(), context.config.motion.rest_rad_s)};
  }
  TrajectoryLimits limits = context.model.limits;
  limits.acceleration_rad_s2.setConstant(context.config.motion.acceleration_rad_s2);
  trajectory_ = make_();
  verdict = checkTrajectory(trajectory_, limits);
  if (!verdict.isFine()) return verdict;
  verdict = checkStart(trajectory_, arm_rad, limits.joints, context.config.motion.start_tolerance_rad);
  if (!verdict.isFine()) return verdict;
  trajectory_ = joined(trajectory_, arm_rad, kJoinRamp_s);
  return {};
}

/// At rest, and for long enough.
bool MotionStep::hasRested(const StepContext& context) {
  if (!context.isAtRest()) {
    rest_since_s_.reset();
    return false;
  }
  if (!rest_since_s_) rest_since_s_ = context.now_s;
  return context.now_s - *rest_since_s_ >= kRest_s;
}

void MotionStep::watch(StepContext& context, double start_s) {
  watch_call_ = context.call(WatchCall{trajectory_, start_s, watch_phase_});
  watch_start_s_ = start_s;
}

/// Takes the reply if it is there. A refusal, if it is one.
std::optional<Verdict> MotionStep::onWatchReply(StepContext& context) {
  const CallReply* reply = watch_call_ == 0 ? nullptr : context.replyTo(watch_call_);
  if (reply == nullptr) return std::nullopt;
  watch_call_ = 0;
  if (!reply->success) {
    return Verdict{ArmStatus::kMonitorGone,
                   (reply->is_gone ? "nobody watches the way: " : "the path monitor refuses: ") + reply->message};
  }
  watch_id_ = reply->watch_id;
  watch_since_s_ = context.now_s;
  return std::nullopt;
}

std::optional<Verdict> MotionStep::checkGate(const StepContext& context) const {
  GateDemand demand;
  demand.needs_force = needsForce() || context.load.isHolding();
  demand.watch_id = watch_id_;
  demand.watch_since_s = watch_since_s_;
  const Verdict verdict = context.gate.check(context.inputs.gate, demand);
  return verdict.isFine() ? std::nullopt : std::optional<Verdict>(verdict);
}

/// What the controller says of the trajectory. Nothing: it goes on; `has_ended`: the controller follows it no longer.
std::optional<Verdict> MotionStep::followEvents(StepContext& context, bool* has_ended) {
  using Kind = TrajectoryEvent::Kind;
  for (const TrajectoryEvent& event : context.inputs.events) {
    if (event.id != send_call_) continue;
    switch (event.kind) {
      case Kind::kAccepted:
        if (state_ == State::kSending) state_ = State::kMoving;
        break;
      case Kind::kSucceeded:
        *has_ended = true;
        at_s_ = trajectory_.duration();
        return atEnd(context);
      case Kind::kRejected:
        *has_ended = true;
        return Verdict{ArmStatus::kTrajectoryRefused, "the controller refuses the trajectory: " + event.message};
      case Kind::kAborted:
        *has_ended = true;
        return Verdict{ArmStatus::kTrajectoryAborted, "the controller gave the trajectory up: " + event.message};
      case Kind::kCancelled:
        *has_ended = true;
        return Verdict{ArmStatus::kTrajectoryAborted,
                       "somebody else cancelled or replaced the trajectory: " + event.message};
      case Kind::kLost:
        *has_ended = true;
        return Verdict{ArmStatus::kDriverGone, "the controller has forgotten the trajectory: " + event.message};
    }
  }
  return std::nullopt;
}

void MotionStep::follow(StepContext& context) {
  const MotionConfig& config = context.config.motion;
  bool has_ended = false;
  const std::optional<Verdict> told = followEvents(context, &has_ended);
  if (has_ended) {
    rest(context, *told);
    return;
  }

  // Where on its way: by what the controller commands if it tells, else by where the arm is.
  const double scaling = context.arm().speed_scaling ? context.arm().speed_scaling->value : 1.0;
  elapsed_s_ += context.dt_s * scaling;
  if (state_ == State::kMoving) {
    if (context.arm().commanded_rad) {
      at_s_ = timeOf(trajectory_, context.arm().commanded_rad->value, at_s_, kSearch_s);
    } else if (context.arm().joints) {
      at_s_ = timeOf(trajectory_, context.arm().joints->value.position_rad, at_s_, kSearch_s);
    }
  }

  std::optional<Verdict> reason = context.stop_asked ? context.stop_asked : checkGate(context);
  if (!reason) reason = onWatchReply(context);
  if (!reason && context.load.isHolding() && context.load.isLost()) {
    const std::optional<double> load_kg = context.load.load();
    reason =
        Verdict{ArmStatus::kLostOnTheWay,
                formatted("the brick's weight is gone: %.2f kg beside the declared payload", load_kg.value_or(0.0))};
  }
  if (!reason && state_ == State::kSending && context.now_s - asked_s_ > config.answer_timeout_s) {
    reason = Verdict{ArmStatus::kDriverGone,
                     formatted("the controller has not answered within %.2f s", config.answer_timeout_s)};
  }
  if (!reason && elapsed_s_ > trajectory_.duration() + config.end_patience_s) {
    reason =
        Verdict{ArmStatus::kStalled, formatted("the trajectory of %.2f s has not ended after %.2f s of its own time",
                                               trajectory_.duration(), elapsed_s_)};
  }
  if (scaling >= config.stall_speed) {
    stalled_since_s_.reset();
  } else if (!stalled_since_s_) {
    stalled_since_s_ = context.now_s;
  }
  if (!reason && stalled_since_s_ && context.now_s - *stalled_since_s_ > config.stall_patience_s) {
    reason = Verdict{ArmStatus::kStalled, formatted("speed scaling = %.3f for %.1f s, must be at least %.3f", scaling,
                                                    context.now_s - *stalled_since_s_, config.stall_speed)};
  }
  if (reason) {
    stop(context, *reason, config.stop_s);
    return;
  }
  if (state_ != State::kMoving) return;
  if (const std::optional<Ending> ending = look(context)) {
    stop(context, ending->verdict, ending->stop_s);
    return;
  }
  // Slower than it was told: the monitor has to look at what is still to come, not at what it takes for that.
  if (watch_id_ && watch_call_ == 0 && (context.now_s - watch_start_s_) - at_s_ > config.watch_drift_s) {
    watch(context, context.now_s - at_s_);
  }
}

void MotionStep::stop(StepContext& context, const Verdict& verdict, double stop_s) {
  verdict_ = verdict;
  asked_s_ = context.now_s;
  state_ = State::kStopping;
  rest_since_s_.reset();
  const double scaling = context.arm().speed_scaling ? context.arm().speed_scaling->value : 1.0;
  const Verdict robot = context.gate.checkRobot(context.arm(), context.now_s);
  const bool is_moving = at_s_ > 0.0 || !context.isAtRest();
  if (!robot.isFine() || !is_moving || scaling < context.config.motion.stall_speed) {
    // Nothing that could follow a stop, or nothing to be stopped.
    context.call(CancelCall{});
    return;
  }
  // The controller's time passes slower by the scaling, and so does the arm: a stop in real time.
  JointTrajectory braking = brake(trajectory_, at_s_ + context.config.motion.latency_s * scaling, stop_s * scaling);
  auto& points = braking.points;
  const auto first = std::find_if(points.begin(), points.end(), [&](const TrajectoryPoint& point) {
    return point.time_s >= std::min(kFirstPoint_s, 0.5 * stop_s) * scaling;
  });
  if (first != points.end()) points.erase(points.begin(), first);
  send_call_ = context.call(SendCall{braking});
}

/// The controller follows nothing any more.
void MotionStep::rest(const StepContext& context, const Verdict& verdict) {
  verdict_ = verdict;
  asked_s_ = context.now_s;
  send_call_ = 0;
  state_ = State::kResting;
}

std::optional<Verdict> MotionStep::finish(StepContext& context) {
  using Kind = TrajectoryEvent::Kind;
  if (state_ == State::kStopping) {
    for (const TrajectoryEvent& event : context.inputs.events) {
      if (event.id != send_call_ || event.kind == Kind::kAccepted) continue;
      // However it ended: a stop that was refused or given up is left to the controller's own.
      if (event.kind != Kind::kSucceeded) context.call(CancelCall{});
      state_ = State::kResting;
    }
    if (state_ == State::kStopping && context.now_s - asked_s_ > context.config.motion.answer_timeout_s) {
      context.call(CancelCall{});
      state_ = State::kResting;
    }
  }
  const bool is_late = context.now_s - asked_s_ > context.config.motion.rest_timeout_s;
  const bool can_be_seen =
      context.gate.checkRobot(context.arm(), context.now_s).status != ArmStatus::kDriverGone && context.arm().joints;
  if (!hasRested(context) && can_be_seen && !is_late) return std::nullopt;
  // Still following a stop: at rest only for the moment.
  if (state_ == State::kStopping && send_call_ != 0 && can_be_seen && !is_late &&
      context.now_s - asked_s_ < context.config.motion.stop_s) {
    return std::nullopt;
  }
  if (is_late && can_be_seen) verdict_.message += "; the arm has not come to rest";
  if (watch_id_) context.call(WatchCall{});
  if (!verdict_.isFine()) {
    // What the controller says is the effect; the robot knows the cause, and may tell it later.
    const bool is_effect = verdict_.status == ArmStatus::kTrajectoryAborted ||
                           verdict_.status == ArmStatus::kTrajectoryRefused || verdict_.status == ArmStatus::kStalled;
    const Verdict robot = context.gate.checkRobot(context.arm(), context.now_s);
    if (is_effect && !robot.isFine()) return Verdict{robot.status, robot.message + "; " + verdict_.message};
    return verdict_;
  }
  atRest(context);
  return verdict_;
}

// ---------------------------------------------------------------------------------------------------------- touch

TouchStep::TouchStep(Make make, double expected_travel_m, double* ended_at_s)
    : MotionStep("touch", WatchPhase::kContact, std::move(make)),
      expected_travel_m_(expected_travel_m),
      ended_at_s_(ended_at_s) {}

double TouchStep::travel(const StepContext& context) const {
  const motion_planning::ArmKinematics& arm = *context.model.kinematics;
  return (arm.tipPose(context.arm().joints->value.position_rad).translation() -
          arm.tipPose(trajectory().points.front().position_rad).translation())
      .norm();
}

std::optional<MotionStep::Ending> TouchStep::look(StepContext& context) {
  if (!detector_) detector_.emplace(context.config.contact);
  *ended_at_s_ = progress() * trajectory().duration();
  if (!context.arm().force) return std::nullopt;
  const ContactDetector::Contact& contact = detector_->add(*context.arm().force);
  if (contact.kind == ContactDetector::Kind::kNone) return std::nullopt;
  const double travel_m = travel(context);
  context.figures.contact_travel_m = travel_m;
  context.figures.contact_force_N = contact.force_N;
  const double stop_s = context.config.pick.contact_stop_s;
  if (contact.kind == ContactDetector::Kind::kSideways) {
    return Ending{
        {ArmStatus::kContactTooEarly,
         formatted("%.1f N across the tool after %.4f m: something beside the plate", contact.force_N, travel_m)},
        stop_s};
  }
  const double least_m = expected_travel_m_ - context.config.pick.early_m;
  if (travel_m < least_m) {
    return Ending{{ArmStatus::kContactTooEarly,
                   formatted("%.1f N after %.4f m, the plate is %.4f m away: contact must not come before %.4f m",
                             contact.force_N, travel_m, expected_travel_m_, least_m)},
                  stop_s};
  }
  return Ending{{}, stop_s};
}

Verdict TouchStep::atEnd(StepContext& context) {
  *ended_at_s_ = trajectory().duration();
  return {ArmStatus::kNoContact, formatted("no contact along %.4f m; the plate was expected after %.4f m",
                                           travel(context), expected_travel_m_)};
}

}  // namespace ur_driver_bridge
