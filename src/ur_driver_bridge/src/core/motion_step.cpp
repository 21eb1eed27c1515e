// SPDX-License-Identifier: BSD-3-Clause
#include "motion_step.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>

#include "ur_driver_bridge/time_law.h"

namespace ur_driver_bridge {
namespace {

constexpr double kJoinRamp_s = 0.3;
constexpr double kFirstPoint_s = 0.03;  // of a stop: what was commanded meanwhile is made up for within it
constexpr double kRest_s = 0.05;        // an arm that swings stands for a moment at each end
constexpr double kSearch_s = 0.25;      // of trajectory time, about where the arm is believed to be
constexpr double kCause_s = 0.2;        // the robot may tell so much later why the controller gave up
constexpr double kClocks_s = 0.1;       // so far two computers' ROS times may be apart, and joint states be late

/// What the robot makes of the speed. A number that makes no sense closes the gate, and slows nothing.
double scalingOf(const StepContext& context) {
  const auto& told = context.arm().speed_scaling;
  return told && std::isfinite(told->value) ? std::clamp(told->value, 0.0, 1.0) : 1.0;
}

}  // namespace

JointTrajectory joined(const JointTrajectory& trajectory, const ArmVector& from_rad, double ramp_s) {
  if (trajectory.empty()) throw std::invalid_argument("joined: trajectory without points");
  if (!(ramp_s > 0.0)) throw std::invalid_argument("joined: ramp_s = " + std::to_string(ramp_s) + " s, must be > 0 s");
  const ArmVector offset_rad = from_rad - trajectory.points.front().position_rad;
  JointTrajectory result = trajectory;
  const double start_s = trajectory.points.front().time_s;
  const double length_s = trajectory.duration() - start_s;
  const double slower = length_s > 0.0 ? std::min(length_s / ramp_s, 1.0) : 1.0;
  for (TrajectoryPoint& point : result.points) {
    point.time_s = start_s + (point.time_s - start_s) / slower;
    point.velocity_rad_s *= slower;
    point.acceleration_rad_s2 *= slower * slower;
    const double u = length_s > 0.0 ? std::min((point.time_s - start_s) / ramp_s, 1.0) : 1.0;
    // 1 at the start, 0 after the ramp, at rest at both.
    point.position_rad += offset_rad * (1.0 - u * u * (3.0 - 2.0 * u));
    point.velocity_rad_s -= offset_rad * (6.0 * u * (1.0 - u) / ramp_s);
    if (u < 1.0) point.acceleration_rad_s2 -= offset_rad * ((6.0 - 12.0 * u) / (ramp_s * ramp_s));
  }
  // Exactly, whatever rounding makes of the last u.
  result.points.back().position_rad = trajectory.points.back().position_rad;
  result.points.back().velocity_rad_s = trajectory.points.back().velocity_rad_s * slower;
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
    if (!begun_s_) begun_s_ = context.time_s;
    const bool may_wait = context.time_s - *begun_s_ < context.config.motion.rest_timeout_s;
    const Verdict verdict = context.stop_asked ? *context.stop_asked : begin(context, may_wait);
    if (!verdict.isFine()) return verdict;
    if (trajectory_.empty()) return std::nullopt;  // the arm still swings
    // A trajectory to where the arm is already.
    if (trajectory_.duration() <= 0.0) {
      atRest(context);
      return atEnd(context);
    }
    if (context.config.gate.max_monitor_age_s > 0.0) {
      watch(context, context.now_s);
      state_ = State::kWatching;
      return std::nullopt;
    }
  } else if (state_ == State::kWatching) {
    if (const std::optional<Verdict> refusal = onWatchReply(context)) return refusal;
    std::optional<Verdict> reason = context.stop_asked ? context.stop_asked : checkGate(context);
    if (!reason && watch_call_ != 0 && context.time_s - watch_asked_s_ > context.config.motion.answer_timeout_s) {
      reason = Verdict{ArmStatus::kMonitorGone, formatted("the path monitor has not answered within %.2f s",
                                                          context.config.motion.answer_timeout_s)};
    }
    if (reason) {
      context.call(WatchCall{});  // also if it takes its time: what it watches then will never run
      return reason;
    }
    if (watch_call_ != 0) return std::nullopt;
  }
  if (state_ == State::kBegin || state_ == State::kWatching) {
    asked_s_ = context.time_s;
    send_call_ = context.call(SendCall{trajectory_});
    state_ = State::kSending;
    return std::nullopt;
  }

