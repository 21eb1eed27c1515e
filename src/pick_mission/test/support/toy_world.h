// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "pick_mission/mission_machine.h"
#include "pick_mission/reactions.h"

namespace toy {

using namespace pick_mission;  // NOLINT(google-build-using-namespace): of tests alone

constexpr int kNumViews = 8;
constexpr double kViewRadius_m = 1.0;

inline Pose2d viewPose(int view) {
  const double angle = 2.0 * M_PI * view / kNumViews;
  return {kViewRadius_m * std::cos(angle), kViewRadius_m * std::sin(angle), angle + M_PI};
}

/// With a survey, a selection only when no brick can be tried here, and one action at a time. Most tests are of none of
/// these.
inline MissionConfig surveying() {
  MissionConfig config;
  config.survey.x_m = {0.6, 1.2};
  config.survey.y_m = config.survey.yaw_rad = {0.0, 0.0};
  config.look.while_carrying = false;
  config.views.choose_after_each_pick = false;
  return config;
}

struct ToyBrick {
  int id{0};
  int view{0};               // it can be reached from this place alone
  int layer{0};              // those above in the same stack have to go first
  bool has_no_plate{false};  // no pick ever holds
  bool is_out_of_reach{false};
  bool is_gone{false};
};

/// What the mission's commands do, in a world of stacks round a circle, each to be picked from its own view. It keeps its
/// own books of what must never happen.
class ToyWorld {
 public:
  explicit ToyWorld(std::vector<ToyBrick> toy_bricks, unsigned seed = 1)
      : bricks(std::move(toy_bricks)), random(seed) {}

  static ToyWorld ofStacks(const std::vector<int>& heights) {
    std::vector<ToyBrick> stacked;
    int id = 0;
    for (std::size_t stack = 0; stack < heights.size(); ++stack) {
      for (int layer = 0; layer < heights[stack]; ++layer) {
        stacked.push_back({id++, static_cast<int>(stack) * 2 % kNumViews, layer});
      }
    }
    return ToyWorld(std::move(stacked));
  }

  /// To be called with all that a step says.
  void accept(const std::vector<Command>& commands, State state) {
    int actions = 0;
    for (const Command& command : commands) {
      if (std::holds_alternative<command::Cancel>(command.body)) {
        if (carrying && carrying->id == command.id) {
          running = std::exchange(carrying, std::nullopt);
          action = State::kPick;
        }
        EXPECT_TRUE(running && running->id == command.id) << "cancels what does not run";
        is_cancelled = true;
      } else if (std::holds_alternative<command::Hold>(command.body)) {
        is_held = true;
      } else if (std::holds_alternative<command::Release>(command.body)) {
        is_held = false;
      } else {
        ++actions;
        if (command.is_beside_pick && !carrying && action == State::kPick) std::swap(carrying, running);
        EXPECT_EQ(command.is_beside_pick, carrying.has_value()) << toString(state);
        // What it looked for beside a pick is dropped when that fails.
        if (has_carrying_failed) running.reset();
        has_carrying_failed = false;
        EXPECT_FALSE(running) << toString(state) << " begun while " << toString(action) << " goes on";
        EXPECT_TRUE(ids.insert(command.id).second) << "id " << command.id << " twice";
        running = command;
        action = state;
        is_cancelled = false;
        ++commands_of[state];
        check(command);
      }
    }
    EXPECT_LE(actions, 1);
  }

  /// What must hold when a command begins.
  void check(const Command& command) {
    if (std::holds_alternative<command::Drive>(command.body)) {
      EXPECT_FALSE(hand) << "drives with a brick in the hand";
      EXPECT_TRUE(is_arm_folded) << "drives with the arm not folded";
      EXPECT_FALSE(carrying) << "drives while the arm carries a brick";
    } else if (std::holds_alternative<command::Look>(command.body)) {
      EXPECT_TRUE(is_arm_clear || carrying) << "looks with the arm in the view";
      plans.clear();
      looked = true;
    } else if (const auto* arm = std::get_if<command::PlanArm>(&command.body)) {
      if (!arm->place.empty()) stow_place = arm->place;
    } else if (const auto* plan = std::get_if<command::PlanPick>(&command.body)) {
      EXPECT_EQ(used.count(plan->place), 0u) << "plans to lay a brick on another";
      EXPECT_FALSE(carrying && plan->place == stow_place) << "plans to lay a brick on the one in the hand";
      EXPECT_EQ(plan->is_after_pick, carrying.has_value());
      place_of[command.id] = plan->place;
    } else if (const auto* pick = std::get_if<command::Pick>(&command.body)) {
      EXPECT_EQ(plans.count(pick->plan), 1u) << "picks without a plan made since the last look";
      if (plans.count(pick->plan) > 0) {
        EXPECT_EQ(plans[pick->plan], pick->brick.id) << "picks by another brick's plan";
      }
      EXPECT_FALSE(hand) << "picks with a brick in the hand";
      EXPECT_FALSE(carrying) << "picks while the arm carries a brick";
      stow_place = place_of[pick->plan];
      EXPECT_FALSE(brick(pick->brick.id).is_gone && !lost.count(pick->brick.id)) << "picks what it has picked";
      ++picks[pick->brick.id];
    } else if (const auto* move = std::get_if<command::MoveArm>(&command.body)) {
      EXPECT_EQ(arm_plan, move->plan) << "moves by an old plan";
    }
  }

