// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/executor.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <deque>
#include <functional>
#include <set>
#include <stdexcept>

#include <mp700_ur5e_description/robot_names.h>

#include "motion_step.h"
#include "tool_steps.h"
#include "ur_driver_bridge/time_law.h"

namespace ur_driver_bridge {

std::optional<Verdict> lossOf(const StepContext& context) {
  if (!context.load.isHolding() || !context.load.isLost()) return std::nullopt;
  return Verdict{ArmStatus::kLostOnTheWay, formatted("the brick's weight is gone: %.2f kg beside the declared payload",
                                                     context.load.load().value_or(0.0))};
}

std::string formatted(const char* format, ...) {
  char text[512];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  return text;
}

namespace {

using StepPointer = std::unique_ptr<Step>;

/// A step, and what is done if it fails: back to where nothing is touched, before the request ends with the failure.
struct Item {
  StepPointer step;
  std::function<std::deque<Item>(const Verdict&)> undo;
};
using Items = std::deque<Item>;

}  // namespace

class Executor::Impl {
 public:
  Impl(const ExecutorConfig& config, const ArmModel& model)
      : config_(interactive_mapping::requireValid("impossible executor:", config)),
        model_(model),
        gate_(config.gate),
        load_(config.load) {
    if (!model_.kinematics) throw std::invalid_argument("Executor: no kinematics");
    const mp700_ur5e_description::RobotModel& robot = model_.kinematics->robot();
    namespace names = mp700_ur5e_description;
    R_tip_tool_ = (robot.poseInBody(names::kMagnetTipFrame).inverse() * robot.poseInBody(names::kToolFrame)).linear();
    payload_kg_ = model_.tool.mass_kg;
    gate_verdict_ = {ArmStatus::kStaleState, "nothing has been heard of the arm yet"};
  }

  void begin(Items items) {
    if (!isIdle()) throw std::logic_error("Executor: a request goes on already");
    items_ = std::move(items);
    figures_ = {};
    stop_asked_.reset();
    failure_.reset();
    // The recovery's commands are asked for when it has ended.
    recovery_ = dynamic_cast<RecoverStep*>(items_.front().step.get());
    recovery_commands_.clear();
  }

  bool isIdle() const { return items_.empty(); }

  Items pickItems(const PickRequest& request);
  Items checkItems(const std::shared_ptr<const PickRequest>& request) const;
  /// What is stopped or begun within a motion adds to its accelerations.
  JointTrajectory gentle(const JointTrajectory& trajectory) const {
    return withinAcceleration(trajectory, config_.motion.acceleration_rad_s2);
  }
  Items letGoItems(double brick_mass_kg, Duty duty) const;
  Items lossItems() const;

  void stop(const Verdict& verdict) {
    if (!isIdle() && !stop_asked_) stop_asked_ = verdict;
  }

  ExecutorOutput step(const ExecutorInputs& inputs);

  template <typename Make>
  static Item motion(const std::string& stage, WatchPhase watch, Make make) {
    return {std::make_unique<MotionStep>(stage, watch, make), {}};
  }

  ExecutorConfig config_;
  ArmModel model_;
  SafetyGate gate_;
  LoadCell load_;
  Eigen::Matrix3d R_tip_tool_;

  Items items_;
  std::optional<Verdict> stop_asked_;
  std::optional<Finished> failure_;  // of the step that is being undone
  PickFigures figures_;
  const RecoverStep* recovery_{nullptr};  // while it goes on
  std::vector<std::string> recovery_commands_;
  bool is_holding_{false};
  double held_mass_kg_{0.0};
  double payload_kg_{0.0};  // declared
  TouchStep::Touched touched_;
  Verdict gate_verdict_;
  std::uint64_t last_id_{0};
  std::set<std::uint64_t> open_;  // calls without an answer
  std::optional<double> last_step_s_;
  double time_s_{0.0};  // of all steps, without what the clock was set back by