  if (state_ == State::kSending || state_ == State::kMoving) follow(context);
  return state_ == State::kStopping || state_ == State::kResting ? finish(context) : std::nullopt;
}

/// Leaves the trajectory empty while the arm comes to rest.
Verdict MotionStep::begin(StepContext& context, bool may_wait) {
  GateDemand demand;
  demand.needs_force = needsForce() || context.load.isHolding();
  Verdict verdict = context.gate.check(context.inputs.gate, demand);
  if (!verdict.isFine()) return verdict;
  if (const std::optional<Verdict> loss = lossOf(context)) return *loss;
  const ArmVector& arm_rad = context.arm().joints->value.position_rad;
  if (!hasRested(context)) {
    if (may_wait) return {};
    if (!endsUnrest()) {
      return {ArmStatus::kNotReady,
              formatted("the arm moves at %.3f rad/s before the motion begins, must be below %.3f rad/s",
                        context.arm().joints->value.velocity_rad_s.cwiseAbs().maxCoeff(),
                        context.config.motion.rest_rad_s)};
    }
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
  if (!rest_since_s_) rest_since_s_ = context.time_s;
  return context.time_s - *rest_since_s_ >= kRest_s;
}

void MotionStep::watch(StepContext& context, double start_s) {
  watch_call_ = context.call(WatchCall{trajectory_, start_s, watch_phase_});
  watch_start_s_ = start_s;
  watch_asked_s_ = context.time_s;
  watch_since_s_ = context.now_s;  // the monitor may speak of it before its answer
}

/// Takes the reply if it is there. A refusal, if it is one.
std::optional<Verdict> MotionStep::onWatchReply(StepContext& context) {
  const CallReply* reply = watch_call_ == 0 ? nullptr : context.replyTo(watch_call_);
  if (reply == nullptr) return std::nullopt;
  watch_call_ = 0;
  if (!reply->success) {
    return Verdict{
        ArmStatus::kMonitorGone,
        (reply->is_gone ? "no path monitor watches the path: " : "the path monitor refuses: ") + reply->message};
  }
  watch_id_ = reply->watch_id;
  watch_since_s_ = context.now_s;
  return std::nullopt;
}

std::optional<Verdict> MotionStep::checkGate(const StepContext& context) const {
  GateDemand demand;
  demand.needs_force = needsForce() || context.load.isHolding();
  // The monitor's watch ends with the trajectory's time by its own clock, and the arm may be a little behind it.
  const auto& monitor = context.inputs.gate.monitor;
  const bool has_ended = context.now_s - watch_start_s_ >= trajectory_.duration() - kClocks_s;
  if (!(has_ended && monitor && !monitor->is_watching)) demand.watch_id = watch_id_;
  demand.watch_since_s = watch_since_s_;
  const Verdict verdict = context.gate.check(context.inputs.gate, demand);
  return verdict.isFine() ? std::nullopt : std::optional<Verdict>(verdict);
}

/// What the controller says of the trajectory. Nothing: it goes on.
std::optional<Verdict> MotionStep::followEvents(const StepContext& context) {
  using Kind = TrajectoryEvent::Kind;
  for (const TrajectoryEvent& event : context.inputs.events) {
    if (event.id != send_call_) continue;
    switch (event.kind) {
      case Kind::kAccepted:
        state_ = State::kMoving;
        break;
      case Kind::kSucceeded:
        has_succeeded_ = true;
        at_s_ = trajectory_.duration();
        return Verdict{};
      case Kind::kRejected:
        return Verdict{ArmStatus::kTrajectoryRefused, "the controller refuses the trajectory: " + event.message};
      case Kind::kAborted:
        return Verdict{ArmStatus::kTrajectoryAborted, "the controller aborted the trajectory: " + event.message};
      case Kind::kCancelled:
        return Verdict{ArmStatus::kTrajectoryAborted,
                       "another client cancelled or replaced the trajectory: " + event.message};
      case Kind::kLost:
        return Verdict{ArmStatus::kDriverGone, "the controller has forgotten the trajectory: " + event.message};
    }
  }
  return std::nullopt;
}

/// Where on its way: by what the controller commands if it tells, else by where the arm is.
void MotionStep::locate(const StepContext& context) {
  const ArmState& arm = context.arm();
  // While the controller has not answered, an arm that stands stands at the start.
  if (state_ == State::kSending && context.isAtRest()) return;
  const bool is_command_told =
      arm.commanded_rad && context.now_s - arm.commanded_rad->stamp_s <= context.config.gate.max_joint_age_s;
  const ArmVector* place_rad = is_command_told ? &arm.commanded_rad->value
                               : arm.joints    ? &arm.joints->value.position_rad
                                               : nullptr;
  if (place_rad && place_rad->allFinite()) at_s_ = timeOf(trajectory_, *place_rad, at_s_, kSearch_s);
}

std::optional<Verdict> MotionStep::reasonToStop(StepContext& context) {
  const MotionConfig& config = context.config.motion;
  if (context.stop_asked) return context.stop_asked;
  if (std::optional<Verdict> reason = checkGate(context)) return reason;
  if (std::optional<Verdict> reason = onWatchReply(context)) return reason;
  if (watch_call_ != 0 && context.time_s - watch_asked_s_ > config.answer_timeout_s) {
    return Verdict{ArmStatus::kMonitorGone,
                   formatted("the path monitor has not answered within %.2f s", config.answer_timeout_s)};
  }
  if (std::optional<Verdict> reason = lossOf(context)) return reason;
  if (state_ == State::kSending && context.time_s - asked_s_ > config.answer_timeout_s) {
    return Verdict{ArmStatus::kDriverGone,
                   formatted("the controller has not answered within %.2f s", config.answer_timeout_s)};
  }
  if (elapsed_s_ > trajectory_.duration() + config.end_patience_s) {
    return Verdict{ArmStatus::kStalled, formatted("the trajectory of %.2f s has not ended after %.2f s of its own time",
                                                  trajectory_.duration(), elapsed_s_)};
  }
  const double scaling = scalingOf(context);
  if (scaling >= config.stall_speed) {
    stalled_since_s_.reset();
  } else if (!stalled_since_s_) {
    stalled_since_s_ = context.time_s;
  }
  if (stalled_since_s_ && context.time_s - *stalled_since_s_ > config.stall_patience_s) {
    return Verdict{ArmStatus::kStalled, formatted("speed scaling = %.3f for %.1f s, must be at least %.3f", scaling,
                                                  context.time_s - *stalled_since_s_, config.stall_speed)};
  }
  return std::nullopt;
}

void MotionStep::follow(StepContext& context) {
  if (const std::optional<Verdict> told = followEvents(context)) {
    rest(context, *told);
    return;
  }
  elapsed_s_ += context.dt_s * scalingOf(context);
  locate(context);
  if (const std::optional<Verdict> reason = reasonToStop(context)) {
    stop(context, *reason, context.config.motion.stop_s);
    return;
  }
  if (state_ != State::kMoving) return;
  if (const std::optional<Ending> ending = look(context)) {
    stop(context, ending->verdict, ending->stop_s);
    return;
  }
  // Slower than it was told: the monitor has to look at what is still to come, not at what it takes for that.
  if (watch_id_ && watch_call_ == 0 && (context.now_s - watch_start_s_) - at_s_ > context.config.motion.watch_drift_s) {
    watch(context, context.now_s - at_s_);
  }
}

void MotionStep::stop(StepContext& context, const Verdict& verdict, double stop_s) {
  const bool is_moving = (state_ == State::kMoving && at_s_ > 0.0) || !context.isAtRest();
  verdict_ = verdict;
  asked_s_ = context.time_s;
  is_taken_ = state_ == State::kMoving;
  rest_since_s_.reset();
  state_ = State::kStopping;
  const double scaling = scalingOf(context);
  const Verdict robot = context.gate.checkRobot(context.arm(), context.now_s);
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
  points.erase(points.begin(), std::min(first, std::prev(points.end())));
  // At the very end there is nothing to brake any more, and a controller takes no point that is over already.
  if (points.size() == 1) points.front().time_s = std::max(points.front().time_s, stop_s * scaling);
  send_call_ = context.call(SendCall{braking});
  is_braking_ = true;
  is_taken_ = false;
}

/// The controller follows nothing any more.
void MotionStep::rest(const StepContext& context, const Verdict& verdict) {
  verdict_ = verdict;
  asked_s_ = context.time_s;
  send_call_ = 0;
  state_ = State::kResting;
}

/// What the controller says of the stop, or of the trajectory that was called back.
void MotionStep::followStop(StepContext& context) {
  using Kind = TrajectoryEvent::Kind;
  const MotionConfig& config = context.config.motion;
  for (const TrajectoryEvent& event : context.inputs.events) {
    if (event.id != send_call_) continue;
    if (event.kind == Kind::kAccepted) {
      is_taken_ = true;
      // Called back before it was taken: some controllers know of nothing to cancel then.
      if (!is_braking_) context.call(CancelCall{});
      continue;
    }
    // However it ended: a stop that was refused or given up is left to the controller's own.
    if (is_braking_ && event.kind != Kind::kSucceeded) context.call(CancelCall{});
    state_ = State::kResting;
    return;
  }
  const double passed_s = context.time_s - asked_s_;
  if (is_braking_ && !is_taken_ && passed_s > config.stop_s) {
    // It still follows what was to be stopped.
    context.call(CancelCall{});
    is_braking_ = false;
  }
  if (!is_braking_ && passed_s > config.answer_timeout_s) {
    context.call(CancelCall{});
    state_ = State::kResting;
  }
}

bool MotionStep::isWaitingForRest(const StepContext& context) {
  const double passed_s = context.time_s - asked_s_;
  const auto& joints = context.arm().joints;
  if (!joints || context.now_s - joints->stamp_s > kGone_s) return false;
  if (passed_s > context.config.motion.rest_timeout_s) return false;
  if (!hasRested(context)) return true;
  // At rest only for the moment.
  if (state_ == State::kStopping) return !is_braking_ || !is_taken_ || passed_s < context.config.motion.stop_s;
  if (has_succeeded_) return passed_s < lookOn(context);
  // What isLost() goes by is to be measured at rest.
  if (verdict_.status == ArmStatus::kLostOnTheWay && context.time_s - *rest_since_s_ < context.load.lossWindow()) {
    return true;
  }
  const bool is_effect = verdict_.status == ArmStatus::kTrajectoryAborted ||
                         verdict_.status == ArmStatus::kTrajectoryRefused ||
                         verdict_.status == ArmStatus::kProgramStopped;
  const Verdict cause = causeOf(context);
  const bool is_cause_told = !cause.isFine() && cause.status != ArmStatus::kProgramStopped;
  return is_effect && passed_s < kCause_s && !is_cause_told;
}

Verdict MotionStep::causeOf(const StepContext& context) const {
  const Verdict robot = context.gate.checkRobot(context.arm(), context.now_s);
  return robot.status == verdict_.status ? Verdict{} : robot;
}

std::optional<Verdict> MotionStep::finish(StepContext& context) {
  if (state_ == State::kStopping) followStop(context);
  if (has_succeeded_) {
    // What the last samples tell came before the end.
    if (const std::optional<Ending> ending = look(context)) {
      verdict_ = ending->verdict;
      has_succeeded_ = false;
    }
  }
  if (isWaitingForRest(context)) return std::nullopt;
  if (!context.isAtRest()) {
    context.call(CancelCall{});
    const Verdict robot = context.gate.checkRobot(context.arm(), context.now_s);
    if (!verdict_.isFine()) {
      verdict_.message += "; the arm has not come to rest";
    } else {
      verdict_ = robot.isFine() ? atUnrest() : robot;
    }
  }
  if (watch_id_ || watch_call_ != 0) context.call(WatchCall{});
  if (context.arm().joints && context.arm().joints->value.position_rad.allFinite()) {
    at_s_ = timeOf(trajectory_, context.arm().joints->value.position_rad, at_s_, kSearch_s);
  }
  atRest(context);
  if (verdict_.isFine()) return has_succeeded_ ? atEnd(context) : verdict_;
  if (verdict_.status == ArmStatus::kLostOnTheWay && !lossOf(context)) {
    verdict_ = {ArmStatus::kPathBlocked, "the weight is back: something pushed the brick; " + verdict_.message};
  }
  // What controller, weight and program tell is the effect; the robot knows the cause. recover weighs again.
  const bool is_effect = verdict_.status == ArmStatus::kTrajectoryAborted ||
                         verdict_.status == ArmStatus::kTrajectoryRefused || verdict_.status == ArmStatus::kStalled ||
                         verdict_.status == ArmStatus::kLostOnTheWay || verdict_.status == ArmStatus::kProgramStopped;
  const Verdict cause = causeOf(context);
  if (is_effect && !cause.isFine()) return Verdict{cause.status, cause.message + "; " + verdict_.message};
  return verdict_;
}

// ---------------------------------------------------------------------------------------------------------- touch

TouchStep::TouchStep(Make make, double expected_travel_m, Touched* touched)
    : MotionStep("touch", WatchPhase::kContact, std::move(make)),
      expected_travel_m_(expected_travel_m),
      touched_(touched) {
  touched_->no_contact.clear();
}

double TouchStep::travel(const StepContext& context) const {
  const motion_planning::ArmKinematics& arm = *context.model.kinematics;
  const auto& joints = context.arm().joints;
  return (arm.tipPose(joints ? joints->value.position_rad : trajectory().sample(place()).position_rad).translation() -
          arm.tipPose(trajectory().points.front().position_rad).translation())
      .norm();
}

std::optional<MotionStep::Ending> TouchStep::look(StepContext& context) {
  if (!detector_) detector_.emplace(context.config.contact);
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
  // A loose brick that is touched from the side slides away before it pushes back: whether the magnet has met its plate
  // tells the weight.
  touched_->no_contact =
      formatted("no contact along %.4f m; the plate was expected after %.4f m", travel(context), expected_travel_m_);
  return {};
}

LiftStep::LiftStep(const char* stage, Make make, double brick_mass_kg, std::shared_ptr<Lifted> lifted)
    : MotionStep(stage, WatchPhase::kLift, std::move(make)),
      brick_mass_kg_(brick_mass_kg),
      lifted_(std::move(lifted)) {}

std::optional<MotionStep::Ending> LiftStep::look(StepContext& context) {
  const double most_kg = (context.config.load.max_share - 1.0) * brick_mass_kg_;
  const double excess_kg = context.load.excess().value_or(0.0);
  if (excess_kg <= most_kg) return std::nullopt;
  return Ending{
      {ArmStatus::kNotAttached,
       formatted("%.2f kg beside the brick pull at the magnet, must be at most %.2f kg: it takes something along",
                 excess_kg, most_kg)},
      context.config.pick.contact_stop_s};
}

std::optional<MotionStep::Ending> PutBackStep::look(StepContext& context) {
  context.load.release();  // or its weight on the ground would count as a loss
  return std::nullopt;
}

}  // namespace ur_driver_bridge