  ToyBrick& brick(int id) {
    return *std::find_if(bricks.begin(), bricks.end(), [id](const ToyBrick& b) { return b.id == id; });
  }
  /// From the pile, if only in the hand.
  bool isAway(const ToyBrick& brick) const {
    return brick.is_gone || (carrying && std::get<command::Pick>(carrying->body).brick.id == brick.id);
  }
  bool isCovered(const ToyBrick& brick) const {
    return std::any_of(bricks.begin(), bricks.end(), [&](const ToyBrick& other) {
      return !isAway(other) && other.view == brick.view && other.layer > brick.layer && other.id != hand;
    });
  }
  int numLeft() const {
    return static_cast<int>(std::count_if(bricks.begin(), bricks.end(), [](const ToyBrick& b) { return !b.is_gone; }));
  }
  bool isCleared() const {
    return std::all_of(bricks.begin(), bricks.end(), [this](const ToyBrick& b) { return isAway(b); });
  }
  Hand handState() const { return hand ? Hand::kHolding : Hand::kEmpty; }

  double duration() const {
    if (std::holds_alternative<command::Drive>(running->body)) return 10.0;
    if (std::holds_alternative<command::Pick>(running->body)) return 20.0;
    if (const auto* wait = std::get_if<command::Wait>(&running->body)) {
      if (wait->until == WaitUntil::kPlaceKnown) return wait->at_least_s;
      return wait->until != WaitUntil::kLimit ? std::min(1.0, wait->limit_s) : wait->limit_s;
    }
    return 1.0;
  }

  /// Ends what runs. `forced`: with this result, and what such a result does to the world; without it all goes well.
  event::Reply finish(double now_s, const std::optional<Result>& forced = std::nullopt) {
    event::Reply reply;
    reply.id = running->id;
    Result result = forced ? *forced : nominal(now_s);
    if (is_cancelled && !forced) result = cancelledResult();
    if (isSuccess(result)) {
      succeed(result, now_s);
    } else {
      fail(result);
    }
    if (!std::holds_alternative<NoAnswer>(result)) {
      reply.message = "as the toy world has it";
      if (std::holds_alternative<ArmResult>(result) || std::holds_alternative<WaitResult>(result)) {
        reply.hand = handState();
      }
    }
    reply.result = result;
    running.reset();
    is_cancelled = false;
    return reply;
  }

  /// Ends the pick that carries a brick away, beside what runs.
  event::Reply finishPick(double now_s, const std::optional<Result>& forced) {
    std::optional<Command> beside = std::exchange(running, std::exchange(carrying, std::nullopt));
    const State action_beside = std::exchange(action, State::kPick);
    const event::Reply reply = finish(now_s, forced);
    has_carrying_failed = !isSuccess(reply.result) && beside;
    running = std::move(beside);
    action = action_beside;
    return reply;
  }

  /// The mission's process dies: what it had begun is cancelled by whoever did it.
  void abandon() {
    if (carrying) running = std::exchange(carrying, std::nullopt);
    if (!running) return;
    fail(cancelledResult());
    running.reset();
    is_cancelled = false;
  }

  std::vector<ToyBrick> bricks;
  std::mt19937 random;
  std::optional<Command> running;
  std::optional<Command> carrying;  // a pick beside it
  double carried_until_s{0.0};
  bool has_carrying_failed{false};
  State action{State::kIdle};
  bool is_cancelled{false};
  bool is_held{false};
  bool is_arm_clear{false};   // out of the view
  bool is_arm_folded{false};  // and fit to drive
  bool holds_when_pick_fails{false};
  std::optional<int> hand;
  std::optional<int> view;  // where it stands; nothing: elsewhere
  std::map<std::uint64_t, int> plans;
  std::map<std::uint64_t, std::string> place_of;  // by plan of a pick
  std::uint64_t arm_plan{0};
  bool looked{false};
  std::set<std::uint64_t> ids;
  std::set<int> known;
  std::set<int> lost;
  std::set<int> unseen;  // by the detection, wherever it stands
  std::map<int, int> picks;
  std::map<int, int> blamed;  // failures that are the brick's, by this world's own judgement
  std::map<State, int> commands_of;
  int stowed{0};
  int unloaded{0};             // times
  std::string stow_place;      // of what was picked last, or planned to be stowed
  std::set<std::string> used;  // places in the container
  std::vector<std::string> reports;