 private:
  void feedLoad(const ArmState& arm);
  double timeAtRise(const JointTrajectory& trajectory, double rise_m) const;
  static Finished finished(const Verdict& verdict, const std::string& stage) { return {verdict, stage, {}, {}}; }
};

void Executor::Impl::feedLoad(const ArmState& arm) {
  if (!arm.force || !arm.joints) return;
  const Eigen::Matrix3d R_base_tip = model_.kinematics->tipPose(arm.joints->value.position_rad).linear();
  load_.add(*arm.force, R_base_tip * R_tip_tool_);
}

/// When the tip has gone `rise_m` from the start, or the end.
double Executor::Impl::timeAtRise(const JointTrajectory& trajectory, double rise_m) const {
  constexpr double kSample_s = 0.01;  // a millimetre at 0.1 m/s
  const auto tip = [this](const ArmVector& joints_rad) {
    return Eigen::Vector3d(model_.kinematics->tipPose(joints_rad).translation());
  };
  const Eigen::Vector3d start = tip(trajectory.points.front().position_rad);
  for (double s = trajectory.points.front().time_s; s < trajectory.duration(); s += kSample_s) {
    if ((tip(trajectory.sample(s).position_rad) - start).norm() >= rise_m) return s;
  }
  return trajectory.duration();
}

Items Executor::Impl::letGoItems(double brick_mass_kg, Duty duty) const {
  Items items;
  items.push_back({std::make_unique<MagnetStep>("let_go", false, duty), {}});
  if (brick_mass_kg > 0.0) items.push_back({std::make_unique<GoneStep>("let_go"), {}});
  items.push_back({std::make_unique<AttachStep>("let_go", false), {}});
  items.push_back({std::make_unique<PayloadStep>("let_go", model_.tool, Duty::kAlways), {}});
  return items;
}

/// Nothing is held any more, and everybody has to know, first of all.
Items Executor::Impl::lossItems() const {
  Items items;
  items.push_back({std::make_unique<AttachStep>("let_go", false), {}});
  items.push_back({std::make_unique<MagnetStep>("let_go", false, Duty::kAlways), {}});
  items.push_back({std::make_unique<PayloadStep>("let_go", model_.tool, Duty::kAlways), {}});
  return items;
}

/// All four trajectories before the first one begins: a brick in the air is no place to find the next one impossible.
Items Executor::Impl::checkItems(const std::shared_ptr<const PickRequest>& request) const {
  TrajectoryLimits limits = model_.limits;
  limits.acceleration_rad_s2.setConstant(config_.motion.acceleration_rad_s2);
  const double tolerance_rad = config_.motion.start_tolerance_rad;
  Items items;
  const auto add = [&](const std::string& stage, const JointTrajectory& trajectory, auto starts_at) {
    const auto check = [request, limits, tolerance_rad, &trajectory, starts_at](const StepContext&) {
      const Verdict verdict = checkTrajectory(trajectory, limits);
      if (!verdict.isFine()) return verdict;
      const std::optional<ArmVector> start_rad = starts_at(*request);
      return start_rad ? checkStart(trajectory, *start_rad, limits.joints, tolerance_rad) : Verdict{};
    };
    items.push_back({std::make_unique<CheckStep>(stage, check), {}});
  };
  using Start = std::optional<ArmVector>;
  add("approach", request->approach, [](const PickRequest&) { return Start(); });
  add("touch", request->touch, [](const PickRequest& pick) { return Start(pick.approach.points.back().position_rad); });
  // Anywhere on the touch, for that ends where there is contact.
  add("lift", request->lift, [](const PickRequest& pick) {
    const double at_s = timeOf(pick.touch, pick.lift.points.front().position_rad, 0.0, pick.touch.duration());
    return Start(pick.touch.sample(at_s).position_rad);
  });
  if (!request->stow.empty()) {
    add("stow", request->stow, [](const PickRequest& pick) { return Start(pick.lift.points.back().position_rad); });
  }
  return items;
}

Items Executor::Impl::pickItems(const PickRequest& request) {
  const PickConfig& pick = config_.pick;
  const auto shared = std::make_shared<const PickRequest>(request);
  const std::size_t points =
      std::min({request.approach.points.size(), request.touch.points.size(), request.lift.points.size()});
  if (points == 0) throw std::invalid_argument("pick: approach, touch and lift must have points");
  if (!(request.brick_mass_kg > 0.0 && std::isfinite(request.brick_mass_kg))) {
    throw std::invalid_argument(
        formatted("pick: brick_mass_kg = %g kg, must be > 0 kg and finite", request.brick_mass_kg));
  }
  if (!(request.contact_travel_m >= 0.0 && std::isfinite(request.contact_travel_m))) {
    throw std::invalid_argument(
        formatted("pick: contact_travel_m = %g m, must be >= 0 m and finite", request.contact_travel_m));
  }
  Payload payload;
  payload.mass_kg = model_.tool.mass_kg + request.brick_mass_kg;
  const Eigen::Isometry3d T_tool_tip =
      model_.kinematics->robot().poseInBody(mp700_ur5e_description::kToolFrame).inverse() *
      model_.kinematics->robot().poseInBody(mp700_ur5e_description::kMagnetTipFrame);
  payload.centre_m = (model_.tool.mass_kg * model_.tool.centre_m +
                      request.brick_mass_kg * (T_tool_tip * request.T_tip_brick.translation())) /
                     payload.mass_kg;
  if (!payload.centre_m.allFinite()) throw std::invalid_argument("pick: T_tip_brick is not finite");
  if (!(payload.mass_kg <= model_.max_payload_kg)) {
    throw std::invalid_argument(formatted("pick: tool and brick weigh %.2f kg, must be at most %.2f kg",
                                          payload.mass_kg, model_.max_payload_kg));
  }

  // Back the way the magnet came, from wherever the touch has ended.
  const auto retreat = [this](const Verdict&) {
    Items items;
    items.push_back(motion("retreat", WatchPhase::kContact, [this] {
      return gentle(reversed(upTo(touched_.trajectory, touched_.at_s, config_.pick.ramp_s)));
    }));
    return items;
  };
  const auto offAndRetreat = [this, retreat](const Verdict& verdict) {
    Items items = letGoItems(0.0, Duty::kAlways);
    for (Item& item : retreat(verdict)) items.push_back(std::move(item));
    return items;
  };
  const double weigh_s = timeAtRise(request.lift, pick.weigh_height_m);
  // From where the touch has ended, which is not quite where the lift was planned to begin: the difference fades all the
  // way, or the magnet would first be pressed down to there.
  const auto littleLift = [this, shared, weigh_s] {
    const JointTrajectory lift = upTo(shared->lift, weigh_s, config_.pick.ramp_s);
    if (lift.duration() <= 0.0) return lift;
    return gentle(joined(lift, touched_.trajectory.sample(touched_.at_s).position_rad, lift.duration()));
  };
  // What hangs there is put back where it was, whatever it is; then away from it.
  const auto putBack = [littleLift, offAndRetreat](const Verdict& verdict) {
    Items items;
    items.push_back(motion("put_back", WatchPhase::kLift, [littleLift] { return reversed(littleLift()); }));
    for (Item& item : offAndRetreat(verdict)) items.push_back(std::move(item));
    return items;
  };

  Items items = checkItems(shared);
  items.push_back(motion("approach", WatchPhase::kFree, [shared] { return shared->approach; }));
  items.push_back({std::make_unique<ZeroForceStep>("zero"), {}});
  items.push_back({std::make_unique<TouchStep>([shared] { return shared->touch; }, request.contact_travel_m, &touched_),
                   [retreat](const Verdict& verdict) {
                     return verdict.status == ArmStatus::kContactTooEarly ? retreat(verdict) : Items{};
                   }});
  items.push_back(
      {std::make_unique<MagnetStep>("magnet", true, Duty::kIfGateIsOpen), [offAndRetreat](const Verdict& verdict) {
         // It may be on, but it has been called for in vain.
         const bool is_called = verdict.status == ArmStatus::kIoRefused || verdict.status == ArmStatus::kDriverGone;
         return is_called ? offAndRetreat(verdict) : Items{};
       }});
  items.push_back({std::make_unique<AttachStep>("magnet", true), {}});
  items.push_back(motion("lift_a_little", WatchPhase::kLift, littleLift));
  items.push_back({std::make_unique<WeighStep>("weigh", request.brick_mass_kg, &touched_.no_contact),
                   [putBack](const Verdict& verdict) {
                     const bool is_weighed =
                         verdict.status == ArmStatus::kNotAttached || verdict.status == ArmStatus::kNoContact;
                     return is_weighed ? putBack(verdict) : Items{};
                   }});
  items.push_back({std::make_unique<PayloadStep>("payload", payload, Duty::kUnlessStopped), {}});
  items.push_back({std::make_unique<HoldStep>("payload", request.brick_mass_kg), {}});
  if (weigh_s < request.lift.duration()) {
    items.push_back(motion("lift", WatchPhase::kLift, [this, shared, weigh_s] {
      return gentle(resume(shared->lift, weigh_s, config_.pick.ramp_s));
    }));
  }
  if (!request.stow.empty()) {
    items.push_back(motion("stow", WatchPhase::kFree, [shared] { return shared->stow; }));
  }
  if (request.lets_go) {
    for (Item& item : letGoItems(request.brick_mass_kg, Duty::kIfGateIsOpen)) items.push_back(std::move(item));
  }
  return items;
}

ExecutorOutput Executor::Impl::step(const ExecutorInputs& inputs) {
  ExecutorOutput output;
  for (const CallReply& reply : inputs.replies) open_.erase(reply.id);
  for (const TrajectoryEvent& event : inputs.events) open_.erase(event.id);
  const double now_s = inputs.gate.now_s;
  // A clock that was set back makes no negative time.
  const double passed_s = last_step_s_ ? now_s - *last_step_s_ : 0.0;
  const double dt_s = passed_s > 0.0 ? passed_s : 0.0;
  time_s_ += dt_s;
  last_step_s_ = now_s;
  if (passed_s < -config_.gate.max_joint_age_s) {
    load_.reset();  // or it would wait for its samples' time to come again
    // Whoever compares stamps is blind until the clock is where it was.
    if (recovery_ == nullptr) stop({ArmStatus::kStaleState, formatted("the clock was set back by %.3f s", -passed_s)});
  }
  feedLoad(inputs.gate.arm);
  gate_verdict_ = gate_.check(inputs.gate, {});

  bool is_first = true;
  while (!items_.empty()) {
    StepContext context{config_,
                        model_,
                        gate_,
                        load_,
                        figures_,
                        is_holding_,
                        payload_kg_,
                        inputs,
                        now_s,
                        time_s_,
                        is_first ? dt_s : 0.0,
                        stop_asked_,
                        output.calls,
                        last_id_};
    is_first = false;
    Item& item = items_.front();
    Verdict verdict;
    try {
      const std::optional<Verdict> ended = item.step->advance(context);
      if (!ended) break;
      verdict = *ended;
    } catch (const std::exception& error) {
      context.call(CancelCall{});
      verdict = {ArmStatus::kFault, item.step->stage() + ": " + error.what()};
    }
    const std::string stage = item.step->stage();
    if (recovery_ != nullptr) {
      recovery_commands_ = recovery_->commands();
      recovery_ = nullptr;
    }
    if (verdict.isFine()) {
      items_.pop_front();
      if (!items_.empty()) continue;
      output.finished = failure_ ? *failure_ : finished(verdict, stage);
    } else if (failure_) {
      failure_->verdict.message += "; the way back failed, too: " + verdict.message;
      items_.clear();
      output.finished = *failure_;
    } else {
      if (verdict.status == ArmStatus::kLostOnTheWay) {
        failure_ = finished(verdict, stage);
        items_ = lossItems();
        continue;
      }
      Items undo = item.undo ? item.undo(verdict) : Items{};
      items_.clear();
      if (!undo.empty()) {
        failure_ = finished(verdict, stage);
        items_ = std::move(undo);
        continue;
      }
      output.finished = finished(verdict, stage);
    }
    output.finished->figures = figures_;
    output.finished->recovery_commands = recovery_commands_;
    stop_asked_.reset();
    failure_.reset();
    open_.clear();  // what has not been answered is not waited for any longer
  }
  for (const ArmCall& call : output.calls) {
    const bool is_answered =
        !std::holds_alternative<CancelCall>(call.what) && !std::holds_alternative<AttachCall>(call.what);
    if (is_answered) open_.insert(call.id);
  }
  return output;
}

Executor::Executor(const ExecutorConfig& config, const ArmModel& model)
    : impl_(std::make_unique<Impl>(config, model)) {}
Executor::~Executor() = default;

void Executor::move(const JointTrajectory& trajectory) {
  Items items;
  items.push_back(Impl::motion("move", WatchPhase::kFree, [trajectory] { return trajectory; }));
  impl_->begin(std::move(items));
}

void Executor::pick(const PickRequest& request) {
  if (impl_->is_holding_) throw std::logic_error("Executor: a brick is held already");
  impl_->begin(impl_->pickItems(request));
  impl_->held_mass_kg_ = request.brick_mass_kg;
}

void Executor::letGo() {
  Items items = impl_->letGoItems(impl_->is_holding_ ? impl_->held_mass_kg_ : 0.0, Duty::kUnlessStopped);
  if (impl_->is_holding_ && !impl_->load_.isHolding() && impl_->held_mass_kg_ > 0.0) {
    items.push_front({std::make_unique<FirstWeighStep>("let_go", impl_->held_mass_kg_), {}});
  }
  if (!impl_->is_holding_) {
    // A magnet that may be on is switched off all the same: nobody knows what hung there when the node began.
    const auto check = [](const StepContext& context) {
      const auto& output = context.arm().digital_out;
      const bool is_off = output && !output->value[static_cast<std::size_t>(context.config.magnet.digital_output)];
      return is_off ? Verdict{ArmStatus::kNothingHeld, "the magnet is off, and holds nothing"} : Verdict{};
    };
    items.push_front({std::make_unique<CheckStep>("let_go", check), {}});
  }
  impl_->begin(std::move(items));
}

void Executor::recover(const RecoveryPermit& permit) {
  Items items;
  items.push_back({std::make_unique<RecoverStep>(impl_->config_.recovery, permit), {}});
  // What stopped the robot may have cost it the brick; who believes in it plans no way out of where it is said to be.
  items.push_back({std::make_unique<StillThereStep>("recover"), {}});
  impl_->begin(std::move(items));
}

void Executor::stop(const Verdict& verdict) {
  impl_->stop(verdict);
}

ExecutorOutput Executor::step(const ExecutorInputs& inputs) {
  return impl_->step(inputs);
}

bool Executor::isIdle() const {
  return impl_->isIdle();
}

ExecutorPhase Executor::phase() const {
  return impl_->isIdle() ? ExecutorPhase::kIdle : impl_->items_.front().step->phase();
}

std::string Executor::stage() const {
  return impl_->isIdle() ? "" : impl_->items_.front().step->stage();
}

double Executor::progress() const {
  return impl_->isIdle() ? 0.0 : impl_->items_.front().step->progress();
}

bool Executor::isHolding() const {
  return impl_->is_holding_;
}

bool Executor::isWaitingForReply() const {
  return !impl_->open_.empty();
}

std::optional<double> Executor::load() const {
  return impl_->load_.load();
}

Verdict Executor::gate() const {
  return impl_->gate_verdict_;
}

const ExecutorConfig& Executor::config() const {
  return impl_->config_;
}

}  // namespace ur_driver_bridge
