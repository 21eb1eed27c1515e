// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/mission_machine.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "mission.h"
#include "wording.h"

namespace pick_mission {
namespace {

Memory emptyMemory(const MissionConfig& config) {
  interactive_mapping::requireValid("impossible mission:", config);
  return Memory({config.attempts.max_picks_per_brick, config.attempts.max_plans_per_brick, config.bricks});
}

/// A mission that its operator had interrupted, or was about to, must not go on by itself after a crash.
std::optional<State> stateToWaitIn(const Mission& mission) {
  const bool is_halting = mission.state == State::kHalting;
  if (mission.state == State::kHeld || (is_halting && mission.halt_for == HaltFor::kHold)) return State::kHeld;
  if (mission.state == State::kPaused || (is_halting && mission.halt_for == HaltFor::kStop)) return State::kPaused;
  if (mission.is_pause_wanted) return State::kPaused;
  return std::nullopt;
}

}  // namespace

/// Events come in, transitions are taken, commands and log entries go out.
class MissionMachine::Impl {
 public:
  Impl(const MissionConfig& config, MissionInfo info) : mission_{config, std::move(info), emptyMemory(config)} {}
  Impl(const MissionConfig& config, MissionInfo info, const nlohmann::json& saved) : Impl(config, std::move(info)) {
    restore(saved, mission_.memory);
    const Memory& memory = mission_.memory;
    mission_.state = memory.has_ended ? State::kEnded : memory.waits_in.value_or(State::kIdle);
  }

  MissionOutput step(const Event& event, double now_s);
  const Mission& mission() const { return mission_; }

 private:
  void requireFits(const event::Reply& reply) const;
  void advanceTime(const event::ClockJump* jump, double now_s);

  void on(const event::Start& start);
  void on(const event::Reply& reply);
  void on(const event::HandReport& report);
  void on(const event::PileLeft& left);
  void on(const event::Tick& tick);
  void on(const event::Pause& pause);
  void on(const event::Resume& resume);
  void on(const event::Hold& hold);
  void on(const event::Stop& stop);
  void on(const event::Unloaded& unloaded);
  void on(const event::ClockJump& jump);
  void onEndAfterCancel(const event::Reply& reply, bool is_broken_off);
  void onEndBeside(const event::Reply& reply);
  bool mayPause() const;

  bool fire(Trigger trigger, const Cause& cause);
  void fireFor(const Reaction& reaction, Cause cause);
  void enter();
  void note(const std::string& event, const std::string& reason) { log(event, reason, mission_.state); }
  void log(const std::string& event, const std::string& reason, State decision);
  void control(std::uint64_t id, Command::Body body) { output_.commands.push_back({id, std::move(body)}); }
  void release();
  Mission::Running takeRunning();

