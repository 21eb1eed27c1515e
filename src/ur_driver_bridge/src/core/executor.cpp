// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/executor.h"

#include <set>
#include <stdexcept>
#include <utility>

#include <mp700_ur5e_description/robot_names.h>

#include "requests.h"

namespace ur_driver_bridge {

/// Goes through the steps of a request, and back where one fails.
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
    gate_verdict_ = {ArmStatus::kStaleState, "no message of the arm has come yet"};
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

  void pick(const PickRequest& request) {
    if (is_holding_) throw std::logic_error("Executor: a brick is held already");
    begin(pickItems(config_, model_, request, &touched_));
    held_mass_kg_ = request.brick_mass_kg;
  }

  void letGo() {
    if (!is_holding_) return begin(letGoUnknownItems(model_));
    Items items = letGoItems(model_, held_mass_kg_, Duty::kUnlessStopped);
    if (!load_.isHolding() && held_mass_kg_ > 0.0) {
      items.push_front({std::make_unique<FirstWeighStep>("let_go", held_mass_kg_), {}});
    }
    begin(std::move(items));
  }

  void stop(const Verdict& verdict) {
    if (!isIdle() && !stop_asked_) stop_asked_ = verdict;
  }

  ExecutorOutput step(const ExecutorInputs& inputs);

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
  double passTime(double now_s);
  void feedLoad(const ArmState& arm);
  std::optional<Verdict> advance(StepContext& context);
  std::optional<Finished> conclude(const Verdict& verdict, const std::string& stage);
  Finished finish(Finished finished);
};

/// Since the step before.
double Executor::Impl::passTime(double now_s) {
  const double passed_s = last_step_s_ ? now_s - *last_step_s_ : 0.0;
  last_step_s_ = now_s;
  if (passed_s < -config_.gate.max_joint_age_s) {
    load_.reset();  // or it would wait for its samples' time to come again
    // Whoever compares stamps is blind until the clock is where it was.
    if (recovery_ == nullptr) stop({ArmStatus::kStaleState, formatted("the clock was set back by %.3f s", -passed_s)});
  }
  // A clock that was set back makes no negative time.
  const double dt_s = passed_s > 0.0 ? passed_s : 0.0;
  time_s_ += dt_s;
  return dt_s;
}

void Executor::Impl::feedLoad(const ArmState& arm) {
  if (!arm.force || !arm.joints) return;
  const Eigen::Matrix3d R_base_tip = model_.kinematics->tipPose(arm.joints->value.position_rad).linear();
  load_.add(*arm.force, R_base_tip * R_tip_tool_);
}

std::optional<Verdict> Executor::Impl::advance(StepContext& context) {
  Step& step = *items_.front().step;
  try {
    return step.advance(context);
  } catch (const std::exception& error) {
    context.call(CancelCall{});
    return Verdict{ArmStatus::kFault, step.stage() + ": " + error.what()};
  }
}

/// A step has ended: to the next one, back, or to the end of the request.
std::optional<Finished> Executor::Impl::conclude(const Verdict& verdict, const std::string& stage) {
  if (recovery_ != nullptr) recovery_commands_ = recovery_->commands();
  recovery_ = nullptr;
  Finished ended{verdict, stage, {}, {}};
  if (verdict.isFine()) {
    items_.pop_front();
    if (!items_.empty()) return std::nullopt;
    return finish(failure_.value_or(ended));
  }
  if (failure_) {
    failure_->verdict.message += "; the retreat failed, too: " + verdict.message;
    items_.clear();
    return finish(*failure_);
  }
  const Item& failed = items_.front();
  Items back;
  if (verdict.status == ArmStatus::kLostOnTheWay) {
    back = lossItems(model_);
  } else if (failed.undo) {
    back = failed.undo(verdict);
  }
  items_ = std::move(back);
  if (items_.empty()) return finish(ended);
  failure_ = ended;
  return std::nullopt;
}

Finished Executor::Impl::finish(Finished finished) {
  finished.figures = figures_;
  finished.recovery_commands = recovery_commands_;
  stop_asked_.reset();
  failure_.reset();
  open_.clear();  // what has not been answered is not waited for any longer
  return finished;
}

ExecutorOutput Executor::Impl::step(const ExecutorInputs& inputs) {
  ExecutorOutput output;
  for (const CallReply& reply : inputs.replies) open_.erase(reply.id);
  for (const TrajectoryEvent& event : inputs.events) open_.erase(event.id);
  double dt_s = passTime(inputs.gate.now_s);
  feedLoad(inputs.gate.arm);
  gate_verdict_ = gate_.check(inputs.gate, {});
  while (!items_.empty()) {
    StepContext context{config_,           model_,  gate_, load_,       figures_,     is_holding_, payload_kg_, inputs,
                        inputs.gate.now_s, time_s_, dt_s,  stop_asked_, output.calls, last_id_};
    dt_s = 0.0;
    const std::string stage = items_.front().step->stage();
    const std::optional<Verdict> verdict = advance(context);
    if (!verdict) break;
    output.finished = conclude(*verdict, stage);
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
  impl_->begin(moveItems(trajectory));
}

void Executor::pick(const PickRequest& request) {
  impl_->pick(request);
}

void Executor::letGo() {
  impl_->letGo();
}

void Executor::recover(const RecoveryPermit& permit) {
  impl_->begin(recoverItems(impl_->config_.recovery, permit));
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

}  // namespace ur_driver_bridge