 private:
  Result cancelledResult() const {
    switch (action) {
      case State::kPlanClear:
      case State::kPlanStow:
      case State::kPlanPick:
        return PlanResult{PlanStatus::kCancelled};
      case State::kLook:
        return LookResult{LookStatus::kCancelled, 0.0};
      case State::kWait:
        return WaitResult{WaitStatus::kCancelled};
      case State::kDrive:
        return NavigationResult{NavigationStatus::kCancelled, std::nullopt};
      case State::kSelect:
        return SelectionResult{SelectionStatus::kCancelled, std::nullopt, false};
      case State::kDetect:
        return DetectionResult{DetectionStatus::kShuttingDown, {}};
      case State::kReport:
        return ReportResult{ReportStatus::kRefused};
      default:
        return ArmResult{is_held ? ArmStatus::kHeld : ArmStatus::kCancelled};
    }
  }

  Result nominal(double now_s) {
    if (std::holds_alternative<command::PlanArm>(running->body)) return PlanResult{};
    if (std::holds_alternative<command::Look>(running->body)) return LookResult{LookStatus::kSuccess, now_s};
    if (std::holds_alternative<command::Detect>(running->body)) return DetectionResult{};
    if (std::holds_alternative<command::ReportFailure>(running->body)) return ReportResult{};
    if (std::holds_alternative<command::Drive>(running->body)) return NavigationResult{};
    if (std::holds_alternative<command::Wait>(running->body)) return WaitResult{};
    if (const auto* plan = std::get_if<command::PlanPick>(&running->body)) {
      const ToyBrick& wanted = brick(plan->brick.id);
      if (wanted.is_gone) return PlanResult{PlanStatus::kGoalInCollision};
      if (wanted.is_out_of_reach || view != wanted.view) return PlanResult{PlanStatus::kNoIk};
      if (isCovered(wanted)) return PlanResult{PlanStatus::kApproachBlocked};
      return PlanResult{PlanStatus::kSuccess, plan->brick.graspable_faces.front()};
    }
    if (const auto* pick = std::get_if<command::Pick>(&running->body)) {
      if (is_held) return ArmResult{ArmStatus::kHeld};
      const ToyBrick& wanted = brick(pick->brick.id);
      if (wanted.is_gone) return ArmResult{ArmStatus::kNoContact};
      if (wanted.has_no_plate) return ArmResult{ArmStatus::kNotAttached};
      return ArmResult{};
    }
    if (std::holds_alternative<command::MoveArm>(running->body)) {
      return ArmResult{is_held ? ArmStatus::kHeld : ArmStatus::kSuccess};
    }
    if (std::holds_alternative<command::LetGo>(running->body)) {
      return ArmResult{hand ? ArmStatus::kSuccess : ArmStatus::kNothingHeld};
    }
    if (std::holds_alternative<command::Recover>(running->body)) return ArmResult{};
    return select();
  }

  Result select() const {
    const auto& wanted = std::get<command::SelectView>(running->body);
    if (isCleared()) return SelectionResult{SelectionStatus::kNoPile, std::nullopt, false};
    std::optional<int> best;
    int most = 0;
    for (int v = 0; v < kNumViews; ++v) {
      const Eigen::Vector2d place = viewPose(v).position();
      const bool is_excluded =
          std::any_of(wanted.excluded.begin(), wanted.excluded.end(),
                      [&](const command::Zone& zone) { return (zone.center - place).norm() <= zone.radius_m; });
      if (is_excluded) continue;
      const int count = static_cast<int>(
          std::count_if(bricks.begin(), bricks.end(), [=](const ToyBrick& b) { return !isAway(b) && b.view == v; }));
      // Staying costs no travel.
      const bool stays = wanted.may_stay && view == v;
      if (count > most || (count > 0 && stays)) {
        most = stays ? static_cast<int>(bricks.size()) : count;
        best = v;
      }
    }
    if (!best) return SelectionResult{SelectionStatus::kNoCandidate, std::nullopt, false};
    return SelectionResult{SelectionStatus::kSuccess, viewPose(*best), true, wanted.may_stay && best == view};
  }