  Mission mission_;
  std::optional<double> last_step_s_;
  MissionOutput output_;
};

MissionOutput MissionMachine::Impl::step(const Event& event, double now_s) {
  if (!std::isfinite(now_s)) throw std::invalid_argument("now = " + std::to_string(now_s) + " s, must be finite");
  if (const auto* reply = std::get_if<event::Reply>(&event)) requireFits(*reply);
  const auto* jump = std::get_if<event::ClockJump>(&event);
  if (jump != nullptr && !std::isfinite(jump->by_s)) {
    throw std::invalid_argument("a clock's jump = " + std::to_string(jump->by_s) + " s, must be finite");
  }
  advanceTime(jump, now_s);
  output_ = {};
  std::visit([this](const auto& e) { on(e); }, event);
  mission_.memory.has_ended = mission_.state == State::kEnded;
  mission_.memory.waits_in = stateToWaitIn(mission_);
  return std::move(output_);
}

void MissionMachine::Impl::requireFits(const event::Reply& reply) const {
  if (mission_.carrying && reply.id == mission_.carrying->id) reactTo(State::kPick, reply.result);
  if (!mission_.running || reply.id != mission_.running->id) return;
  reactTo(mission_.running->action, reply.result);  // throws if it cannot be
  const auto* selection = std::get_if<SelectionResult>(&reply.result);
  if (selection != nullptr && selection->status == SelectionStatus::kSuccess && !selection->T_map_base) {
    throw std::invalid_argument("a selection that succeeded has no standing pose, must have one");
  }
}

/// A clock that is set does not change how long a state has lasted. One that is set back (a looped bag, a simulation
/// that restarts) takes no used time back.
void MissionMachine::Impl::advanceTime(const event::ClockJump* jump, double now_s) {
  mission_.now_s = now_s;
  if (!last_step_s_) {
    mission_.state_since_s = now_s;
  } else {
    const double jump_s = jump != nullptr ? jump->by_s : 0.0;
    const double passed_s = now_s - (*last_step_s_ + jump_s);
    mission_.state_since_s += jump_s;
    mission_.state_since_s += std::min(passed_s, 0.0);
    const bool is_active = isAction(mission_.state) || mission_.state == State::kHalting;
    if (is_active) mission_.memory.used_s += std::max(passed_s, 0.0);
  }
  last_step_s_ = now_s;
}

// --- Events ---------------------------------------------------------------------------------------------------------

void MissionMachine::Impl::on(const event::Start& start) {
  if (mission_.state != State::kIdle) return note("start", "ignored: it has begun");
  Memory& memory = mission_.memory;
  memory.base = start.T_map_base;
  if (!memory.start_pose) memory.start_pose = start.start_pose.value_or(start.T_map_base);
  memory.places_used = std::max(memory.places_used, start.places_used);
  if (start.brick_in_hand) memory.brick_in_hand = start.brick_in_hand;
  setHand(start.hand, mission_);
  mission_.arm = ArmIs::kAnywhere;
  fire(Trigger::kStart, {"start", std::string("hand ") + toString(mission_.hand)});
}

void MissionMachine::Impl::on(const event::Reply& reply) {
  if (mission_.carrying && reply.id == mission_.carrying->id) return onEndBeside(reply);
  if (!mission_.running || reply.id != mission_.running->id) {
    return note("reply " + std::to_string(reply.id), "ignored: not of a running action");
  }
  if (mission_.state == State::kHalting) return onEndAfterCancel(reply, mission_.halt_for != HaltFor::kTimeout);
  const Mission::Running ended = takeRunning();
  const Reaction reaction = reactTo(ended.action, reply.result);
  record(ended, reply, reaction, false, mission_);
  fireFor(reaction, {toString(reply.result), withMessage(reaction.why, reply.message), ended.action, reaction.end});
}

/// Of the pick that carries its brick away. Stowed: what looks for the next one goes on. Else that is worth nothing, for the
/// pile or the arm is another than was thought.
void MissionMachine::Impl::onEndBeside(const event::Reply& reply) {
  const Reaction reaction = reactTo(State::kPick, reply.result);
  std::optional<Mission::Running> looking = mission_.running;
  takeUpPick(mission_);
  record(takeRunning(), reply, reaction, false, mission_);
  if (isSuccess(reply.result) && mission_.hand == Hand::kEmpty) {
    mission_.running = looking;
    return note(toString(reply.result),
                "of the pick beside: " + std::to_string(numPicked(mission_.memory)) + " picked");
  }
  log(toString(reply.result), "of the pick beside: what was looked for is dropped", State::kPick);
  mission_.state = State::kPick;
  fireFor(reaction, {toString(reply.result), withMessage(reaction.why, reply.message), State::kPick, reaction.end});
}

void MissionMachine::Impl::on(const event::PileLeft& left) {
  const bool is_of_pick = mission_.running && mission_.running->id == left.id && mission_.state == State::kPick;
  if (is_of_pick) fire(Trigger::kPileLeft, {"pile left", ""});
}

void MissionMachine::Impl::on(const event::HandReport& report) {
  if (report.brick_in_hand) mission_.memory.brick_in_hand = report.brick_in_hand;
  // The reply of an action says what it did to the hand, or that of the wait for the arm after it: a bridge that has
  // just come back has not heard of its magnet yet.
  const bool is_handled = mission_.carrying || (mission_.running && handlesBrick(mission_.running->action));
  if (mission_.memory.is_let_go_open || is_handled) return;
  if (report.hand == mission_.hand) return;
  const Hand before = mission_.hand;
  setHand(report.hand, mission_);
  note("hand", std::string(toString(before)) + ", now " + toString(mission_.hand));
}

void MissionMachine::Impl::on(const event::Tick& /*tick*/) {
  if (!mission_.running) return;
  const MissionConfig& config = mission_.config;
  const double lasts_s = mission_.now_s - mission_.state_since_s;
  if (mission_.state == State::kHalting) {
    if (lasts_s < config.time.cancel_timeout_s) return;
    event::Reply reply;
    reply.id = mission_.running->id;
    reply.result = NoAnswer{};
    reply.message = "did not end within " + std::to_string(config.time.cancel_timeout_s) + " s of being cancelled";
    return onEndAfterCancel(reply, false);
  }
  if (holds(Guard::kTimeUp, mission_) && holds(Guard::kMayBreakOff, mission_)) {
    fire(Trigger::kTimeUp, {"tick", "time is up"});
  } else if (lasts_s >= config.time.action_timeout_s) {
    fire(Trigger::kActionTimeout, {"tick", "no result within " + std::to_string(config.time.action_timeout_s) + " s"});
  }
}

bool MissionMachine::Impl::mayPause() const {
  return isAction(mission_.state) || mission_.state == State::kUnload ||
         (mission_.state == State::kHalting && mission_.halt_for == HaltFor::kTimeout);
}

void MissionMachine::Impl::on(const event::Pause& /*pause*/) {
  if (!mayPause()) return note("pause", "ignored: nothing is running");
  mission_.is_pause_wanted = true;
  note("pause", "when the running action has ended");
}

void MissionMachine::Impl::on(const event::Resume& resume) {
  if (mission_.is_pause_wanted && mayPause()) {
    mission_.is_pause_wanted = false;
    return note("resume", "continues without a pause");
  }
  if (mission_.state == State::kHalting && mission_.halt_for == HaltFor::kHold) {
    mission_.halt_for = HaltFor::kResume;
    release();
    forgetTries(mission_, resume.T_map_base);
    return note("resume", "when the running action has ended");
  }
  if (mission_.state == State::kHeld) release();
  Cause cause{"resume", "after a fresh inspection"};
  cause.T_map_base = resume.T_map_base;
  if (fire(Trigger::kResume, cause)) return;
  if (!mission_.memory.is_hold_given) return note("resume", "ignored: nothing is interrupted");
  release();  // of a hold before the mission or after it
  note("resume", "passed on: nothing is interrupted");
}

void MissionMachine::Impl::on(const event::Hold& /*hold*/) {
  mission_.memory.is_hold_given = true;
  control(0, command::Hold{});  // whatever the mission does: the arm shall not move
  mission_.is_pause_wanted = false;
  if (mission_.state == State::kHalting) {
    if (!holds(Guard::kForEnd, mission_)) mission_.halt_for = HaltFor::kHold;
    return note("hold", "already halting");
  }
  if (!fire(Trigger::kHold, {"hold", "of the operator"})) note("hold", "passed on: nothing is running");
}

void MissionMachine::Impl::on(const event::Stop& /*stop*/) {
  mission_.is_pause_wanted = false;
  if (mission_.state == State::kHalting) {
    mission_.halt_for = HaltFor::kStop;
    return note("stop", "when the running action has ended");
  }
  if (!fire(Trigger::kStop, {"stop", "of the operator"})) note("stop", "ignored: nothing is running");
}

void MissionMachine::Impl::on(const event::Unloaded& /*unloaded*/) {
  if (isAction(mission_.state) || mission_.state == State::kHalting) {
    return note("unloaded", "ignored: the robot may move; pause it before");
  }
  mission_.memory.places_used = 0;
  if (!fire(Trigger::kUnloaded, {"unloaded", ""})) note("unloaded", "the container is empty");
}

void MissionMachine::Impl::on(const event::ClockJump& jump) {
  note("clock", "was set by " + std::to_string(jump.by_s) + " s, which do not count");
}

/// A cancelled action has ended. `is_broken_off`: its failure counts for nothing. One that was cancelled for taking too
/// long counts as unanswered.
void MissionMachine::Impl::onEndAfterCancel(const event::Reply& reply, bool is_broken_off) {
  const Mission::Running ended = takeRunning();
  const std::string status = toString(reply.result);
  const bool is_timeout = mission_.halt_for == HaltFor::kTimeout;
  if (isSuccess(reply.result)) {
    record(ended, reply, reactTo(ended.action, reply.result), true, mission_);
    if (is_timeout) {
      fire(Trigger::kRetryHere, {status, "it had just ended; look again"});
    } else {
      fire(Trigger::kHalted, {status, "it had just ended"});
    }
    return;
  }
  event::Reply counted = reply;
  if (is_timeout) counted.result = NoAnswer{};
  const Reaction reaction = reactTo(ended.action, counted.result);
  record(ended, counted, reaction, is_broken_off, mission_);
  if (is_timeout) {
    fireFor(reaction, {"no answer", withMessage(reaction.why, "took too long"), ended.action, reaction.end});
  } else {
    fire(Trigger::kHalted, {status, withMessage("has ended", reply.message)});
  }
}

// --- Transitions ----------------------------------------------------------------------------------------------------

/// False: no row of the table fits, and nothing has changed.
bool MissionMachine::Impl::fire(Trigger trigger, const Cause& cause) {
  const Transition* row =
      nextTransition(mission_.state, trigger, [this](Guard guard) { return holds(guard, mission_); });
  if (row == nullptr) return false;
  apply(row->effect, cause, mission_);
  log(cause.event, reasonFor(*row, cause.reason, mission_), row->to);
  mission_.state = row->to;
  mission_.state_since_s = mission_.now_s;
  enter();
  return true;
}

/// What a result leads to, but for an action that has failed too often in a row.
void MissionMachine::Impl::fireFor(const Reaction& reaction, Cause cause) {
  const int streak = tooManyInARow(cause.action, reaction, mission_);
  if (streak > 0) cause.reason = std::to_string(streak) + " times in a row; " + cause.reason;
  fire(streak > 0 ? Trigger::kGiveUp : reaction.next, cause);
}

void MissionMachine::Impl::enter() {
  switch (mission_.state) {
    case State::kChoose:
      reportFailedPlans(mission_);
      if (!mission_.carrying) excludeFruitlessView(mission_);
      [[fallthrough]];
    case State::kBegin:
      fire(Trigger::kAtOnce, {});
      return;
    case State::kHalting:
      if (mission_.carrying) takeUpPick(mission_);  // what looks for the next one is not waited for
      return control(mission_.running->id, command::Cancel{});
    case State::kUnload:
      return;
    case State::kPick:
      if (mission_.running) return;  // that goes on
      break;
    case State::kEnded:
      mission_.memory.is_let_go_open = false;  // nothing counts any more
      [[fallthrough]];
    case State::kPaused:
    case State::kHeld:
      mission_.is_pause_wanted = false;
      return;
    default:
      break;
  }
  if (!fire(Trigger::kEntering, {})) output_.commands.push_back(begin(mission_));
}

void MissionMachine::Impl::log(const std::string& event, const std::string& reason, State decision) {
  LogEntry entry;
  entry.time_s = mission_.now_s;
  entry.state = mission_.state;
  entry.event = event;
  entry.decision = decision;
  entry.reason = reason;
  entry.state_s = mission_.now_s - mission_.state_since_s;
  entry.counts = countsOf(mission_);
  output_.log.push_back(entry);
}

void MissionMachine::Impl::release() {
  mission_.memory.is_hold_given = false;
  control(0, command::Release{});
}

Mission::Running MissionMachine::Impl::takeRunning() {
  const Mission::Running ended = *mission_.running;
  mission_.running.reset();
  if (ended.action == State::kPick) mission_.memory.pick_running.reset();
  return ended;
}

// --------------------------------------------------------------------------------------------------------------------

MissionMachine::MissionMachine(const MissionConfig& config, MissionInfo info)
    : impl_(std::make_unique<Impl>(config, std::move(info))) {}

MissionMachine::MissionMachine(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

MissionMachine MissionMachine::fromJson(const MissionConfig& config, MissionInfo info, const nlohmann::json& saved) {
  return MissionMachine(std::make_unique<Impl>(config, std::move(info), saved));
}

MissionMachine::~MissionMachine() = default;
MissionMachine::MissionMachine(MissionMachine&& other) noexcept = default;
MissionMachine& MissionMachine::operator=(MissionMachine&& other) noexcept = default;

MissionOutput MissionMachine::step(const Event& event, double now_s) {
  return impl_->step(event, now_s);
}

State MissionMachine::state() const {
  return impl_->mission().state;
}

Hand MissionMachine::hand() const {
  return impl_->mission().hand;
}

EndReason MissionMachine::endReason() const {
  return impl_->mission().memory.end_reason;
}

const std::string& MissionMachine::endMessage() const {
  return impl_->mission().memory.end_message;
}

const BrickLedger& MissionMachine::bricks() const {
  return impl_->mission().memory.ledger;
}

MissionCounts MissionMachine::counts() const {
  return countsOf(impl_->mission());
}

int MissionMachine::placesUsed() const {
  return impl_->mission().memory.places_used;
}

std::optional<Pose2d> MissionMachine::startPose() const {
  return impl_->mission().memory.start_pose;
}

bool MissionMachine::isPauseWanted() const {
  return impl_->mission().is_pause_wanted;
}

double MissionMachine::usedTime() const {
  return impl_->mission().memory.used_s;
}

MissionSummary MissionMachine::summary(double wall_s) const {
  const Mission& mission = impl_->mission();
  MissionSummary summary;
  summary.info = mission.info;
  summary.bricks_total = mission.config.bricks_total;
  summary.counts = counts();
  summary.end_reason = endReason();
  summary.end_message = endMessage();
  summary.failures = mission.memory.failures;
  summary.sim_seconds = usedTime();
  summary.wall_seconds = wall_s;
  return summary;
}

nlohmann::json MissionMachine::toJson() const {
  return pick_mission::toJson(impl_->mission().memory);
}

}  // namespace pick_mission
