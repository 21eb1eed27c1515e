// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/mission_machine.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <iomanip>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "pick_mission/reactions.h"

namespace pick_mission {
namespace {

constexpr int kSavedVersion = 3;

/// By how much the robot's pose in the map changes while it stands.
constexpr double kSamePlace_m = 0.1;
constexpr double kSamePlace_rad = 0.1;

enum class HaltFor { kHold, kResume, kStop, kTimeUp, kTimeout };
enum class DriveFor { kSurvey, kView, kVantage };

/// With the magnet in play: without an answer nobody knows what hangs there.
bool handlesBrick(State action) {
  return action == State::kPick || action == State::kStow || action == State::kLetGo;
}

/// Ends in order, for it moves the arm or a brick hangs on it.
bool movesArm(State action) {
  return handlesBrick(action) || action == State::kClear || action == State::kPlanStow || action == State::kRecover;
}

bool needsEmptyHand(State action) {
  switch (action) {
    case State::kPlanClear:
    case State::kClear:
    case State::kLook:
    case State::kDetect:
    case State::kPlanPick:
    case State::kPick:
    case State::kSelect:
    case State::kDrive:
      return true;
    default:
      return false;
  }
}

bool needsClearView(State action) {
  switch (action) {
    case State::kLook:
    case State::kDetect:
    case State::kPlanPick:
    case State::kPick:
    case State::kSelect:
    case State::kDrive:
      return true;
    default:
      return false;
  }
}

std::string withMessage(const std::string& text, const std::string& message) {
  if (text.empty() || message.empty()) return text + message;
  return text + " (" + message + ")";
}

nlohmann::json jsonOf(const Pose2d& pose) {
  return {pose.x_m, pose.y_m, pose.yaw_rad};
}

Pose2d poseFrom(const nlohmann::json& json) {
  return {json.at(0).get<double>(), json.at(1).get<double>(), json.at(2).get<double>()};
}

int countFrom(const nlohmann::json& saved, const char* key) {
  const auto count = saved.at(key).get<std::int64_t>();
  if (count < 0 || count > std::numeric_limits<int>::max()) {
    throw std::invalid_argument(std::string(key) + " = " + std::to_string(count) + ", must be in [0, " +
                                std::to_string(std::numeric_limits<int>::max()) + "]");
  }
  return static_cast<int>(count);
}

}  // namespace

class MissionMachine::Impl {
 public:
  Impl(const MissionConfig& config, MissionInfo info)
      : config_(config), info_(std::move(info)), ledger_(makeLedger(config)) {}

  MissionOutput step(const Event& event, double now_s);
  nlohmann::json toJson() const;
  void restore(const nlohmann::json& saved);
  MissionCounts counts() const;
  bool isPauseWanted() const { return is_pause_wanted_; }

  MissionConfig config_;
  MissionInfo info_;
  BrickLedger ledger_;

  State state_{State::kIdle};
  Hand hand_{Hand::kUnknown};
  EndReason end_reason_{EndReason::kNone};
  std::string end_message_;
  std::map<std::string, int> failures_;
  double used_s_{0.0};

 private:
  struct Running {
    std::uint64_t id;
    State action;
    double since_s;
  };
  struct Failure {
    Eigen::Vector3d position;
    double stamp_s;
    std::string reason;
  };
  Eigen::Vector3d nearSideOf(const SeenBrick& brick) const;
  static BrickLedger makeLedger(const MissionConfig& config) {
    interactive_mapping::requireValid("impossible mission:", config);
    return {config.max_picks_per_brick, config.max_plans_per_brick};
  }

  void on(const event::Start& start);
  void on(const event::Reply& reply);
  void on(const event::HandReport& report);
  void on(const event::Tick& tick);
  void on(const event::Pause& pause);
  void on(const event::Resume& resume);
  void on(const event::Hold& hold);
  void on(const event::Stop& stop);
  void on(const event::ClockJump& jump);
  void shiftTimes(double by_s);

  bool holds(Guard guard) const;
  bool go(Trigger trigger, const std::string& event, const std::string& reason);
  void take(const Transition& row, const std::string& event, const std::string& reason);
  void affect(const Transition& row, const std::string& reason);
  void enter();
  void issue();
  void beforeChoosing();
  std::vector<command::Zone> zonesOfVainBricks() const;
  void absorb(State action, const event::Reply& reply, const Reaction& reaction, bool is_broken_off);
  void absorbSuccess(State action, const event::Reply& reply);
  void absorbFailure(State action, const event::Reply& reply, const Reaction& reaction);
  void updateHand(State action, const event::Reply& reply);
  void setHand(Hand hand);
  void halted(const event::Reply& reply, bool is_gone);
  void requireFits(const event::Reply& reply) const;
  void end(EndReason reason, const std::string& message);
  EndReason reasonOfLeftovers() const;
  std::string obstaclesInWords() const;
  std::string leftInWords() const;
  int numNeverFound() const;
  std::optional<State> stateToWaitIn() const;
  bool mayPause() const;
  void beginAnewFrom(const std::optional<Pose2d>& T_map_base);
  void brickStowed();
  bool countsInARow(State action, const Reaction& reaction) const;
  bool isTooMany(State action, const Reaction& reaction) {
    return countsInARow(action, reaction) && streak(action) >= capOf(action);
  }
  int capOf(State action) const;
  int& streak(State action) { return streaks_[static_cast<std::size_t>(action)]; }
  Pose2d surveyPose(std::size_t index) const;
  std::size_t numSurveyPlaces() const { return config_.survey_x_m.size() + round_.size(); }
  void planRound();
  Running takeRunning() {
    const Running running = *running_;
    running_.reset();
    return running;
  }
  template <typename Body>
  void control(std::uint64_t id, Body body) {
    output_.commands.push_back({id, std::move(body)});
  }
  void release() {
    is_hold_given_ = false;
    control(0, command::Release{});
  }
  void note(const std::string& event, const std::string& reason);
  std::string reasonFor(const Transition& row) const;

  // What goes on.
  std::optional<Running> running_;
  std::uint64_t last_id_{0};
  std::uint64_t plan_id_{0};
  std::optional<SeenBrick> candidate_;
  std::optional<Pose2d> goal_;
  DriveFor drive_for_{DriveFor::kSurvey};
  std::optional<Pose2d> best_view_;
  bool has_unseen_{false};
  command::Wait wait_;
  bool is_arm_busy_{false};  // says the last reply
  HaltFor halt_for_{HaltFor::kStop};
  double halted_since_s_{0.0};
  bool is_protective_stop_{false};
  bool is_pause_wanted_{false};
  bool is_hold_given_{false};  // to the arm's bridge, and not released
  bool is_ending_{false};
  bool was_ending_{false};      // before it was told so for the last time
  bool is_let_go_open_{false};  // the magnet was told to let go, and what came of it is not known
  std::deque<Failure> reports_;
  bool is_arm_clear_{false};
  double map_stamp_s_{0.0};
  double now_s_{0.0};
  std::optional<double> last_step_s_;
  double state_since_s_{0.0};
  MissionOutput output_;