  void succeed(Result& result, double now_s) {
    if (std::holds_alternative<command::PlanArm>(running->body)) {
      arm_plan = running->id;
    } else if (const auto* plan = std::get_if<command::PlanPick>(&running->body)) {
      plans[running->id] = plan->brick.id;
    } else if (std::holds_alternative<command::MoveArm>(running->body)) {
      is_arm_clear = true;
      is_arm_folded = action == State::kClear;
    } else if (const auto* pick = std::get_if<command::Pick>(&running->body)) {
      is_arm_clear = true;
      is_arm_folded = false;
      take(pick->brick.id);
      stow();
      hand.reset();
    } else if (std::holds_alternative<command::LetGo>(running->body)) {
      if (hand) stow();
      hand.reset();
    } else if (const auto* drive = std::get_if<command::Drive>(&running->body)) {
      view.reset();
      for (int v = 0; v < kNumViews; ++v) {
        if ((viewPose(v).position() - drive->T_map_base.position()).norm() < 1e-6) view = v;
      }
      std::get<NavigationResult>(result).T_map_base = drive->T_map_base;
    } else if (std::holds_alternative<command::Look>(running->body)) {
      std::get<LookResult>(result).map_stamp_s = now_s;
    } else if (std::holds_alternative<command::Detect>(running->body)) {
      std::get<DetectionResult>(result).bricks = detect();
    } else if (const auto* report = std::get_if<command::ReportFailure>(&running->body)) {
      reports.push_back(report->reason);
    } else if (std::holds_alternative<command::SelectView>(running->body)) {
      auto& selection = std::get<SelectionResult>(result);
      if (!selection.T_map_base) selection.T_map_base = viewPose(0);
    }
  }

  void fail(const Result& result) {
    const auto* arm = std::get_if<ArmResult>(&result);
    if (std::holds_alternative<command::Drive>(running->body)) view.reset();
    if (std::holds_alternative<command::MoveArm>(running->body)) is_arm_clear = is_arm_folded = false;
    if (const auto* pick = std::get_if<command::Pick>(&running->body)) {
      is_arm_clear = is_arm_folded = false;
      const int id = pick->brick.id;
      const ToyBrick& wanted = brick(id);
      const bool is_not_let_go = arm != nullptr && arm->status == ArmStatus::kNotLetGo;
      const bool is_lost = arm != nullptr && arm->status == ArmStatus::kLostOnTheWay;
      if (!wanted.is_gone && !is_lost && (holds_when_pick_fails || is_not_let_go)) {
        take(id);
        hand = id;
      } else if (is_lost && !wanted.is_gone) {
        // It lies at the foot of the next stack.
        brick(id).view = (brick(id).view + 2) % kNumViews;
        brick(id).layer = 100 + id;
      }
      static const std::set<ArmStatus> kOfBrick = {
          ArmStatus::kBadRequest,      ArmStatus::kBeyondLimits, ArmStatus::kPathBlocked, ArmStatus::kNoContact,
          ArmStatus::kContactTooEarly, ArmStatus::kNotAttached,  ArmStatus::kLostOnTheWay};
      if (arm != nullptr && kOfBrick.count(arm->status) > 0 && !hand) ++blamed[id];
    } else if (arm != nullptr && hand &&
               (arm->status == ArmStatus::kLostOnTheWay || arm->status == ArmStatus::kNothingHeld)) {
      // It fell: it lies before the pile again.
      brick(*hand).is_gone = false;
      brick(*hand).layer = 100 + *hand;
      ++blamed[*hand];
      hand.reset();
    }
  }

  void take(int id) { brick(id).is_gone = true; }

  void stow() {
    ++stowed;
    EXPECT_TRUE(used.insert(stow_place).second) << "two bricks at " << stow_place;
  }

  std::vector<SeenBrick> detect() {
    std::vector<SeenBrick> seen;
    for (const ToyBrick& b : bricks) {
      if (isAway(b) || unseen.count(b.id) > 0) {
        known.erase(b.id);
        continue;
      }
      const int apart = view ? std::abs(*view - b.view) : kNumViews;
      const bool is_visible = !view || std::min(apart, kNumViews - apart) <= 2;
      if (is_visible) known.insert(b.id);
      if (known.count(b.id) == 0) continue;
      SeenBrick brick_seen;
      brick_seen.id = b.id;
      brick_seen.type = "brick";
      const Pose2d place = viewPose(b.view);
      brick_seen.T_map_brick.translation() = Eigen::Vector3d(0.5 * place.x_m, 0.5 * place.y_m, 0.1 * b.layer + 0.05);
      brick_seen.graspable_faces = {4, 0};
      brick_seen.is_in_sector = view == b.view;
      brick_seen.is_seen_now = is_visible;
      seen.push_back(brick_seen);
    }
    return seen;
  }
};

/// A mission in a world, step by step.
class ToyMission {
 public:
  using Inject = std::function<std::optional<Result>(State action, int count)>;  // count: of this action, from 1

