// SPDX-License-Identifier: BSD-3-Clause
// Pause, resume, hold and stop at every step of a mission; and a clock that is set.
#include <limits>

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include "pick_mission/clock_steps.h"
#include "support/toy_world.h"

namespace toy {
namespace {

/// A mission that comes through every state: it begins with a brick in the hand, a pick fails, the arm has to be recovered
/// and waited for, a brick is not let go.
ToyMission eventfulMission() {
  ToyWorld world = ToyWorld::ofStacks({3, 1});
  world.bricks[3].is_gone = true;
  world.hand = 3;
  ToyMission run({}, std::move(world));
  run.inject = [](State action, int count) -> std::optional<Result> {
    if (action == State::kClear && count == 2) return ArmResult{ArmStatus::kProgramStopped};
    if (action == State::kClear && count == 3) return ArmResult{ArmStatus::kStaleMap};
    if (action == State::kPick && count == 1) return ArmResult{ArmStatus::kNoContact};
    if (action == State::kPick && count == 2) return ArmResult{ArmStatus::kNotLetGo};
    return std::nullopt;
  };
  return run;
}

int numSteps() {
  ToyMission run = eventfulMission();
  run.start();
  int steps = 0;
  while (run.advance()) ++steps;
  return steps;
}

/// To the step, or false when it has ended before.
bool toStep(ToyMission& run, int step) {
  run.start();
  for (int i = 0; i < step; ++i) {
    if (!run.advance()) return false;
  }
  return run.world.running || run.world.carrying;
}

void expectWholeMission(const ToyMission& run) {
  EXPECT_EQ(run.machine.state(), State::kEnded) << tail(run);
  EXPECT_EQ(run.machine.endReason(), EndReason::kNoBrickLeft) << tail(run);
  EXPECT_EQ(run.world.stowed, 4) << tail(run);
  EXPECT_EQ(run.machine.counts().bricks_picked, 4) << tail(run);
  EXPECT_FALSE(run.world.hand);
}

TEST(MissionInterruptions, TheMissionInterruptedComesThroughEveryAction) {
  ToyMission run = eventfulMission();
  run.start();
  ASSERT_TRUE(run.toEnd());
  expectWholeMission(run);
  for (int i = 0; i < kNumStates; ++i) {
    const State state = static_cast<State>(i);
    if (isAction(state)) {
      EXPECT_GT(run.world.commands_of[state], 0) << toString(state);
    }
  }
}

TEST(MissionInterruptions, PauseAtEveryStepLetsItEndAndResumeGoesOn) {
  const int steps = numSteps();
  ASSERT_GT(steps, 30);
  for (int step = 0; step < steps; ++step) {
    SCOPED_TRACE("step " + std::to_string(step));
    ToyMission run = eventfulMission();
    ASSERT_TRUE(toStep(run, step));
    const std::size_t before = run.commands.size();
    run.tell(event::Pause{});
    EXPECT_EQ(run.commands.size(), before) << "a pause commands something";
    const bool is_beside = run.world.running && run.world.carrying;
    ASSERT_TRUE(run.advance());
    if (is_beside) {
      ASSERT_TRUE(run.advance());
    }
    if (run.isOver()) continue;  // what ran was the last
    ASSERT_EQ(run.machine.state(), State::kPaused) << tail(run);
    EXPECT_FALSE(run.world.running);
    // Time does not count meanwhile.
    const double used_s = run.machine.usedTime();
    run.now_s += 1e5;
    run.tell(event::Tick{});
    EXPECT_EQ(run.machine.usedTime(), used_s);
    run.tell(event::Resume{});
    EXPECT_TRUE(run.world.running);
    ASSERT_TRUE(run.toEnd());
    expectWholeMission(run);
    ASSERT_FALSE(HasFailure()) << tail(run);
  }
}

TEST(MissionInterruptions, PauseTakenBackChangesNothing) {
  const int steps = numSteps();
  for (int step = 0; step < steps; ++step) {
    ToyMission run = eventfulMission();
    ASSERT_TRUE(toStep(run, step));
    run.tell(event::Pause{});
    run.tell(event::Resume{});
    int rest = step;
    while (run.advance()) ++rest;
    EXPECT_EQ(rest, steps) << "paused and resumed at step " << step;
    expectWholeMission(run);
  }
}

TEST(MissionInterruptions, StopAtEveryStepCancelsAndEnds) {
  const int steps = numSteps();
  for (int step = 0; step < steps; ++step) {
    SCOPED_TRACE("step " + std::to_string(step));
    ToyMission run = eventfulMission();
    ASSERT_TRUE(toStep(run, step));
    run.tell(event::Stop{});
    EXPECT_TRUE(run.world.is_cancelled);
    EXPECT_EQ(run.machine.state(), State::kHalting);
    ASSERT_TRUE(run.advance());
    EXPECT_EQ(run.machine.state(), State::kEnded);
    EXPECT_EQ(run.machine.endReason(), EndReason::kStopped);
    EXPECT_FALSE(run.advance()) << "goes on after the end";
    for (const Event& event : {Event{event::Start{}}, Event{event::Resume{}}, Event{event::Pause{}},
                               Event{event::Tick{}}, Event{event::Stop{}}}) {
      run.tell(event);
    }
    EXPECT_EQ(run.machine.state(), State::kEnded);
    EXPECT_FALSE(run.world.running);
  }
}

TEST(MissionInterruptions, StopEndsEvenWhatDoesNotEnd) {
  const int steps = numSteps();
  for (int step = 0; step < steps; ++step) {
    ToyMission run = eventfulMission();
    ASSERT_TRUE(toStep(run, step));
    run.tell(event::Stop{});
    run.now_s += run.config.time.cancel_timeout_s - 0.1;
    run.tell(event::Tick{});
    EXPECT_EQ(run.machine.state(), State::kHalting);
    run.now_s += 0.2;
    run.tell(event::Tick{});
    EXPECT_EQ(run.machine.state(), State::kEnded) << "stopped at step " << step;
    EXPECT_EQ(run.machine.endReason(), EndReason::kStopped);
  }
}

TEST(MissionInterruptions, HoldAtEveryStepStopsAtOnceAndResumeGoesOn) {
  const int steps = numSteps();
  for (const bool has_grasped : {false, true}) {
    for (int step = 0; step < steps; ++step) {
      SCOPED_TRACE("step " + std::to_string(step) + (has_grasped ? ", a pick that has grasped" : ""));
      ToyMission run = eventfulMission();
      ASSERT_TRUE(toStep(run, step));
      run.world.holds_when_pick_fails = has_grasped;
      const std::size_t before = run.commands.size();
      run.tell(event::Hold{});
      EXPECT_TRUE(run.world.is_held);
      EXPECT_TRUE(run.world.is_cancelled);
      ASSERT_EQ(run.commands.size(), before + 2);
      EXPECT_TRUE(std::holds_alternative<command::Hold>(run.commands[before].body)) << "the hold comes first";
      ASSERT_TRUE(run.advance());
      ASSERT_EQ(run.machine.state(), State::kHeld) << tail(run);
      EXPECT_FALSE(run.world.running);
      run.world.holds_when_pick_fails = false;
      run.tell(event::Resume{});
      EXPECT_FALSE(run.world.is_held);
      ASSERT_TRUE(run.toEnd());
      // What was injected may have fallen victim to the hold; the bricks have not.
      expectWholeMission(run);
      ASSERT_FALSE(HasFailure()) << tail(run);
    }
  }
}

TEST(MissionInterruptions, HoldResumedBeforeItHasHaltedGoesOn) {
  const int steps = numSteps();
  for (int step = 0; step < steps; ++step) {
    ToyMission run = eventfulMission();
    ASSERT_TRUE(toStep(run, step));
    run.tell(event::Hold{});
    run.tell(event::Resume{});
    EXPECT_FALSE(run.world.is_held);
    EXPECT_EQ(run.machine.state(), State::kHalting);
    ASSERT_TRUE(run.toEnd());
    expectWholeMission(run);
  }
}

/// At a view from which its only brick could not be picked, before it goes on. The brick is out of reach until somebody
/// moves it.
ToyMission missionThatHasTriedInVain() {
  ToyWorld world = ToyWorld::ofStacks({1});
  world.bricks[0].is_out_of_reach = true;
  ToyMission run({}, std::move(world));
  run.start();
  while (run.world.action != State::kSelect || run.world.commands_of[State::kPlanPick] == 0) {
    if (!run.advance()) break;
  }
  return run;
}

TEST(MissionInterruptions, ResumeTriesFromHereWhatWasTriedInVain) {
  for (const bool is_hold : {false, true}) {
    for (const bool knows_place : {false, true}) {
      SCOPED_TRACE(std::string(is_hold ? "hold" : "pause") + (knows_place ? ", place known" : ""));
      ToyMission run = missionThatHasTriedInVain();
      ASSERT_TRUE(run.world.running) << tail(run);
      if (is_hold) {
        run.tell(event::Hold{});
      } else {
        run.tell(event::Pause{});
      }
      ASSERT_TRUE(run.advance());
      ASSERT_FALSE(run.world.running);
      run.world.bricks[0].is_out_of_reach = false;
      const int drives = run.world.commands_of[State::kDrive];
      event::Resume resume;
      if (knows_place) resume.T_map_base = viewPose(0);
      run.tell(resume);
      while (run.world.stowed == 0) ASSERT_TRUE(run.advance()) << tail(run);
      EXPECT_EQ(run.world.commands_of[State::kDrive], drives) << "it had to go away first\n" << tail(run);
    }
  }
}

TEST(MissionInterruptions, ResumeReadsWhereTheRobotIs) {
  const Pose2d elsewhere{4.0, -5.0, 0.5};
  const auto saved = nlohmann::json{elsewhere.x_m, elsewhere.y_m, elsewhere.yaw_rad};
  for (const std::string from : {"pause", "hold", "halting for a hold"}) {
    SCOPED_TRACE(from);
    ToyMission run = missionThatHasTriedInVain();
    const int scene = run.machine.toJson().at("scene").get<int>();
    if (from == "pause") {
      run.tell(event::Pause{});
    } else {
      run.tell(event::Hold{});
    }
    if (from != "halting for a hold") {
      ASSERT_TRUE(run.advance());
    }
    run.tell(event::Resume{elsewhere});
    EXPECT_EQ(run.machine.toJson().at("base"), saved);
    EXPECT_GT(run.machine.toJson().at("scene").get<int>(), scene);
  }
  ToyMission run = missionThatHasTriedInVain();
  run.tell(event::Pause{});
  run.tell(event::Resume{elsewhere});
  EXPECT_NE(run.machine.toJson().at("base"), saved) << "it has not paused";
}

// Whoever pauses and resumes after each attempt: those of the brick are used up nevertheless.
TEST(MissionInterruptions, ResumeAgainAndAgainTriesNothingForEver) {
  for (const bool knows_place : {false, true}) {
    ToyMission run = missionThatHasTriedInVain();
    for (int step = 0; step < 3000 && !run.isOver(); ++step) {
      if (run.world.action == State::kPlanPick) run.tell(event::Pause{});
      if (run.machine.state() == State::kPaused) {
        run.tell(knows_place ? event::Resume{viewPose(0)} : event::Resume{});
      } else {
        ASSERT_TRUE(run.advance());
      }
    }
    ASSERT_TRUE(run.isOver()) << tail(run);
    EXPECT_LE(run.world.commands_of[State::kPlanPick], run.config.attempts.max_plans_per_brick);
  }
}

// As NTP sets it when the network is there at last.
TEST(MissionInterruptions, ClockThatIsSetForwardAtEveryStepCountsNothing) {
  constexpr double kJump_s = 1e6;  // more than all limits
  const int steps = numSteps();
  ToyMission whole = eventfulMission();
  whole.start();
  ASSERT_TRUE(whole.toEnd());
  for (const bool is_halting : {false, true}) {
    for (int step = 0; step < steps; ++step) {
      SCOPED_TRACE("step " + std::to_string(step) + (is_halting ? ", halting" : ""));
      ToyMission run = eventfulMission();
      ASSERT_TRUE(toStep(run, step));
      if (is_halting) run.tell(event::Hold{});
      const State before = run.machine.state();
      const double used_s = run.machine.usedTime();
      run.now_s += kJump_s;
      run.tell(event::ClockJump{kJump_s});
      EXPECT_DOUBLE_EQ(run.machine.usedTime(), used_s);
      EXPECT_LT(run.log.back().state_s, run.config.time.action_timeout_s) << "in the state since before the jump";
      run.tell(event::Tick{});
      ASSERT_EQ(run.machine.state(), before) << tail(run);
      if (is_halting) {
        ASSERT_TRUE(run.advance());
        ASSERT_EQ(run.machine.state(), State::kHeld) << tail(run);
        run.tell(event::Resume{});
      }
      ASSERT_TRUE(run.toEnd());
      expectWholeMission(run);
      EXPECT_LT(run.machine.usedTime(), whole.machine.usedTime() + run.config.time.action_timeout_s);
      ASSERT_FALSE(HasFailure()) << tail(run);
    }
  }
}

TEST(MissionInterruptions, LimitsOfTimeHoldAfterTheClockWasSet) {
  ToyMission run = eventfulMission();
  ASSERT_TRUE(toStep(run, 5));
  run.now_s += 1000.0;
  run.tell(event::ClockJump{999.0});
  EXPECT_NEAR(run.machine.usedTime(), 1.0, 10.0) << "what has passed beside the jump";
  run.now_s += run.config.time.action_timeout_s;
  run.tell(event::Tick{});
  EXPECT_EQ(run.machine.state(), State::kHalting);
  EXPECT_THROW(run.tell(event::ClockJump{std::numeric_limits<double>::infinity()}), std::invalid_argument);
}

TEST(ClockSteps, AreWhatTheSteadyClockDoesNotShow) {
  ClockSteps steps;
  EXPECT_EQ(steps.advance(1e9, 5.0), 0.0);
  EXPECT_NEAR(steps.advance(1e9 + 2.0, 7.0), 0.0, 1e-6);
  EXPECT_NEAR(steps.advance(1e9 + 3602.5, 7.5), 3600.0, 1e-6);
  EXPECT_NEAR(steps.advance(1e9 + 3603.5, 8.5), 0.0, 1e-6) << "once";
  EXPECT_NEAR(steps.advance(1e9 + 4.0, 9.0), -3600.0, 1e-6);
}

TEST(MissionInterruptions, StopWhilePausedOrHeldEnds) {
  for (const bool is_hold : {false, true}) {
    ToyMission run = eventfulMission();
    ASSERT_TRUE(toStep(run, 5));
    if (is_hold) {
      run.tell(event::Hold{});
    } else {
      run.tell(event::Pause{});
    }
    ASSERT_TRUE(run.advance());
    ASSERT_EQ(run.machine.state(), is_hold ? State::kHeld : State::kPaused);
    run.tell(event::Stop{});
    EXPECT_EQ(run.machine.endReason(), EndReason::kStopped);
    EXPECT_EQ(run.machine.state(), State::kEnded);
  }
}

TEST(MissionInterruptions, HoldWhileHaltingForAStopStillStops) {
  ToyMission run = eventfulMission();
  ASSERT_TRUE(toStep(run, 5));
  run.tell(event::Stop{});
  run.tell(event::Hold{});
  EXPECT_TRUE(run.world.is_held);
  ASSERT_TRUE(run.advance());
  EXPECT_EQ(run.machine.state(), State::kEnded);
}

TEST(MissionInterruptions, HoldOfTheArmByAPersonIsWaitedOut) {
  ToyMission run = eventfulMission();
  ASSERT_TRUE(toStep(run, 0));
  while (run.world.action != State::kPick) ASSERT_TRUE(run.advance());
  run.world.is_held = true;  // at the arm's bridge, past the mission
  run.inject = nullptr;
  ASSERT_TRUE(run.advance());
  EXPECT_EQ(run.machine.state(), State::kHeld);
  run.tell(event::Resume{});
  ASSERT_TRUE(run.toEnd());
  expectWholeMission(run);
}

TEST(MissionInterruptions, ResumeReleasesAHoldByAPersonThoughAPauseWasWanted) {
  ToyMission run = eventfulMission();
  ASSERT_TRUE(toStep(run, 0));
  while (run.world.action != State::kPick) ASSERT_TRUE(run.advance());
  run.tell(event::Pause{});
  run.world.is_held = true;  // at the arm's bridge, past the mission
  run.inject = nullptr;
  ASSERT_TRUE(run.advance());
  ASSERT_EQ(run.machine.state(), State::kHeld);
  run.tell(event::Resume{});
  EXPECT_NE(run.machine.state(), State::kHeld) << tail(run);
  EXPECT_FALSE(run.world.is_held);
  ASSERT_TRUE(run.toEnd());
  expectWholeMission(run);
}

TEST(MissionInterruptions, ResumeDoesNotPretendToTakeAStopBack) {
  ToyMission run = eventfulMission();
  ASSERT_TRUE(toStep(run, 5));
  run.tell(event::Pause{});
  run.tell(event::Stop{});
  run.tell(event::Resume{});
  EXPECT_EQ(run.log.back().reason.find("ignored"), 0u) << tail(run);
  ASSERT_TRUE(run.advance());
  EXPECT_EQ(run.machine.endReason(), EndReason::kStopped);
}

TEST(MissionInterruptions, BeforeTheStartNothingButAHoldIsPassedOn) {
  ToyMission run = eventfulMission();
  for (const Event& event :
       {Event{event::Resume{}}, Event{event::Pause{}}, Event{event::Tick{}}, Event{event::Stop{}}}) {
    run.tell(event);
  }
  EXPECT_TRUE(run.commands.empty());
  EXPECT_EQ(run.machine.state(), State::kIdle);
  run.tell(event::Hold{});
  EXPECT_TRUE(run.world.is_held);
}

TEST(MissionInterruptions, ResumeReleasesAHoldAlsoBeforeTheMissionAndAfterIt) {
  ToyMission run = eventfulMission();
  run.tell(event::Hold{});
  run.tell(event::Resume{});
  EXPECT_FALSE(run.world.is_held);
  EXPECT_EQ(run.machine.state(), State::kIdle);
  EXPECT_EQ(run.log.back().reason.find("ignored"), std::string::npos);
  run.tell(event::Resume{});
  EXPECT_EQ(run.commands.size(), 2u) << "only once";
  EXPECT_EQ(run.log.back().reason.find("ignored"), 0u);
  ASSERT_TRUE(toStep(run, 5));
  run.tell(event::Hold{});
  ASSERT_TRUE(run.advance());
  run.tell(event::Stop{});
  ASSERT_TRUE(run.isOver());
  EXPECT_TRUE(run.world.is_held) << "nobody has released it";
  run.tell(event::Resume{});
  EXPECT_FALSE(run.world.is_held);
  EXPECT_TRUE(run.isOver());
}

}  // namespace
}  // namespace toy
