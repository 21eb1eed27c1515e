// SPDX-License-Identifier: BSD-3-Clause
// The mission's process dies at every step, and another one goes on with what it had saved.
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include "support/toy_world.h"

namespace toy {
namespace {

ToyMission mission() {
  ToyWorld world = ToyWorld::ofStacks({3, 1});
  world.bricks[1].has_no_plate = true;
  world.bricks[1].layer = -1;  // under the others
  MissionConfig config = surveying();
  config.bricks_total = 4;
  return {config, std::move(world)};
}

TEST(MissionRestart, AtEveryStepGoesOnAfterAFreshInspectionAndEnds) {
  ToyMission whole = mission();
  whole.start();
  ASSERT_TRUE(whole.toEnd());
  const int steps = static_cast<int>(whole.commands.size());
  ASSERT_GT(steps, 30);
  ASSERT_EQ(whole.machine.endReason(), EndReason::kBricksExhausted);
  for (const bool has_grasped : {false, true}) {
    for (int step = 0; step < steps; ++step) {
      SCOPED_TRACE("step " + std::to_string(step) + (has_grasped ? ", a pick that has grasped" : ""));
      ToyMission run = mission();
      run.start();
      for (int i = 0; i < step; ++i) ASSERT_TRUE(run.advance());
      const std::string saved = run.machine.toJson().dump();
      const MissionCounts before = run.machine.counts();
      const double used_s = run.machine.usedTime();
      // Bricks without a plate hold nothing.
      const auto* pick = std::get_if<command::Pick>(&run.world.running->body);
      const int more_drives = pick != nullptr ? 3 : 1;
      run.world.holds_when_pick_fails = has_grasped && pick != nullptr && !run.world.brick(pick->brick.id).has_no_plate;
      run.world.abandon();
      run.world.holds_when_pick_fails = false;

      run.machine =
          MissionMachine::fromJson(run.config, MissionInfo{"toy", 1, "gpis", ""}, nlohmann::json::parse(saved));
      EXPECT_EQ(run.machine.state(), State::kIdle);
      EXPECT_EQ(run.machine.counts().bricks_picked, before.bricks_picked);
      EXPECT_EQ(run.machine.counts().views, before.views);
      EXPECT_EQ(run.machine.usedTime(), used_s);
      EXPECT_FALSE(run.advance()) << "goes on without a start";
      run.log.clear();
      const std::size_t first = run.commands.size();
      run.now_s += 1000.0;
      run.start();
      std::vector<State> begun;
      for (int i = 0; i < 20 && begun.size() < 4; ++i) {
        if (begun.empty() || run.world.action != begun.back()) begun.push_back(run.world.action);
        ASSERT_TRUE(run.advance());
      }
      if (run.log.front().decision == State::kBegin && begun.front() == State::kPlanClear) {
        EXPECT_EQ(begun, (std::vector<State>{State::kPlanClear, State::kClear, State::kLook, State::kDetect}));
      } else {
        const State next =
            begun.back() == State::kPlanClear ? State::kPlanClear : State::kLook;  // if the container is full
        EXPECT_EQ(begun, (std::vector<State>{State::kPlanStow, State::kStow, State::kLetGo, next}));
        EXPECT_TRUE(has_grasped);
      }
      ASSERT_TRUE(run.toEnd());
      EXPECT_EQ(run.machine.state(), State::kEnded) << tail(run);
      EXPECT_EQ(run.machine.endReason(), EndReason::kBricksExhausted) << tail(run);
      EXPECT_EQ(run.world.stowed, 3) << tail(run);
      EXPECT_EQ(run.machine.counts().bricks_picked, 3) << tail(run);
      // An interrupted pick may use up the last attempt before the last other brick is taken: that gives one back.
      EXPECT_LE(run.world.picks[1], whole.world.picks[1] + 1) << "the attempts began anew";
      EXPECT_LT(run.machine.usedTime(), used_s + run.now_s - 1000.0);
      // The survey is not driven twice. The brick of a pick that was going on may lie in its place, so that the container
      // is full sooner: once more to the depot and back.
      EXPECT_LE(run.world.commands_of[State::kDrive], whole.world.commands_of[State::kDrive] + more_drives) << first;
      ASSERT_FALSE(HasFailure()) << tail(run);
    }
  }
}

TEST(MissionRestart, MissionThatHadEndedStaysEnded) {
  ToyMission run = mission();
  run.start();
  ASSERT_TRUE(run.toEnd());
  MissionMachine again = MissionMachine::fromJson(run.config, {}, run.machine.toJson());
  EXPECT_EQ(again.state(), State::kEnded);
  EXPECT_EQ(again.endReason(), run.machine.endReason());
  EXPECT_EQ(again.endMessage(), run.machine.endMessage());
  EXPECT_TRUE(again.step(event::Start{}, 1.0).commands.empty());
  EXPECT_EQ(again.toJson(), run.machine.toJson());
}

TEST(MissionRestart, MissionThatItsOperatorHadInterruptedWaitsForThem) {
  struct Case {
    const char* what;
    std::vector<Event> events;
    bool has_ended;  // what went on
    State state;
  };
  const std::vector<Case> cases = {
      {"pause wanted", {event::Pause{}}, false, State::kPaused},
      {"paused", {event::Pause{}}, true, State::kPaused},
      {"halting for a hold", {event::Hold{}}, false, State::kHeld},
      {"held", {event::Hold{}}, true, State::kHeld},
      {"halting for a stop", {event::Stop{}}, false, State::kPaused},
      {"resumed from a hold", {event::Hold{}, event::Resume{}}, false, State::kIdle},
      {"a pause taken back", {event::Pause{}, event::Resume{}}, false, State::kIdle},
  };
  for (const Case& one : cases) {
    SCOPED_TRACE(one.what);
    ToyMission run = mission();
    run.start();
    for (int i = 0; i < 12; ++i) ASSERT_TRUE(run.advance());
    for (const Event& event : one.events) run.tell(event);
    if (one.has_ended) {
      ASSERT_TRUE(run.advance());
    }
    const nlohmann::json saved = run.machine.toJson();
    run.world.abandon();
    run.machine = MissionMachine::fromJson(run.config, {}, saved);
    ASSERT_EQ(run.machine.state(), one.state);
    // As a node does that starts by itself.
    run.start();
    EXPECT_EQ(static_cast<bool>(run.world.running), one.state == State::kIdle);
    if (one.state != State::kIdle) {
      EXPECT_EQ(run.machine.state(), one.state);
      EXPECT_EQ(MissionMachine::fromJson(run.config, {}, run.machine.toJson()).state(), one.state) << "once more";
      run.tell(event::Resume{});
      EXPECT_FALSE(run.world.is_held);
    }
    EXPECT_TRUE(run.endsAs(EndReason::kBricksExhausted));
    EXPECT_EQ(run.world.stowed, 3) << tail(run);
  }
}

TEST(MissionRestart, StopEndsAMissionThatWaitsToGoOn) {
  for (const bool is_paused : {false, true}) {
    ToyMission run = mission();
    run.start();
    for (int i = 0; i < 12; ++i) ASSERT_TRUE(run.advance());
    if (is_paused) run.tell(event::Pause{});
    const nlohmann::json saved = run.machine.toJson();
    run.world.abandon();
    run.machine = MissionMachine::fromJson(run.config, {}, saved);
    run.tell(event::Stop{});
    EXPECT_EQ(run.machine.state(), State::kEnded);
    EXPECT_EQ(run.machine.endReason(), EndReason::kStopped);
    EXPECT_FALSE(run.world.running);
  }
}

TEST(MissionRestart, SavedStateIsTheSameAfterARoundTrip) {
  ToyMission run = mission();
  run.inject = [](State action, int count) -> std::optional<Result> {
    if (action == State::kPlanPick && count == 2) return PlanResult{PlanStatus::kGoalUnknown};
    return std::nullopt;
  };
  run.start();
  while (!run.isOver()) {
    if (run.world.action != State::kPick) {
      const MissionMachine again = MissionMachine::fromJson(run.config, {}, run.machine.toJson());
      EXPECT_EQ(again.toJson(), run.machine.toJson());
    }
    ASSERT_TRUE(run.advance());
  }
}

/// As version 4 of the form is on the disks of users: every field differs from that of a new mission.
constexpr char kSavedState[] = R"json({"version": 4, "has_ended": false, "end_reason": 8, "is_ending": true,
    "end_message": "plan_stow: no map; 5 times in a row; the map must arrive first", "waits_in": 1, "is_hold_given": true,
    "is_let_go_open": true, "used_s": 1234.5, "start_pose": [-3.0, 0.25, 0.5], "base": [0.75, -0.5, 3.125],
    "survey_index": 2,
    "brick_in_hand": 7, "pick_running": null, "nameless_picked": 1, "scene": 13, "places_used": 2, "views": 2, "picks_begun": 5,
    "fruitless_views": 1, "low_utility_views": 2, "vantage_drives": 1, "fade_waits": 3,
    "streaks": [0, 0, 0, 0, 0, 0, 0, 1, 2, 0, 0, 0, 3, 4, 5, 0, 0, 0, 1, 0, 2, 0], "last_id": 70,
    "excluded": [[0.75, -0.5, 0.15]],
    "reports": [[-0.7, 0.5, 0.25, 1669.0, "plan_pick: approach blocked (from \u00fcber)"]],
    "failures": {"pick: NOT_ATTACHED": 1, "plan_pick: approach blocked": 2},
    "bricks": [{"id": 3, "is_picked": true, "picks_begun": 1, "picks_failed": 0, "attempts_back": 0,
                "plans_failed": 0, "failures": {}, "last_failure": ""},
               {"id": 7, "is_picked": false, "picks_begun": 4, "picks_failed": 3, "attempts_back": 1,
                "plans_failed": 2, "failures": {"pick: NOT_ATTACHED": 3}, "last_failure": "pick: NOT_ATTACHED"}]
})json";