  ToyMission(const MissionConfig& mission_config, ToyWorld toy_world)
      : config(mission_config),
        machine(mission_config, MissionInfo{"toy", 1, "gpis", ""}),
        world(std::move(toy_world)) {}

  void tell(const Event& event) {
    const MissionOutput output = machine.step(event, now_s);
    log.insert(log.end(), output.log.begin(), output.log.end());
    world.accept(output.commands, machine.state());
    for (const Command& command : output.commands) commands.push_back(command);
  }

  void start() {
    event::Start start;
    start.T_map_base = {-3.0, 0.0, 0.0};
    start.hand = world.handState();
    tell(start);
  }

  /// Lets what runs end. False: nothing runs.
  bool advance() {
    const bool ends_pick = world.carrying && (!world.running || world.carried_until_s <= now_s + world.duration());
    if (!world.running && !ends_pick) return false;
    const double end_s = ends_pick ? std::max(now_s, world.carried_until_s) : now_s + world.duration();
    now_s = 0.5 * (now_s + end_s);
    tell(event::Tick{});
    if (!ends_pick && world.action == State::kPick && !world.is_held && !world.is_cancelled) {
      tell(event::PileLeft{world.running->id});
      world.carried_until_s = end_s;
      if (world.carrying) return true;
    }
    now_s = end_s;
    const State ended = ends_pick ? State::kPick : world.action;
    const std::optional<Result> forced =
        inject && !world.is_cancelled ? inject(ended, world.commands_of[ended]) : std::nullopt;
    tell(ends_pick ? world.finishPick(now_s, forced) : world.finish(now_s, forced));
    if (machine.state() == State::kUnload && unloads) unload();
    return true;
  }

  void unload() {
    world.used.clear();
    ++world.unloaded;
    tell(event::Unloaded{});
  }

  /// The same with what is injected as it is: the world would fill in what it sees.
  void advancePastTheWorld() {
    now_s += 1.0;
    const std::optional<Result> forced = inject(world.action, world.commands_of[world.action]);
    event::Reply reply = world.finish(now_s, forced);
    if (forced) reply.result = *forced;
    tell(reply);
  }

  /// The commands of a kind until now.
  template <typename Body>
  std::vector<Body> sent() const {
    std::vector<Body> bodies;
    for (const Command& command : commands) {
      if (const auto* body = std::get_if<Body>(&command.body)) bodies.push_back(*body);
    }
    return bodies;
  }

  bool isOver() const { return machine.state() == State::kEnded; }
  /// Started if it is not, it comes to its end, with this reason.
  testing::AssertionResult endsAs(EndReason reason);

  /// To the end, or until nothing runs. False: it goes on and on.
  bool toEnd(int max_steps = 3000) {
    for (int i = 0; i < max_steps; ++i) {
      if (!advance()) return true;
    }
    return false;
  }

  MissionConfig config;
  MissionMachine machine;
  ToyWorld world;
  Inject inject;
  bool unloads{true};  // somebody, at the depot
  double now_s{100.0};
  std::vector<LogEntry> log;
  std::vector<Command> commands;
};

/// To be injected: this result for such an action, the first `times` that there are.
inline ToyMission::Inject endAs(State which, Result result, int times = std::numeric_limits<int>::max()) {
  return [=](State action, int count) {
    return action == which && count <= times ? std::optional<Result>(result) : std::nullopt;
  };
}

inline std::string tail(const ToyMission& run, std::size_t count = 25) {
  std::string text;
  for (std::size_t i = run.log.size() - std::min(count, run.log.size()); i < run.log.size(); ++i) {
    text += toJsonLine(run.log[i]) + "\n";
  }
  return text + "ended: " + toString(run.machine.endReason()) + ": " + run.machine.endMessage() + "\n";
}

inline testing::AssertionResult ToyMission::endsAs(EndReason reason) {
  if (machine.state() == State::kIdle) start();
  if (!toEnd()) return testing::AssertionFailure() << "it goes on and on\n" << tail(*this);
  if (machine.endReason() == reason) return testing::AssertionSuccess();
  return testing::AssertionFailure() << "must end as " << toString(reason) << "\n" << tail(*this);
}

}  // namespace toy