  // What is remembered.
  std::optional<Pose2d> start_pose_;
  std::vector<Pose2d> round_;  // the survey's places round the bricks
  bool is_round_planned_{false};
  Pose2d base_;
  std::size_t survey_index_{0};
  std::optional<int> brick_in_hand_;
  int nameless_picked_{0};  // stowed bricks of which nobody knew the id
  int scene_{0};            // changes with robot and pile
  int views_{0};
  int picks_begun_{0};
  int fruitless_views_{0};
  int low_utility_views_{0};
  int vantage_drives_{0};
  int fade_waits_{0};
  int recoveries_{0};  // since the arm last moved
  int unknown_hand_waits_{0};
  std::array<int, kNumStates> streaks_{};  // failures in a row, by action
  std::vector<command::Zone> excluded_;
  bool is_leaving_given_up_{false};  // nothing else was worth it

  // Of where the robot stands.
  bool is_at_view_{false};
  bool is_view_noted_{false};
  bool is_other_view_wanted_{false};
  int picks_here_{0};
  int pick_failures_here_{0};
  int plan_failures_here_{0};
};

MissionCounts MissionMachine::Impl::counts() const {
  MissionCounts counts;
  counts.bricks_picked = ledger_.numPicked() + nameless_picked_;
  counts.bricks_open = ledger_.numOpen();
  counts.bricks_exhausted = ledger_.numExhausted();
  counts.picks_begun = picks_begun_;
  counts.views = views_;
  for (const auto& [kind, count] : failures_) counts.failures += count;
  return counts;
}

void MissionMachine::Impl::note(const std::string& event, const std::string& reason) {
  LogEntry entry;
  entry.time_s = now_s_;
  entry.state = state_;
  entry.event = event;
  entry.decision = state_;
  entry.reason = reason;
  entry.state_s = now_s_ - state_since_s_;
  entry.counts = counts();
  output_.log.push_back(entry);
}

MissionOutput MissionMachine::Impl::step(const Event& event, double now_s) {
  if (!std::isfinite(now_s)) throw std::invalid_argument("now = " + std::to_string(now_s) + " s, must be finite");
  if (const auto* reply = std::get_if<event::Reply>(&event)) requireFits(*reply);
  const auto* jump = std::get_if<event::ClockJump>(&event);
  if (jump != nullptr && !std::isfinite(jump->by_s)) {
    throw std::invalid_argument("a clock's jump = " + std::to_string(jump->by_s) + " s, must be finite");
  }
  if (jump != nullptr && last_step_s_) {
    shiftTimes(jump->by_s);
    *last_step_s_ += jump->by_s;
  }
  const bool is_active = isAction(state_) || state_ == State::kHalting;
  // A clock that is set back (a looped bag, a simulation begun anew) takes nothing back.
  if (is_active && last_step_s_ && now_s > *last_step_s_) used_s_ += now_s - *last_step_s_;
  if (last_step_s_ && now_s < *last_step_s_) shiftTimes(now_s - *last_step_s_);
  if (!last_step_s_) state_since_s_ = now_s;
  last_step_s_ = now_s;
  now_s_ = now_s;
  output_ = {};
  std::visit([this](const auto& e) { on(e); }, event);
  return std::move(output_);
}

/// What began before a jump of the clock, as if it had always stood where it stands now.
void MissionMachine::Impl::shiftTimes(double by_s) {
  state_since_s_ += by_s;
  halted_since_s_ += by_s;
  if (running_) running_->since_s += by_s;
}

void MissionMachine::Impl::requireFits(const event::Reply& reply) const {
  if (!running_ || reply.id != running_->id) return;
  reactTo(running_->action, reply.result);  // throws if it cannot be
  const auto* selection = std::get_if<SelectionResult>(&reply.result);
  if (selection != nullptr && selection->status == SelectionStatus::kSuccess && !selection->T_map_base) {
    throw std::invalid_argument("a selection that succeeded has no standing pose, must have one");
  }
}

// --- Events ---------------------------------------------------------------------------------------------------------

void MissionMachine::Impl::on(const event::Start& start) {
  if (state_ != State::kIdle) return note("start", "ignored: it has begun");
  base_ = start.T_map_base;
  if (!start_pose_) start_pose_ = start.T_map_base;
  if (start.brick_in_hand) brick_in_hand_ = start.brick_in_hand;
  setHand(start.hand);
  is_arm_clear_ = false;
  go(Trigger::kStart, "start", std::string("hand ") + toString(hand_));
}

void MissionMachine::Impl::on(const event::Reply& reply) {
  if (!running_ || reply.id != running_->id) {
    return note("reply " + std::to_string(reply.id), "ignored: not of what goes on");
  }
  if (state_ == State::kHalting) return halted(reply, false);
  const State action = takeRunning().action;
  const Reaction reaction = reactTo(action, reply.result);
  is_arm_busy_ = reaction.is_arm_busy;
  absorb(action, reply, reaction, false);

  const std::string status = toString(reply.result);
  std::string reason = withMessage(reaction.why, reply.message);
  Trigger next = reaction.next;
  if (isTooMany(action, reaction)) {
    next = Trigger::kGiveUp;
    reason = std::to_string(streak(action)) + " times in a row; " + reason;
  }
  if (next == Trigger::kGiveUp) {
    end(reaction.end, std::string(toString(action)) + ": " + status + "; " + reason);
  }
  go(next, status, reason);
}

void MissionMachine::Impl::on(const event::HandReport& report) {
  if (report.brick_in_hand) brick_in_hand_ = report.brick_in_hand;
  // What an action does to the hand, its reply tells; where none came, that of the wait for the arm: a bridge that has just
  // come back has not heard of its magnet yet.
  if (is_let_go_open_ || (running_ && handlesBrick(running_->action))) return;
  if (report.hand == hand_) return;
  const Hand before = hand_;
  setHand(report.hand);
  note("hand", std::string(toString(before)) + ", now " + toString(hand_));
}

void MissionMachine::Impl::on(const event::Tick& /*tick*/) {
  if (!running_) return;
  if (state_ == State::kHalting) {
    if (now_s_ - halted_since_s_ < config_.cancel_timeout_s) return;
    event::Reply reply;
    reply.id = running_->id;
    reply.result = NoAnswer{};
    reply.message = "did not end within " + std::to_string(config_.cancel_timeout_s) + " s of being cancelled";
    return halted(reply, true);
  }
  if (used_s_ >= config_.time_limit_s && holds(Guard::kMayBreakOff)) {
    halt_for_ = HaltFor::kTimeUp;
    go(Trigger::kTimeUp, "tick", "time is up");
  } else if (now_s_ - running_->since_s >= config_.action_timeout_s) {
    halt_for_ = HaltFor::kTimeout;
    go(Trigger::kActionTimeout, "tick", "no result within " + std::to_string(config_.action_timeout_s) + " s");
  }
}

bool MissionMachine::Impl::mayPause() const {
  return isAction(state_) || (state_ == State::kHalting && halt_for_ == HaltFor::kTimeout);
}

void MissionMachine::Impl::on(const event::Pause& /*pause*/) {
  if (!mayPause()) return note("pause", "ignored: nothing goes on");
  is_pause_wanted_ = true;
  note("pause", "when what goes on has ended");
}

/// People may have moved robot and pile: what was tried in vain from here may be tried again. What is counted against the
/// bricks stays, and a view from which nothing could be picked is not counted anew while the robot stands there.
void MissionMachine::Impl::beginAnewFrom(const std::optional<Pose2d>& T_map_base) {
  const bool stands_there = T_map_base && (T_map_base->position() - base_.position()).norm() < kSamePlace_m &&
                            std::abs(std::remainder(T_map_base->yaw_rad - base_.yaw_rad, 2.0 * M_PI)) < kSamePlace_rad;
  ++scene_;
  is_arm_clear_ = false;
  is_other_view_wanted_ = false;
  pick_failures_here_ = plan_failures_here_ = 0;
  if (!stands_there) {
    is_at_view_ = is_view_noted_ = false;
    picks_here_ = 0;
  }
  if (T_map_base) base_ = *T_map_base;
}

void MissionMachine::Impl::on(const event::Resume& resume) {
  if (is_pause_wanted_ && mayPause()) {
    is_pause_wanted_ = false;
    return note("resume", "goes on without a pause");
  }
  if (state_ == State::kHalting && halt_for_ == HaltFor::kHold) {
    halt_for_ = HaltFor::kResume;
    release();
    beginAnewFrom(resume.T_map_base);
    return note("resume", "when what goes on has ended");
  }
  if (state_ == State::kHeld) release();
  if (state_ == State::kPaused || state_ == State::kHeld) beginAnewFrom(resume.T_map_base);
  if (go(Trigger::kResume, "resume", "after a fresh inspection")) return;
  if (!is_hold_given_) return note("resume", "ignored: nothing is interrupted");
  release();  // of a hold before the mission or after it
  note("resume", "passed on: nothing is interrupted");
}

void MissionMachine::Impl::on(const event::Hold& /*hold*/) {
  is_hold_given_ = true;
  control(0, command::Hold{});  // whatever the mission does: the arm shall not move
  is_pause_wanted_ = false;
  if (state_ == State::kHalting) {
    if (halt_for_ != HaltFor::kStop && halt_for_ != HaltFor::kTimeUp) halt_for_ = HaltFor::kHold;
    return note("hold", "already halting");
  }
  if (isAction(state_)) halt_for_ = HaltFor::kHold;
  if (!go(Trigger::kHold, "hold", "of the operator")) note("hold", "passed on: nothing goes on");
}

void MissionMachine::Impl::on(const event::Stop& /*stop*/) {
  is_pause_wanted_ = false;
  if (state_ == State::kHalting) {
    halt_for_ = HaltFor::kStop;
    return note("stop", "when what goes on has ended");
  }
  if (isAction(state_)) halt_for_ = HaltFor::kStop;
  if (!go(Trigger::kStop, "stop", "of the operator")) note("stop", "ignored: nothing goes on");
}

void MissionMachine::Impl::on(const event::ClockJump& jump) {
  note("clock", "was set by " + std::to_string(jump.by_s) + " s, which do not count");
}

/// What was halted has ended, or (`is_gone`) does not even do that.
void MissionMachine::Impl::halted(const event::Reply& reply, bool is_gone) {
  const State action = takeRunning().action;
  const bool is_timeout = halt_for_ == HaltFor::kTimeout;
  if (isSuccess(reply.result)) {
    absorb(action, reply, reactTo(action, reply.result), true);
    if (!is_timeout) {
      go(Trigger::kHalted, toString(reply.result), "it had just ended");
    } else {
      go(Trigger::kRetryHere, toString(reply.result), "it had just ended; look again");
    }
    return;
  }
  event::Reply unanswered = reply;
  if (is_timeout) unanswered.result = NoAnswer{};
  const Reaction reaction = reactTo(action, unanswered.result);
  is_arm_busy_ = reaction.is_arm_busy;
  absorb(action, unanswered, reaction, !is_timeout && !is_gone);
  if (!is_timeout) {
    go(Trigger::kHalted, toString(reply.result), withMessage("has ended", reply.message));
    return;
  }
  std::string reason = withMessage(reaction.why, "took too long");
  Trigger next = reaction.next;
  if (isTooMany(action, reaction)) {
    next = Trigger::kGiveUp;
    reason = std::to_string(streak(action)) + " times in a row; " + reason;
    end(reaction.end, std::string(toString(action)) + ": no answer; " + reason);
  }
  go(next, "no answer", reason);
}

// --- What a result changes ------------------------------------------------------------------------------------------

/// A place of the survey that cannot be driven to is left out, and there are only so many of them.
bool MissionMachine::Impl::countsInARow(State action, const Reaction& reaction) const {
  const bool is_left_out = action == State::kDrive && reaction.is_reported && drive_for_ != DriveFor::kView;
  return reaction.counts_in_a_row && !is_left_out;
}

int MissionMachine::Impl::capOf(State action) const {
  return action == State::kRecover ? config_.max_recoveries_in_a_row : config_.max_failures_in_a_row;
}

void MissionMachine::Impl::setHand(Hand hand) {
  hand_ = hand;
  if (hand == Hand::kUnknown) return;
  // Whatever else was answered: it fell where it was let go.
  if (hand == Hand::kEmpty && is_let_go_open_) brickStowed();
  is_let_go_open_ = false;
  unknown_hand_waits_ = 0;
  if (hand == Hand::kEmpty) brick_in_hand_.reset();
}

void MissionMachine::Impl::updateHand(State action, const event::Reply& reply) {
  const auto* arm = std::get_if<ArmResult>(&reply.result);
  if (action == State::kPick) brick_in_hand_ = candidate_->id;
  if (reply.hand) return setHand(*reply.hand);
  if (!handlesBrick(action)) return;
  if (arm == nullptr) return setHand(Hand::kUnknown);
  switch (arm->status) {
    case ArmStatus::kSuccess:
      return setHand(action == State::kStow ? Hand::kHolding : Hand::kEmpty);
    case ArmStatus::kNothingHeld:
    case ArmStatus::kLostOnTheWay:
      return setHand(Hand::kEmpty);
    case ArmStatus::kNotLetGo:
      return setHand(Hand::kHolding);
    default:
      return setHand(Hand::kUnknown);
  }
}

void MissionMachine::Impl::absorb(State action, const event::Reply& reply, const Reaction& reaction,
                                  bool is_broken_off) {
  const std::optional<int> held_before = brick_in_hand_;
  const bool is_success = isSuccess(reply.result);
  const auto* arm = std::get_if<ArmResult>(&reply.result);
  const bool is_lost =
      arm != nullptr && (arm->status == ArmStatus::kLostOnTheWay || arm->status == ArmStatus::kNothingHeld);
  if (is_lost) is_let_go_open_ = false;  // it fell before that
  updateHand(action, reply);
  if (is_lost && held_before && action != State::kPick) {
    // A pick after all that failed: it lies somewhere else now.
    ++scene_;
    if (ledger_.isKnown(*held_before)) {
      ledger_.pickFailed(*held_before, std::string(toString(action)) + ": " + toString(reply.result));
    }
  }
  is_protective_stop_ = arm != nullptr && arm->status == ArmStatus::kProtectiveStop;
  if (is_success) {
    streak(action) = 0;
    absorbSuccess(action, reply);
  } else if (action == State::kReport) {
    reports_.pop_front();
    ++failures_[std::string(toString(action)) + ": " + toString(reply.result)];
  } else if (!is_broken_off) {
    absorbFailure(action, reply, reaction);
  }
  if (action == State::kDrive) {
    // Also after a failure it stands somewhere else.
    ++scene_;
    const auto* drive = std::get_if<NavigationResult>(&reply.result);
    if (drive != nullptr && drive->T_map_base) base_ = *drive->T_map_base;
  }
}

void MissionMachine::Impl::brickStowed() {
  ++scene_;
  if (brick_in_hand_ && ledger_.isKnown(*brick_in_hand_)) {
    ledger_.picked(*brick_in_hand_);
  } else {
    ++nameless_picked_;
    ledger_.pileChanged();
  }
  ++picks_here_;
  streak(State::kPick) = streak(State::kLetGo) = 0;  // whatever was answered on the way to it
  fruitless_views_ = low_utility_views_ = vantage_drives_ = fade_waits_ = 0;
  is_leaving_given_up_ = false;
  excluded_.clear();
}

void MissionMachine::Impl::absorbSuccess(State action, const event::Reply& reply) {
  switch (action) {
    case State::kPlanClear:
    case State::kPlanStow:
    case State::kPlanPick:
      plan_id_ = reply.id;
      break;
    case State::kClear:
      is_arm_clear_ = true;
      recoveries_ = 0;
      break;
    case State::kStow:
      recoveries_ = 0;
      break;
    case State::kPick:
      recoveries_ = 0;
      // Still holding, against what the result says: it is stowed, and counts then.
      if (hand_ == Hand::kHolding) break;
      brick_in_hand_ = candidate_->id;
      brickStowed();
      brick_in_hand_.reset();
      break;
    case State::kLook:
      map_stamp_s_ = std::get<LookResult>(reply.result).map_stamp_s;
      break;
    case State::kDetect: {
      const BrickLedger::Update update = ledger_.update(std::get<DetectionResult>(reply.result).bricks);
      if (!update.found.empty()) fruitless_views_ = 0;
      for (const int id : update.came_back) ++failures_["brick " + std::to_string(id) + ": seen again after its pick"];
      break;
    }
    case State::kReport:
      reports_.pop_front();
      break;
    case State::kSelect: {
      const auto& selection = std::get<SelectionResult>(reply.result);
      best_view_ = selection.T_map_base;
      has_unseen_ = selection.has_unseen;
      break;
    }
    case State::kDrive:
      base_ = *goal_;
      is_at_view_ = drive_for_ == DriveFor::kView;
      is_view_noted_ = is_other_view_wanted_ = false;
      picks_here_ = pick_failures_here_ = plan_failures_here_ = 0;
      if (drive_for_ == DriveFor::kSurvey) ++survey_index_;
      if (drive_for_ == DriveFor::kView) ++views_;
      break;
    default:
      break;
  }
}

/// Where a brick was tried from: beside it, towards the robot. What failed from here may go from its other sides.
Eigen::Vector3d MissionMachine::Impl::nearSideOf(const SeenBrick& brick) const {
  constexpr double kBeside_m = 0.3;  // a brick's length: its far side is out of the radius that a report has by default
  const Eigen::Vector3d center = brick.T_map_brick.translation();
  const Eigen::Vector2d to_robot = base_.position() - center.head<2>();
  const double distance_m = to_robot.norm();
  Eigen::Vector3d side = center;
  if (distance_m > kBeside_m) side.head<2>() += kBeside_m / distance_m * to_robot;
  return side;
}

void MissionMachine::Impl::absorbFailure(State action, const event::Reply& reply, const Reaction& reaction) {
  const std::string kind = std::string(toString(action)) + ": " + toString(reply.result);
  const std::string reason = withMessage(kind, reply.message);
  ++failures_[kind];
  if (countsInARow(action, reaction)) ++streak(action);
  if (const auto* selection = std::get_if<SelectionResult>(&reply.result)) {
    best_view_ = selection->T_map_base;
    has_unseen_ = selection->has_unseen;
  }
  if (action == State::kPlanPick && reaction.blames_brick) {
    ledger_.planFailed(candidate_->id, kind);
    ledger_.triedInVain(candidate_->id, scene_);
    if (++plan_failures_here_ >= config_.max_plan_failures_per_view) is_other_view_wanted_ = true;
  }
  // A brick that hangs on the magnet nevertheless is stowed, and picked then.
  if (action == State::kPick && reaction.blames_brick && hand_ != Hand::kHolding) {
    ledger_.pickFailed(candidate_->id, kind);
    if (reaction.next == Trigger::kNextBrick) ledger_.triedInVain(candidate_->id, scene_);
    if (++pick_failures_here_ >= config_.max_pick_failures_per_view) is_other_view_wanted_ = true;
  }
  if (reaction.is_reported && action == State::kDrive) {
    if (drive_for_ == DriveFor::kSurvey) {
      ++survey_index_;
    } else if (drive_for_ == DriveFor::kView) {
      excluded_.push_back({goal_->position(), config_.exclusion_radius_m});
      reports_.push_back({{goal_->x_m, goal_->y_m, 0.0}, now_s_, reason});
    }
  } else if (reaction.is_reported) {
    reports_.push_back({nearSideOf(*candidate_), now_s_, reason});
  }
}

// --- Transitions ----------------------------------------------------------------------------------------------------

bool MissionMachine::Impl::holds(Guard guard) const {
  const int total = config_.bricks_total;
  switch (guard) {
    case Guard::kAlways:
      return true;
    case Guard::kHandFull:
      return hand_ == Hand::kHolding;
    case Guard::kStowBeforeEnd:
      return hand_ == Hand::kHolding && !was_ending_;
    case Guard::kHandUnknown:
      return hand_ == Hand::kUnknown;
    case Guard::kHandUnknownTooLong:
      return hand_ == Hand::kUnknown && unknown_hand_waits_ >= config_.max_failures_in_a_row;
    case Guard::kBegunBefore:
      return start_pose_.has_value();
    case Guard::kEnding:
      return is_ending_;
    case Guard::kTimeUp:
      return used_s_ >= config_.time_limit_s;
    case Guard::kPauseWanted:
      return is_pause_wanted_;
    case Guard::kNotInOrder:
      return (needsEmptyHand(state_) && hand_ != Hand::kEmpty) || (needsClearView(state_) && !is_arm_clear_) ||
             ((state_ == State::kPlanStow || state_ == State::kStow) && hand_ != Hand::kHolding) ||
             (state_ == State::kLetGo && hand_ == Hand::kEmpty);
    case Guard::kReportLeft:
      return !reports_.empty();
    case Guard::kSurveyLeft:
      return survey_index_ < numSurveyPlaces();
    case Guard::kAllDealtWith:
      return total >= 0 && ledger_.numPicked() + nameless_picked_ + ledger_.numExhausted() >= total;
    case Guard::kBrickHere:
      return !is_other_view_wanted_ && ledger_.best(scene_).has_value();
    case Guard::kViewsSpent:
      return fruitless_views_ >= config_.max_fruitless_views;
    case Guard::kMayRecover:
      return recoveries_ < config_.max_recoveries_in_a_row && (!is_protective_stop_ || config_.unlocks_protective_stop);
    case Guard::kLeaves:
      return !zonesOfVainBricks().empty();
    case Guard::kSomeExcluded:
      return !excluded_.empty();
    case Guard::kUnseenWorth:
      return has_unseen_ && best_view_ && low_utility_views_ < config_.max_low_utility_views;
    case Guard::kWorthWaiting:
      return ledger_.numOpen() > 0 && fade_waits_ < config_.max_fade_waits;
    case Guard::kVantageLeft:
      return numSurveyPlaces() > 0 && vantage_drives_ < config_.max_vantage_drives;
    case Guard::kBricksLeft:
      return holds(Guard::kVantageLeft) && ledger_.numLeft() > 0;
    case Guard::kMayBreakOff:
      return hand_ == Hand::kEmpty && !movesArm(state_);
    case Guard::kForHold:
      return halt_for_ == HaltFor::kHold;
    case Guard::kForResume:
      return halt_for_ == HaltFor::kResume;
    case Guard::kForEnd:
      return halt_for_ == HaltFor::kStop || halt_for_ == HaltFor::kTimeUp;
  }
  return false;
}

bool MissionMachine::Impl::go(Trigger trigger, const std::string& event, const std::string& reason) {
  const Transition* row = nextTransition(state_, trigger, [this](Guard guard) { return holds(guard); });
  if (row == nullptr) return false;
  take(*row, event, reason);
  return true;
}

void MissionMachine::Impl::take(const Transition& row, const std::string& event, const std::string& reason) {
  affect(row, withMessage(event, reason));
  LogEntry entry;
  entry.time_s = now_s_;
  entry.state = state_;
  entry.event = event;
  entry.decision = row.to;
  const std::string guard = toString(row.guard);
  entry.reason = reason.empty() ? guard : guard.empty() ? reason : reason + "; " + guard;
  if (entry.reason.empty() || row.to == State::kPlanPick || row.to == State::kDrive) {
    const std::string what = reasonFor(row);
    entry.reason += (entry.reason.empty() || what.empty() ? "" : "; ") + what;
  }
  entry.state_s = now_s_ - state_since_s_;
  entry.counts = counts();
  output_.log.push_back(entry);
  state_ = row.to;
  state_since_s_ = now_s_;
  enter();
}

/// What comes next and why, where neither the event nor the guard tells.
std::string MissionMachine::Impl::reasonFor(const Transition& row) const {
  std::ostringstream text;
  text << std::fixed << std::setprecision(2);
  const auto brick = [](const std::optional<SeenBrick>& seen) {
    return seen ? "brick " + std::to_string(seen->id) : std::string("a brick");
  };
  switch (row.to) {
    case State::kBegin:
      if (state_ == State::kPick || state_ == State::kLetGo) {
        text << counts().bricks_picked << " picked so far: the arm out of the view, and a fresh look";
      } else {
        text << "the arm out of the view, and a fresh look";
      }
      break;
    case State::kPlanClear:
      text << "the arm has to be out of the camera's view";
      break;
    case State::kClear:
      text << "a way out of the camera's view is planned";
      break;
    case State::kLook:
      text << "nothing is in the camera's view: " << config_.look_images << " new images into the map";
      break;
    case State::kDetect:
      text << "the map has them: which bricks are there";
      break;
    case State::kChoose:
      text << counts().bricks_open << " bricks to be picked are there, " << counts().bricks_picked << " picked";
      break;
    case State::kReport:
      text << "that nothing could be done there";
      break;
    case State::kPlanPick:
      text << brick(ledger_.best(scene_)) << ", the highest that is graspable, carries none and is in the arm's sector";
      break;
    case State::kPick:
      text << brick(candidate_) << ": its pick is planned";
      break;
    case State::kStow:
      text << "a way to where it is let go is planned";
      break;
    case State::kLetGo:
      text << "over the place where it may fall";
      break;
    case State::kSelect:
      text << "no brick is to be tried from here" << obstaclesInWords();
      if (holds(Guard::kLeaves)) text << "; away from those tried in vain, others were tried less often";
      break;
    case State::kDrive:
      if (drive_for_ == DriveFor::kSurvey) {
        text << "place " << survey_index_ + 1 << " of " << numSurveyPlaces() << " of the survey";
      } else if (drive_for_ == DriveFor::kVantage) {
        text << "back to a place of the survey";
      } else {
        text << "the best view";
      }
      if (goal_) text << " at (" << goal_->x_m << ", " << goal_->y_m << ") m, " << goal_->yaw_rad << " rad";
      break;
    default:
      break;
  }
  return text.str();
}

void MissionMachine::Impl::end(EndReason reason, const std::string& message) {
  was_ending_ = is_ending_;
  is_ending_ = true;
  end_reason_ = reason;
  end_message_ = message;
}

/// Why the mission ends if no view is to be had.
EndReason MissionMachine::Impl::reasonOfLeftovers() const {
  if (ledger_.numLeft() > 0 || numNeverFound() > 0) return EndReason::kNothingWorthGoing;
  return ledger_.numExhausted() > 0 ? EndReason::kBricksExhausted : EndReason::kNoBrickLeft;
}

int MissionMachine::Impl::numNeverFound() const {
  if (config_.bricks_total < 0) return 0;
  return config_.bricks_total - counts().bricks_picked - ledger_.numExhausted() - ledger_.numLeft();
}

/// Why each brick that is there is left for now.
std::string MissionMachine::Impl::obstaclesInWords() const {
  std::string text;
  for (const auto& [id, record] : ledger_.bricks()) {
    const std::string obstacle = ledger_.obstacleTo(id, scene_);
    if (record.is_picked || !record.is_there || obstacle.empty()) continue;
    text += (text.empty() ? ": brick " : ", ") + std::to_string(id) + " " + obstacle;
  }
  return text;
}

/// Bricks that are neither picked nor given up. One that is not seen any more may lie anywhere, or have been stowed by a
/// pick whose end nobody told.
std::string MissionMachine::Impl::leftInWords() const {
  std::string text;
  const auto add = [&text](const std::string& one) { text += (text.empty() ? "; " : ", ") + one; };
  for (const auto& [id, record] : ledger_.bricks()) {
    if (record.is_picked || ledger_.isExhausted(record)) continue;
    const std::string obstacle = ledger_.obstacleTo(id, scene_);
    const std::string stands = record.is_there || obstacle.empty() ? "stands there" : "";
    const std::string both = stands.empty() || obstacle.empty() ? "" : " and ";
    add("brick " + std::to_string(id) + " " + stands + both + obstacle);
  }
  if (numNeverFound() > 0) {
    add(std::to_string(numNeverFound()) + " of " + std::to_string(config_.bricks_total) + " bricks never found");
  }
  return text;
}

/// What a transition does beside leading to its state.
void MissionMachine::Impl::affect(const Transition& row, const std::string& reason) {
  if (row.to == State::kEnded && !is_ending_) {
    if (row.guard == Guard::kTimeUp || (row.guard == Guard::kForEnd && halt_for_ == HaltFor::kTimeUp)) {
      end(EndReason::kTimeUp, "after " + std::to_string(used_s_) + " s");
    } else if (row.trigger == Trigger::kStop || row.guard == Guard::kForEnd) {
      end(EndReason::kStopped, "by the operator");
    } else if (row.guard == Guard::kHandUnknownTooLong) {
      end(EndReason::kBrickInHand, "the arm's bridge does not tell whether the magnet holds something");
    } else if (row.guard == Guard::kAllDealtWith) {
      end(ledger_.numExhausted() > 0 ? EndReason::kBricksExhausted : EndReason::kNoBrickLeft,
          "all " + std::to_string(config_.bricks_total) + " bricks");
    } else if (row.guard == Guard::kViewsSpent) {
      end(ledger_.numLeft() == 0 && ledger_.numExhausted() > 0 ? EndReason::kBricksExhausted : EndReason::kNoProgress,
          std::to_string(fruitless_views_) + " views in a row without a pick or a new brick" + leftInWords());
    } else if (row.trigger == Trigger::kRecover) {
      end(is_protective_stop_ ? EndReason::kNeedsPerson : EndReason::kRecoveryFailed,
          std::string(toString(state_)) + ": " + reason);
    } else if (row.trigger == Trigger::kNoPile) {
      end(reasonOfLeftovers(), std::string(toString(state_)) + ": " + reason + leftInWords());
    } else {
      const EndReason leftovers = reasonOfLeftovers();
      // With something standing there that is no known brick, it is not known that none is left.
      end(leftovers == EndReason::kNoBrickLeft ? EndReason::kNothingWorthGoing : leftovers,
          std::string(toString(state_)) + ": " + reason + leftInWords());
    }
    return;
  }
  if (row.to == State::kDrive) {
    if (row.from == State::kChoose) {
      drive_for_ = DriveFor::kSurvey;
      goal_ = surveyPose(survey_index_);
    } else if (row.trigger == Trigger::kDone || row.guard == Guard::kUnseenWorth) {
      drive_for_ = DriveFor::kView;
      goal_ = best_view_;
      if (row.guard == Guard::kUnseenWorth) ++low_utility_views_;
    } else {
      // The last place of the survey first: it is the nearest to the pile.
      const std::size_t size = numSurveyPlaces();
      drive_for_ = DriveFor::kVantage;
      goal_ = surveyPose(size - 1 - static_cast<std::size_t>(vantage_drives_) % size);
      ++vantage_drives_;
    }
  } else if (row.to == State::kSelect && row.guard == Guard::kLeaves) {
    is_leaving_given_up_ = true;
  } else if (row.to == State::kSelect && row.guard == Guard::kSomeExcluded) {
    excluded_.clear();
  } else if (row.to == State::kRecover) {
    ++recoveries_;
  } else if (row.to == State::kWait) {
    if (row.guard == Guard::kWorthWaiting) {
      ++fade_waits_;
      wait_ = {config_.fade_wait_s, WaitUntil::kLimit};
    } else if (row.guard == Guard::kHandUnknown) {
      ++unknown_hand_waits_;
      wait_ = {config_.ready_timeout_s, WaitUntil::kArmReady};
    } else if (is_arm_busy_) {
      wait_ = {config_.ready_timeout_s, WaitUntil::kArmIdle};
    } else if (state_ == State::kRecover) {
      wait_ = {config_.recover_wait_s, WaitUntil::kArmReady};
    } else if (state_ == State::kClear || handlesBrick(state_)) {
      wait_ = {config_.ready_timeout_s, WaitUntil::kArmReady};
    } else {
      // Whatever it is that is late: without a place nothing comes of asking for it again.
      wait_ = {std::max(config_.ready_timeout_s, config_.retry_wait_s), WaitUntil::kPlaceKnown, config_.retry_wait_s};
    }
  }
}

void MissionMachine::Impl::enter() {
  if (state_ == State::kBegin) {
    go(Trigger::kAtOnce, "", "");
  } else if (state_ == State::kChoose) {
    planRound();
    beforeChoosing();
    go(Trigger::kAtOnce, "", "");
  } else if (state_ == State::kHalting) {
    halted_since_s_ = now_s_;
    control(running_->id, command::Cancel{});
  } else if (state_ == State::kPaused || state_ == State::kHeld || state_ == State::kEnded) {
    is_pause_wanted_ = false;
    if (state_ == State::kEnded) is_let_go_open_ = false;  // nothing counts any more
  } else if (isAction(state_)) {
    if (!go(Trigger::kEntering, "", "")) issue();
  }
}

/// Where nothing could be picked, nothing can be the next time: the selection is told, once.
void MissionMachine::Impl::beforeChoosing() {
  if (!is_at_view_ || is_view_noted_ || picks_here_ > 0 || holds(Guard::kBrickHere)) return;
  is_view_noted_ = true;
  ++fruitless_views_;
  excluded_.push_back({base_.position(), config_.exclusion_radius_m});
  reports_.push_back({{base_.x_m, base_.y_m, 0.0}, now_s_, "nothing could be picked from here"});
}

/// View after view at bricks that cannot be reached, and others that were tried less often: those first.
std::vector<command::Zone> MissionMachine::Impl::zonesOfVainBricks() const {
  std::vector<command::Zone> zones;
  if (fruitless_views_ < config_.leave_after_views || is_leaving_given_up_) return zones;
  const auto tries = [](const BrickRecord& record) { return record.plans_failed + record.picks_failed; };
  const auto is_open = [this](const BrickRecord& record) {
    return record.is_there && !record.is_picked && !ledger_.isExhausted(record);
  };
  int fewest = std::numeric_limits<int>::max();
  for (const auto& [id, record] : ledger_.bricks()) {
    if (is_open(record)) fewest = std::min(fewest, tries(record));
  }
  for (const auto& [id, record] : ledger_.bricks()) {
    if (record.is_there && !record.is_picked && tries(record) > fewest) {
      zones.push_back({record.seen.T_map_brick.translation().head<2>(), config_.leave_radius_m});
    }
  }
  return zones;
}

/// Once, when the places that are configured have been looked from: evenly round what was found, from where it stands on.
void MissionMachine::Impl::planRound() {
  if (is_round_planned_ || survey_index_ < config_.survey_x_m.size()) return;
  std::vector<Eigen::Vector2d> bricks;
  for (const auto& [id, record] : ledger_.bricks()) {
    if (record.is_there && !record.is_picked) bricks.emplace_back(record.seen.T_map_brick.translation().head<2>());
  }
  if (bricks.empty()) return;
  is_round_planned_ = true;
  Eigen::AlignedBox2d extent;
  for (const Eigen::Vector2d& brick : bricks) extent.extend(brick);
  const Eigen::Vector2d middle = extent.center();
  const Eigen::Vector2d to_robot = base_.position() - middle;
  const double first_rad = std::atan2(to_robot.y(), to_robot.x());
  for (int k = 1; k <= config_.survey_round; ++k) {
    const double angle_rad = first_rad + 2.0 * M_PI * k / (config_.survey_round + 1);
    const Eigen::Vector2d outward(std::cos(angle_rad), std::sin(angle_rad));
    double outermost_m = 0.0;
    for (const Eigen::Vector2d& brick : bricks) outermost_m = std::max(outermost_m, outward.dot(brick - middle));
    const Eigen::Vector2d place = middle + (outermost_m + config_.survey_round_m) * outward;
    round_.push_back({place.x(), place.y(), std::remainder(angle_rad + M_PI, 2.0 * M_PI)});
  }
}

Pose2d MissionMachine::Impl::surveyPose(std::size_t index) const {
  if (index >= config_.survey_x_m.size()) return round_[index - config_.survey_x_m.size()];
  return base_navigation::compose(
      *start_pose_, {config_.survey_x_m[index], config_.survey_y_m[index], config_.survey_yaw_rad[index]});
}

void MissionMachine::Impl::issue() {
  Command next;
  next.id = ++last_id_;
  switch (state_) {
    case State::kPlanClear:
    case State::kPlanStow:
      next.body = command::PlanArm{state_ == State::kPlanStow};
      break;
    case State::kClear:
    case State::kStow:
      is_arm_clear_ = false;
      next.body = command::MoveArm{plan_id_};
      break;
    case State::kLook:
      next.body = command::Look{config_.look_images, config_.look_timeout_s};
      break;
    case State::kDetect:
      next.body = command::Detect{config_.detect_timeout_s};
      break;
    case State::kReport:
      next.body = command::ReportFailure{reports_.front().position, reports_.front().stamp_s, reports_.front().reason};
      break;
    case State::kPlanPick:
      candidate_ = ledger_.best(scene_);
      next.body = command::PlanPick{*candidate_, map_stamp_s_};
      break;
    case State::kPick:
      is_arm_clear_ = false;
      ++picks_begun_;
      ledger_.pickBegun(candidate_->id);
      next.body = command::Pick{*candidate_, plan_id_};
      break;
    case State::kLetGo:
      is_let_go_open_ = true;
      next.body = command::LetGo{};
      break;
    case State::kSelect:
      next.body = command::SelectView{info_.strategy, excluded_, map_stamp_s_};
      for (const command::Zone& zone : zonesOfVainBricks())
        std::get<command::SelectView>(next.body).excluded.push_back(zone);
      break;
    case State::kDrive:
      next.body = command::Drive{*goal_};
      break;
    case State::kRecover:
      is_arm_clear_ = false;
      next.body = command::Recover{config_.unlocks_protective_stop};
      break;
    case State::kWait:
      next.body = wait_;
      break;
    default:
      throw std::logic_error(std::string("state \"") + toString(state_) + "\" has no action");
  }
  running_ = Running{next.id, state_, now_s_};
  output_.commands.push_back(std::move(next));
}

// --- What survives --------------------------------------------------------------------------------------------------

/// For its operator, who had interrupted it or was about to: a mission that goes on after a crash must not do so by itself.
std::optional<State> MissionMachine::Impl::stateToWaitIn() const {
  const bool is_halting = state_ == State::kHalting;
  if (state_ == State::kHeld || (is_halting && halt_for_ == HaltFor::kHold)) return State::kHeld;
  if (state_ == State::kPaused || (is_halting && halt_for_ == HaltFor::kStop)) return State::kPaused;
  if (is_pause_wanted_) return State::kPaused;
  return std::nullopt;
}

nlohmann::json MissionMachine::Impl::toJson() const {
  nlohmann::json excluded = nlohmann::json::array();
  for (const command::Zone& zone : excluded_) {
    excluded.push_back({zone.center.x(), zone.center.y(), zone.radius_m});
  }
  nlohmann::json reports = nlohmann::json::array();
  for (const Failure& failure : reports_) {
    reports.push_back(
        {failure.position.x(), failure.position.y(), failure.position.z(), failure.stamp_s, failure.reason});
  }
  nlohmann::json round = nlohmann::json::array();
  for (const Pose2d& place : round_) round.push_back(jsonOf(place));
  nlohmann::json json = {{"version", kSavedVersion},
                         {"has_ended", state_ == State::kEnded},
                         {"end_reason", static_cast<int>(end_reason_)},
                         {"end_message", end_message_},
                         {"is_ending", is_ending_},
                         {"waits_in", nullptr},
                         {"is_hold_given", is_hold_given_},
                         {"is_let_go_open", is_let_go_open_},
                         {"used_s", used_s_},
                         {"start_pose", nullptr},
                         {"base", jsonOf(base_)},
                         {"survey_index", survey_index_},
                         {"round", round},
                         {"is_round_planned", is_round_planned_},
                         {"brick_in_hand", nullptr},
                         {"pick_running", nullptr},
                         {"nameless_picked", nameless_picked_},
                         {"scene", scene_},
                         {"views", views_},
                         {"picks_begun", picks_begun_},
                         {"fruitless_views", fruitless_views_},
                         {"low_utility_views", low_utility_views_},
                         {"vantage_drives", vantage_drives_},
                         {"fade_waits", fade_waits_},
                         {"streaks", streaks_},
                         {"last_id", last_id_},
                         {"excluded", excluded},
                         {"reports", reports},
                         {"failures", failures_},
                         {"bricks", ledger_.toJson()}};
  if (const std::optional<State> waits_in = stateToWaitIn()) json["waits_in"] = static_cast<int>(*waits_in);
  if (start_pose_) json["start_pose"] = jsonOf(*start_pose_);
  if (brick_in_hand_) json["brick_in_hand"] = *brick_in_hand_;
  if (running_ && running_->action == State::kPick) json["pick_running"] = candidate_->id;
  return json;
}

void MissionMachine::Impl::restore(const nlohmann::json& saved) {
  try {
    const int version = saved.at("version").get<int>();
    if (version != kSavedVersion) {
      throw std::invalid_argument("a mission's state of version " + std::to_string(version) + ", must be " +
                                  std::to_string(kSavedVersion));
    }
    const int end_reason = saved.at("end_reason").get<int>();
    if (end_reason < 0 || end_reason >= kNumEndReasons) {
      throw std::invalid_argument("end_reason = " + std::to_string(end_reason) + ", must be in [0, " +
                                  std::to_string(kNumEndReasons - 1) + "]");
    }
    end_reason_ = static_cast<EndReason>(end_reason);
    end_message_ = saved.at("end_message").get<std::string>();
    is_ending_ = saved.at("is_ending").get<bool>();
    if (!saved.at("waits_in").is_null()) {
      state_ = saved.at("waits_in").get<State>();
      if (state_ != State::kPaused && state_ != State::kHeld) {
        throw std::invalid_argument("waits_in = " + std::to_string(static_cast<int>(state_)) +
                                    ", must be that of paused or held");
      }
    }
    if (saved.at("has_ended").get<bool>()) state_ = State::kEnded;
    is_hold_given_ = saved.at("is_hold_given").get<bool>();
    is_let_go_open_ = saved.at("is_let_go_open").get<bool>();
    used_s_ = saved.at("used_s").get<double>();
    if (!(used_s_ >= 0.0)) throw std::invalid_argument("used_s = " + std::to_string(used_s_) + " s, must be >= 0 s");
    if (!saved.at("start_pose").is_null()) start_pose_ = poseFrom(saved.at("start_pose"));
    base_ = poseFrom(saved.at("base"));
    survey_index_ = static_cast<std::size_t>(countFrom(saved, "survey_index"));
    is_round_planned_ = saved.at("is_round_planned").get<bool>();
    for (const nlohmann::json& place : saved.at("round")) round_.push_back(poseFrom(place));
    if (!saved.at("brick_in_hand").is_null()) brick_in_hand_ = saved.at("brick_in_hand").get<int>();
    nameless_picked_ = countFrom(saved, "nameless_picked");
    scene_ = countFrom(saved, "scene");
    views_ = countFrom(saved, "views");
    picks_begun_ = countFrom(saved, "picks_begun");
    fruitless_views_ = countFrom(saved, "fruitless_views");
    low_utility_views_ = countFrom(saved, "low_utility_views");
    vantage_drives_ = countFrom(saved, "vantage_drives");
    fade_waits_ = countFrom(saved, "fade_waits");
    streaks_ = saved.at("streaks").get<std::array<int, kNumStates>>();
    last_id_ = static_cast<std::uint64_t>(countFrom(saved, "last_id"));
    for (const nlohmann::json& zone : saved.at("excluded")) {
      excluded_.push_back({{zone.at(0).get<double>(), zone.at(1).get<double>()}, zone.at(2).get<double>()});
    }
    for (const nlohmann::json& report : saved.at("reports")) {
      reports_.push_back({{report.at(0).get<double>(), report.at(1).get<double>(), report.at(2).get<double>()},
                          report.at(3).get<double>(),
                          report.at(4).get<std::string>()});
    }
    failures_ = saved.at("failures").get<std::map<std::string, int>>();
    ledger_.restore(saved.at("bricks"));
    if (!saved.at("pick_running").is_null()) {
      // How it ended, nobody knows: it may hang on the magnet, or lie anywhere. The attempt is used.
      const int id = saved.at("pick_running").get<int>();
      if (!ledger_.isKnown(id)) throw std::invalid_argument("pick_running = " + std::to_string(id) + ", must be known");
      ledger_.pickFailed(id, "pick: interrupted by a restart");
      ++failures_["pick: interrupted by a restart"];
      brick_in_hand_ = id;
      ++scene_;
    }
  } catch (const nlohmann::json::exception& error) {
    throw std::invalid_argument(std::string("not a mission's state: ") + error.what());
  }
}

// --------------------------------------------------------------------------------------------------------------------

MissionMachine::MissionMachine(const MissionConfig& config, MissionInfo info)
    : impl_(std::make_unique<Impl>(config, std::move(info))) {}

MissionMachine::MissionMachine(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

MissionMachine MissionMachine::fromJson(const MissionConfig& config, MissionInfo info, const nlohmann::json& saved) {
  auto impl = std::make_unique<Impl>(config, std::move(info));
  impl->restore(saved);
  return MissionMachine(std::move(impl));
}

MissionMachine::~MissionMachine() = default;
MissionMachine::MissionMachine(MissionMachine&& other) noexcept = default;
MissionMachine& MissionMachine::operator=(MissionMachine&& other) noexcept = default;

MissionOutput MissionMachine::step(const Event& event, double now_s) {
  return impl_->step(event, now_s);
}

State MissionMachine::state() const {
  return impl_->state_;
}

Hand MissionMachine::hand() const {
  return impl_->hand_;
}

EndReason MissionMachine::endReason() const {
  return impl_->end_reason_;
}

const std::string& MissionMachine::endMessage() const {
  return impl_->end_message_;
}

const BrickLedger& MissionMachine::bricks() const {
  return impl_->ledger_;
}

MissionCounts MissionMachine::counts() const {
  return impl_->counts();
}

bool MissionMachine::isPauseWanted() const {
  return impl_->isPauseWanted();
}

double MissionMachine::usedTime() const {
  return impl_->used_s_;
}

MissionSummary MissionMachine::summary(double wall_s) const {
  MissionSummary summary;
  summary.info = impl_->info_;
  summary.bricks_total = impl_->config_.bricks_total;
  summary.counts = impl_->counts();
  summary.end_reason = impl_->end_reason_;
  summary.end_message = impl_->end_message_;
  summary.failures = impl_->failures_;
  summary.sim_seconds = impl_->used_s_;
  summary.wall_seconds = wall_s;
  return summary;
}

nlohmann::json MissionMachine::toJson() const {
  return impl_->toJson();
}

}  // namespace pick_mission
