// SPDX-License-Identifier: BSD-3-Clause
// Every result of every action, injected where the mission sees it: it goes on, or it ends with a reason that names it.
#include <algorithm>

#include <gmock/gmock.h>

#include "support/toy_world.h"

namespace toy {
namespace {

using testing::HasSubstr;

/// So that the mission comes to `action`, before anything else is injected.
std::optional<Result> prelude(State target, State action, int count) {
  if (target == State::kRecover && action == State::kClear && count == 1) return ArmResult{ArmStatus::kProgramStopped};
  if (target == State::kWait && action == State::kClear && count == 1) return ArmResult{ArmStatus::kStaleMap};
  if (target == State::kReport && action == State::kPick && count == 1) return ArmResult{ArmStatus::kNoContact};
  return std::nullopt;
}

bool isForStow(State action) {
  return action == State::kPlanStow || action == State::kStow || action == State::kLetGo;
}

ToyMission missionThatComesTo(State target) {
  ToyWorld world = ToyWorld::ofStacks({2, 2});
  if (isForStow(target)) {
    world.bricks[1].is_gone = true;
    world.hand = 1;
  }
  return {surveying(), std::move(world)};
}

/// A stand-in for the world where results have contents.
Result filled(const Result& result) {
  if (const auto* selection = std::get_if<SelectionResult>(&result)) {
    if (selection->status == SelectionStatus::kLowUtility) {
      return SelectionResult{SelectionStatus::kLowUtility, viewPose(2), true};
    }
  }
  return result;
}

std::vector<State> actions() {
  std::vector<State> states;
  for (int i = 0; i < kNumStates; ++i) {
    if (isAction(static_cast<State>(i))) states.push_back(static_cast<State>(i));
  }
  return states;
}

class EachAction : public testing::TestWithParam<State> {};

TEST_P(EachAction, FailsOnceAndTheMissionGoesOnOrNamesIt) {
  const State target = GetParam();
  for (const Result& result : possibleResults(target)) {
    if (isSuccess(result)) continue;
    for (const bool holds : {false, true}) {
      if (holds && target != State::kPick) continue;
      SCOPED_TRACE(std::string(toString(target)) + ": " + toString(result) + (holds ? ", with the brick" : ""));
      ToyMission run = missionThatComesTo(target);
      run.world.holds_when_pick_fails = holds;
      bool is_injected = false;
      run.inject = [&](State action, int count) -> std::optional<Result> {
        if (action == target && count == 1) {
          is_injected = true;
          return filled(result);
        }
        return prelude(target, action, count);
      };
      run.start();
      ASSERT_TRUE(run.toEnd()) << tail(run);
      if (run.machine.state() == State::kHeld) {
        run.tell(event::Resume{});
        ASSERT_TRUE(run.toEnd()) << tail(run);
      }
      ASSERT_TRUE(is_injected);
      ASSERT_TRUE(run.isOver()) << tail(run);
      const std::string kind = std::string(toString(target)) + ": " + toString(result);
      EXPECT_EQ(run.machine.summary(0.0).failures.count(kind), 1u) << tail(run);
      if (run.machine.endReason() == EndReason::kNoBrickLeft && run.world.numLeft() == 0) {
        EXPECT_EQ(run.world.stowed, 4);
        EXPECT_EQ(run.machine.counts().bricks_picked, 4) << tail(run);
      } else {
        EXPECT_THAT(run.machine.endMessage(), HasSubstr(toString(target))) << tail(run);
        EXPECT_THAT(run.machine.endMessage(), HasSubstr(toString(result))) << tail(run);
      }
      ASSERT_FALSE(HasFailure()) << tail(run);
    }
  }
}

TEST_P(EachAction, FailsAlwaysAndTheMissionEndsAndNamesIt) {
  const State target = GetParam();
  for (const Result& result : possibleResults(target)) {
    if (isSuccess(result)) continue;
    SCOPED_TRACE(std::string(toString(target)) + ": " + toString(result));
    ToyMission run = missionThatComesTo(target);
    run.inject = [&](State action, int count) -> std::optional<Result> {
      if (action == target) return filled(result);
      return prelude(target, action, count);
    };
    run.start();
    ASSERT_TRUE(run.toEnd()) << tail(run);
    for (int resumed = 0; resumed < 3 && run.machine.state() == State::kHeld; ++resumed) {
      run.tell(event::Resume{});
      ASSERT_TRUE(run.toEnd()) << tail(run);
    }
    const auto* arm = std::get_if<ArmResult>(&result);
    if (arm != nullptr && arm->status == ArmStatus::kHeld) {
      // For as long as somebody holds; a recovery is not needed any more after that.
      EXPECT_EQ(run.machine.state(), target == State::kRecover ? State::kEnded : State::kHeld);
      continue;
    }
    ASSERT_TRUE(run.isOver()) << tail(run);
    const std::string kind = std::string(toString(target)) + ": " + toString(result);
    EXPECT_GE(run.machine.summary(0.0).failures.count(kind), 1u);
    const bool is_whole = run.machine.endReason() == EndReason::kNoBrickLeft && run.world.numLeft() == 0;
    if (target == State::kReport || is_whole) {
      // Goes on without.
      EXPECT_TRUE(is_whole) << tail(run);
    } else if (run.machine.endReason() == EndReason::kBricksExhausted ||
               run.machine.endReason() == EndReason::kNoProgress ||
               run.machine.endReason() == EndReason::kNothingWorthGoing) {
      // Of the bricks that it was tried on, each tells it; a selection or a drive names itself.
      bool is_named = run.machine.endMessage().find(toString(result)) != std::string::npos;
      for (const auto& [id, record] : run.machine.bricks().bricks()) is_named |= record.last_failure == kind;
      EXPECT_TRUE(is_named) << tail(run);
    } else {
      EXPECT_THAT(run.machine.endMessage(), HasSubstr(toString(target))) << tail(run);
      EXPECT_THAT(run.machine.endMessage(), HasSubstr(toString(result))) << tail(run);
    }
    EXPECT_LE(run.world.commands_of[target], 60) << "tried for ever\n" << tail(run);
    ASSERT_FALSE(HasFailure()) << tail(run);
  }
}

/// What runs takes too long. `is_heard`: it ends when it is cancelled.
void letItTakeTooLong(ToyMission& run, bool is_heard) {
  run.now_s += run.config.time.action_timeout_s + 1.0;
  run.tell(event::Tick{});
  ASSERT_EQ(run.machine.state(), State::kHalting);
  if (is_heard) return run.tell(run.world.finish(run.now_s));
  run.world.abandon();
  run.now_s += run.config.time.cancel_timeout_s + 1.0;
  run.tell(event::Tick{});
}

TEST(BrickInTheHand, ThatCannotBePutDownInTimeEndsTheMission) {
  for (const State target : {State::kPlanStow, State::kStow, State::kLetGo}) {
    for (const bool is_heard : {true, false}) {
      SCOPED_TRACE(std::string(toString(target)) + (is_heard ? "" : ", and is not even cancelled"));
      ToyMission run = missionThatComesTo(target);
      run.start();
      int times = 0;
      for (int i = 0; i < 500 && run.world.running; ++i) {
        if (run.world.action == target) {
          ++times;
          letItTakeTooLong(run, is_heard);
        } else {
          ASSERT_TRUE(run.advance());
        }
      }
      ASSERT_TRUE(run.isOver()) << "tried for ever\n" << tail(run);
      EXPECT_EQ(run.machine.endReason(), EndReason::kBrickInHand) << tail(run);
      // Once more than in a row, for a brick that some other action has left in the hand.
      EXPECT_LE(times, run.config.attempts.max_failures_in_a_row + 1);
      EXPECT_THAT(run.machine.endMessage(), HasSubstr(toString(target)));
    }
  }
}

// Whatever was given up with a brick in the hand: first it is put down.
TEST(BrickInTheHand, AfterPicksThatTookTooLongIsPutDownBeforeTheEnd) {
  ToyMission run = missionThatComesTo(State::kPick);
  run.world.holds_when_pick_fails = true;
  run.config.attempts.max_failures_in_a_row = 1;
  run.machine = MissionMachine(run.config, MissionInfo{"toy", 1, "gpis", ""});
  run.start();
  while (run.world.action != State::kPick) ASSERT_TRUE(run.advance());
  letItTakeTooLong(run, true);
  ASSERT_TRUE(run.toEnd()) << tail(run);
  EXPECT_EQ(run.machine.endReason(), EndReason::kPicksFailed) << tail(run);
  EXPECT_EQ(run.world.stowed, 1) << tail(run);
}

INSTANTIATE_TEST_SUITE_P(Actions, EachAction, testing::ValuesIn(actions()),
                         [](const auto& tested) { return std::string(toString(tested.param)); });

}  // namespace
}  // namespace toy