TEST(MissionRestart, SavedStateOfVersion4IsReadAndKeepsItsForm) {
  nlohmann::json saved = nlohmann::json::parse(kSavedState);
  const MissionMachine machine = MissionMachine::fromJson({}, {}, saved);
  EXPECT_EQ(machine.toJson(), saved);
  EXPECT_EQ(machine.state(), State::kPaused);
  EXPECT_EQ(machine.endReason(), EndReason::kBrickInHand);
  EXPECT_EQ(machine.usedTime(), 1234.5);
  EXPECT_EQ(machine.counts().bricks_picked, 2);
  EXPECT_EQ(machine.bricks().bricks().at(7).picks_failed, 3);

  // Nobody knows how a pick ended that was not answered.
  saved["pick_running"] = 7;
  const nlohmann::json again = MissionMachine::fromJson({}, {}, saved).toJson();
  EXPECT_EQ(again.at("pick_running"), nullptr);
  EXPECT_EQ(again.at("scene"), 14);
  EXPECT_EQ(again.at("failures").at("pick: interrupted by a restart"), 1);
  EXPECT_EQ(again.at("bricks").at(1).at("picks_failed"), 4);
  saved["pick_running"] = 8;
  EXPECT_THROW(MissionMachine::fromJson({}, {}, saved), std::invalid_argument) << "an unknown brick";
}

TEST(MissionRestart, WhatIsNoStateIsRefused) {
  ToyMission run = mission();
  run.start();
  const nlohmann::json good = run.machine.toJson();
  for (const auto& [key, value] : good.items()) {
    nlohmann::json bad = good;
    bad.erase(key);
    EXPECT_THROW(MissionMachine::fromJson(run.config, {}, bad), std::invalid_argument) << key << " is missing";
  }
  nlohmann::json bad = good;
  bad["version"] = 99;
  EXPECT_THROW(MissionMachine::fromJson(run.config, {}, bad), std::invalid_argument);
  // The last of each are those of a value, but for their eight lowest bits alone.
  for (const auto& [key, value] : {std::pair<const char*, int>{"end_reason", 99},
                                   {"end_reason", -1},
                                   {"end_reason", 256 + static_cast<int>(EndReason::kTimeUp)},
                                   {"waits_in", static_cast<int>(State::kLook)},
                                   {"waits_in", 256 + static_cast<int>(State::kPaused)}}) {
    bad = good;
    bad[key] = value;
    EXPECT_THROW(MissionMachine::fromJson(run.config, {}, bad), std::invalid_argument) << key << " = " << value;
  }
  EXPECT_THROW(MissionMachine::fromJson(run.config, {}, nlohmann::json::array()), std::invalid_argument);
  for (const auto& [key, value] : {std::pair<const char*, double>{"used_s", -1e300},
                                   {"survey_index", -1.0},
                                   {"survey_index", 1e12},
                                   {"last_id", -5.0},
                                   {"views", -1.0},
                                   {"picks_begun", 1e10}}) {
    bad = good;
    if (std::string(key) == "used_s") {
      bad[key] = value;
    } else {
      bad[key] = static_cast<std::int64_t>(value);
    }
    EXPECT_THROW(MissionMachine::fromJson(run.config, {}, bad), std::invalid_argument) << key << " = " << value;
  }
}

}  // namespace
}  // namespace toy
