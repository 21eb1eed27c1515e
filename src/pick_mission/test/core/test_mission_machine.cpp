// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/mission_machine.h"

#include <algorithm>
#include <limits>
#include <memory>

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include "support/toy_world.h"

namespace toy {
namespace {

using testing::HasSubstr;

/// A selection after every pick and every failure.
MissionConfig choosing() {
  MissionConfig config = surveying();
  config.views.choose_after_each_pick = true;
  return config;
}

TEST(MissionMachine, PicksAllBricksHighestFirstAndEndsBecauseNoneIsLeft) {
  ToyMission run(surveying(), ToyWorld::ofStacks({3, 1, 2}));
  run.start();
  ASSERT_TRUE(run.toEnd());
  EXPECT_EQ(run.machine.state(), State::kEnded);
  EXPECT_EQ(run.machine.endReason(), EndReason::kNoBrickLeft) << tail(run);
  EXPECT_EQ(run.world.stowed, 6);
  EXPECT_EQ(run.machine.counts().bricks_picked, 6);
  EXPECT_EQ(run.machine.counts().views, 3);
  std::vector<int> order;
  for (const command::Pick& pick : run.sent<command::Pick>()) order.push_back(pick.brick.id);
  EXPECT_EQ(order, (std::vector<int>{2, 1, 0, 5, 4, 3}));
}

TEST(MissionMachine, DrivesToTheDepotWhenTheContainerIsFullAndAtTheEnd) {
  MissionConfig config;
  config.stow = {"a", "b"};
  config.depot = {1.0, 0.5, 0.25};
  ToyMission run(config, ToyWorld::ofStacks({3, 2}));
  EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
  EXPECT_EQ(run.world.stowed, 5);
  EXPECT_EQ(run.world.unloaded, 3) << "after the second, the fourth and the last\n" << tail(run);
  EXPECT_TRUE(run.world.used.empty());
  std::vector<std::string> places;
  for (const command::PlanPick& plan : run.sent<command::PlanPick>()) places.push_back(plan.place);
  EXPECT_EQ(places, (std::vector<std::string>{"a", "b", "a", "b", "a"}));
  // The mission starts at (-3, 0).
  const Pose2d& last = run.sent<command::Drive>().back().T_map_base;
  EXPECT_EQ((std::vector<double>{last.x_m, last.y_m, last.yaw_rad}), (std::vector<double>{-2.0, 0.5, 0.25}));
}

TEST(MissionMachine, WaitsAtTheDepotForAsLongAsItTakes) {
  MissionConfig config;
  config.stow = {"a"};
  ToyMission run(config, ToyWorld::ofStacks({1}));
  run.unloads = false;
  run.start();
  while (run.machine.state() != State::kUnload) ASSERT_TRUE(run.advance()) << tail(run);
  const double used_s = run.machine.usedTime();
  const std::size_t commands = run.commands.size();
  run.now_s += 10.0 * config.time.limit_s;
  run.tell(event::Tick{});
  EXPECT_EQ(run.machine.state(), State::kUnload);
  EXPECT_EQ(run.machine.usedTime(), used_s) << "it is a person's time";
  EXPECT_EQ(run.commands.size(), commands);
  // A node that died here comes back to the depot.
  run.machine = MissionMachine::fromJson(config, {}, run.machine.toJson());
  EXPECT_EQ(run.machine.placesUsed(), 1);
  run.start();
  while (run.machine.state() != State::kUnload) ASSERT_TRUE(run.advance()) << tail(run);
  run.tell(event::Hold{});
  EXPECT_EQ(run.machine.state(), State::kHeld);
  run.tell(event::Unloaded{});
  EXPECT_EQ(run.machine.state(), State::kHeld) << "nothing moves before resume";
  EXPECT_EQ(run.machine.placesUsed(), 0);
  run.world.used.clear();
  run.tell(event::Resume{});
  EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
  EXPECT_EQ(run.world.unloaded, 0) << "the container was empty";
}

TEST(MissionMachine, NobodyUnloadsARobotThatMayMove) {
  ToyMission run({}, ToyWorld::ofStacks({2}));
  run.start();
  while (run.machine.placesUsed() == 0) ASSERT_TRUE(run.advance());
  run.tell(event::Unloaded{});
  EXPECT_EQ(run.machine.placesUsed(), 1);
  EXPECT_THAT(run.log.back().reason, testing::StartsWith("ignored"));
}

TEST(MissionMachine, ADepotThatCannotBeReachedEndsTheMission) {
  ToyMission run({}, ToyWorld::ofStacks({1}));
  run.inject = [&](State action, int) -> std::optional<Result> {
    if (action != State::kDrive || run.machine.placesUsed() == 0) return std::nullopt;
    return NavigationResult{NavigationStatus::kNoPath, std::nullopt};
  };
  EXPECT_TRUE(run.endsAs(EndReason::kDrivesFailed));
  EXPECT_EQ(run.machine.counts().bricks_picked, 1);
}

TEST(MissionMachine, UnloadsAfterAProtectiveStopIfSomethingIsInTheContainer) {
  for (const int pick : {1, 2}) {
    MissionConfig config = surveying();
    config.unlocks_protective_stop = true;
    ToyMission run(config, ToyWorld::ofStacks({2}));
    run.inject = [pick](State action, int count) -> std::optional<Result> {
      if (action != State::kPick || count != pick) return std::nullopt;
      return ArmResult{ArmStatus::kProtectiveStop};
    };
    EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
    EXPECT_EQ(run.world.stowed, 2);
    EXPECT_EQ(run.world.unloaded, pick) << "at the end, and after the second pick's stop\n" << tail(run);
  }
}

TEST(MissionMachine, UnloadsAfterABrickWasLostWhereItMayHaveFallenIntoTheContainer) {
  for (const bool is_over_robot : {false, true}) {
    ToyMission run(surveying(), ToyWorld::ofStacks({2}));
    run.inject = endAs(State::kPick, ArmResult{ArmStatus::kLostOnTheWay, is_over_robot}, 1);
    EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
    EXPECT_EQ(run.world.unloaded, is_over_robot ? 2 : 1) << tail(run);
  }
}

TEST(MissionMachine, APickWithoutAnAnswerMayHaveUsedItsPlace) {
  ToyMission run(surveying(), ToyWorld::ofStacks({2}));
  run.inject = endAs(State::kPick, NoAnswer{}, 1);
  EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
  std::vector<std::string> places;
  for (const command::PlanPick& plan : run.sent<command::PlanPick>()) places.push_back(plan.place);
  EXPECT_EQ(places, (std::vector<std::string>{"container_place_1", "container_place_2", "container_place_3"}));
}

TEST(MissionMachine, APickWithoutAnAnswerWhoseBrickIsInTheHandHasUsedNoPlace) {
  for (const Hand hand : {Hand::kHolding, Hand::kEmpty}) {
    ToyMission run(surveying(), ToyWorld::ofStacks({2}));
    run.start();
    while (run.world.action != State::kPick) ASSERT_TRUE(run.advance());
    event::Reply reply;
    reply.id = run.world.running->id;
    reply.result = NoAnswer{};
    reply.hand = hand;
    run.world.running.reset();
    run.tell(reply);
    EXPECT_EQ(run.machine.placesUsed(), hand == Hand::kHolding ? 0 : 1);
  }
}

TEST(MissionMachine, TheNextMissionKnowsWhatIsInTheContainer) {
  ToyMission run({}, ToyWorld::ofStacks({1}));
  event::Start start;
  start.hand = Hand::kEmpty;
  start.places_used = 2;
  run.tell(start);
  ASSERT_TRUE(run.toEnd());
  EXPECT_EQ(run.sent<command::PlanPick>().at(0).place, "container_place_3");
}

// The first one has ended at the depot, or beside the pile: the workspace is where it was.
TEST(MissionMachine, TheNextMissionHasTheStartOfTheFirst) {
  ToyMission first(surveying(), ToyWorld::ofStacks({1}));
  first.start();
  ASSERT_TRUE(first.toEnd());
  ToyMission next(surveying(), ToyWorld::ofStacks({1}));
  event::Start start;
  start.T_map_base = {3.0, 1.0, M_PI};
  start.hand = Hand::kEmpty;
  start.start_pose = first.machine.startPose();
  next.tell(start);
  ASSERT_TRUE(next.toEnd());
  const auto drives = first.sent<command::Drive>(), next_drives = next.sent<command::Drive>();
  ASSERT_FALSE(drives.empty());
  EXPECT_EQ(next_drives.at(0).T_map_base.position(), drives.at(0).T_map_base.position());
  EXPECT_EQ(next_drives.back().T_map_base.position(), drives.back().T_map_base.position()) << "the depot";
}

TEST(MissionMachine, ChoosesAgainAfterEachPickOnlyIfConfigured) {
  for (const bool each : {true, false}) {
    MissionConfig config = surveying();
    config.views.choose_after_each_pick = each;
    ToyMission run(config, ToyWorld::ofStacks({3, 1}));
    EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
    EXPECT_EQ(run.world.stowed, 4);
    for (const command::SelectView& select : run.sent<command::SelectView>()) EXPECT_EQ(select.may_stay, each);
    // One before each pick, and the last, which finds no pile. Otherwise: one per place, and the last.
    EXPECT_EQ(run.world.commands_of[State::kSelect], each ? 5 : 3) << tail(run);
    EXPECT_EQ(run.machine.counts().views, 2) << "the robot stays where the selection says so";
  }
}

TEST(MissionMachine, LeavesAPlaceWithBricksWhenTheSelectionSaysSo) {
  ToyMission run(choosing(), ToyWorld::ofStacks({2, 1}));
  // After the first pick the other stack is better.
  run.inject = [](State action, int count) -> std::optional<Result> {
    if (action != State::kSelect || count != 2) return std::nullopt;
    return SelectionResult{SelectionStatus::kSuccess, viewPose(2), true, false};
  };
  EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
  std::vector<int> order;
  for (const command::Pick& pick : run.sent<command::Pick>()) order.push_back(pick.brick.id);
  EXPECT_EQ(order, (std::vector<int>{1, 2, 0})) << tail(run);
  EXPECT_EQ(run.machine.counts().views, 3);
}

TEST(MissionMachine, TriesTheOthersInReachAfterAFailedPlanAndThenChoosesAgain) {
  for (const int max_failures : {2, 1}) {
    MissionConfig config = choosing();
    config.attempts.max_plan_failures_per_view = max_failures;
    ToyMission run(config, ToyWorld::ofStacks({2}));
    run.inject = endAs(State::kPlanPick, PlanResult{PlanStatus::kGoalUnknown}, 2);
    run.start();
    for (int failures = 1; failures <= max_failures; ++failures) {
      while (!run.isOver() && run.world.commands_of[State::kPlanPick] < failures) ASSERT_TRUE(run.advance());
      ASSERT_TRUE(run.advance());  // the plan fails
      EXPECT_EQ(run.machine.state(), failures < max_failures ? State::kPlanPick : State::kReport) << tail(run);
    }
    while (run.machine.state() == State::kReport) ASSERT_TRUE(run.advance());
    EXPECT_EQ(run.machine.state(), State::kSelect) << tail(run);
    EXPECT_THAT(run.world.reports, testing::Contains(HasSubstr("plan_pick: ")).Times(max_failures));
    const auto plans = run.sent<command::PlanPick>();
    EXPECT_NE(plans.front().brick.id, max_failures == 2 ? plans.back().brick.id : -1);
  }
}

TEST(MissionMachine, PlanThatFailsBeforeAPickFromTheSamePlaceIsNoFailureOfThePlace) {
  ToyWorld world = ToyWorld::ofStacks({1, 1});
  world.bricks[1].view = world.bricks[0].view;
  ToyMission run(choosing(), world);
  run.inject = endAs(State::kPlanPick, PlanResult{PlanStatus::kApproachBlocked}, 1);
  EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
  EXPECT_EQ(run.world.stowed, 2);
  EXPECT_TRUE(run.world.reports.empty()) << testing::PrintToString(run.world.reports);
}

TEST(MissionMachine, TriesAnotherFaceWhereOneDidNotHold) {
  ToyMission run(choosing(), ToyWorld::ofStacks({1}));
  run.inject = endAs(State::kPick, ArmResult{ArmStatus::kNotAttached}, 1);
  EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
  std::vector<int> faces;
  for (const command::Pick& pick : run.sent<command::Pick>()) faces.push_back(pick.brick.graspable_faces.front());
  EXPECT_EQ(faces, (std::vector<int>{4, 0})) << tail(run);
}

TEST(MissionMachine, PicksFromHereWhenTheSelectionHasNoAnswer) {
  for (const SelectionStatus status : {SelectionStatus::kLowUtility, SelectionStatus::kNoCandidate,
                                       SelectionStatus::kNoPile, SelectionStatus::kNoGround}) {
    ToyMission run(choosing(), ToyWorld::ofStacks({2}));
    run.inject = [status](State action, int count) -> std::optional<Result> {
      if (action != State::kSelect || count != 2) return std::nullopt;
      return SelectionResult{status, std::nullopt, false};
    };
    EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
    EXPECT_EQ(run.world.stowed, 2);
    EXPECT_EQ(run.machine.counts().views, 1) << toString(status) << "\n" << tail(run);
  }
}

TEST(MissionMachine, StayingWithNothingToPickIsAFruitlessView) {
  MissionConfig config = choosing();
  config.views.max_fruitless = 3;
  config.views.exclusion_radius_m = 0.0;
  ToyWorld world = ToyWorld::ofStacks({1});
  world.bricks[0].is_out_of_reach = true;
  ToyMission run(config, world);
  // A selection that knows of no failures stays for ever.
  EXPECT_TRUE(run.endsAs(EndReason::kNoProgress));
  EXPECT_EQ(run.machine.counts().views, 1) << tail(run);
  EXPECT_THAT(run.world.reports, testing::Contains("nothing could be picked from here"));
}

TEST(MissionMachine, WorkspaceIsToldInTheMap) {
  for (const WorkspaceFrame frame : {WorkspaceFrame::kStart, WorkspaceFrame::kMap}) {
    MissionConfig config = surveying();
    config.workspace = {frame, {1.0, 4.0, 4.0}, {0.0, 0.0, 2.0}};
    ToyMission run(config, ToyWorld::ofStacks({1}));
    event::Start start;
    start.T_map_base = {-3.0, 1.0, M_PI / 2.0};
    start.hand = Hand::kEmpty;
    run.tell(start);
    ASSERT_TRUE(run.toEnd());
    const std::vector<Eigen::Vector2d> corners = run.sent<command::SelectView>().at(0).workspace;
    ASSERT_EQ(corners.size(), 3u);
    // A quarter turn to the left: forward is +y, left is -x.
    const Eigen::Vector2d expected =
        frame == WorkspaceFrame::kMap ? Eigen::Vector2d(4.0, 2.0) : Eigen::Vector2d(-5.0, 5.0);
    EXPECT_NEAR((corners[2] - expected).norm(), 0.0, 1e-12) << corners[2].transpose();
  }
}

TEST(MissionMachine, ViewsThatShowNewGroundAreNotFruitless) {
  for (const bool shows_ground : {true, false}) {
    MissionConfig config = surveying();
    config.views.max_fruitless = 3;
    ToyMission run(config, ToyWorld::ofStacks({1}));
    run.inject = [&](State action, int count) -> std::optional<Result> {
      if (action != State::kSelect || count > 6) return std::nullopt;
      return SelectionResult{SelectionStatus::kSuccess, viewPose(1 + count % 2 * 2), true, false,
                             shows_ground ? 7.0 - count : 7.0};
    };
    EXPECT_TRUE(run.endsAs(shows_ground ? EndReason::kNoBrickLeft : EndReason::kNoProgress));
    EXPECT_EQ(run.machine.counts().views, shows_ground ? 7 : 3) << tail(run);
  }
}

TEST(MissionMachine, LooksOnceFromTheStartAndThenSelectsByDefault) {
  ToyMission run({}, ToyWorld::ofStacks({1}));
  EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
  std::vector<State> actions;
  for (const LogEntry& entry : run.log) {
    if (isAction(entry.decision) && entry.decision != entry.state) actions.push_back(entry.decision);
  }
  ASSERT_GE(actions.size(), 6U);
  actions.resize(6);
  EXPECT_THAT(actions, testing::ElementsAre(State::kPlanClear, State::kClear, State::kLook, State::kDetect,
                                            State::kSelect, State::kDrive));
}

TEST(MissionMachine, SurveysFromADistanceBeforeItSelects) {
  MissionConfig config = surveying();
  config.survey.x_m = {0.5, 1.0};
  config.survey.y_m = {0.0, 0.25};
  config.survey.yaw_rad = {0.0, 0.5};
  ToyMission run(config, ToyWorld::ofStacks({1}));
  event::Start start;
  start.T_map_base = {-3.0, 1.0, M_PI / 2.0};
  start.hand = Hand::kEmpty;
  run.tell(start);
  ASSERT_TRUE(run.toEnd());
  std::vector<State> actions;
  std::vector<Pose2d> goals;
  for (const LogEntry& entry : run.log) {
    if (isAction(entry.decision) && entry.decision != entry.state) actions.push_back(entry.decision);
  }
  for (const command::Drive& drive : run.sent<command::Drive>()) goals.push_back(drive.T_map_base);
  const std::vector<State> expected = {State::kPlanClear, State::kClear,  State::kLook,   State::kDetect,
                                       State::kDrive,     State::kLook,   State::kDetect, State::kDrive,
                                       State::kLook,      State::kDetect, State::kSelect, State::kDrive};
  ASSERT_GE(actions.size(), expected.size());
  actions.resize(expected.size());
  EXPECT_EQ(actions, expected);
  ASSERT_GE(goals.size(), 3u);
  // A quarter turn to the left: forward is +y, left is -x.
  EXPECT_NEAR(goals[0].x_m, -3.0, 1e-12);
  EXPECT_NEAR(goals[0].y_m, 1.5, 1e-12);
  EXPECT_NEAR(goals[1].x_m, -3.25, 1e-12);
  EXPECT_NEAR(goals[1].y_m, 2.0, 1e-12);
  EXPECT_NEAR(goals[1].yaw_rad, M_PI / 2.0 + 0.5, 1e-12);
}

// As many as the failures in a row that end a mission.
TEST(MissionMachine, PlacesOfTheSurveyThatCannotBeDrivenToAreLeftOut) {
  MissionConfig config = surveying();
  config.survey.x_m.assign(static_cast<std::size_t>(config.attempts.max_failures_in_a_row), 0.6);
  config.survey.y_m = config.survey.yaw_rad = std::vector<double>(config.survey.x_m.size(), 0.0);
  ToyMission run(config, ToyWorld::ofStacks({1}));
  run.inject = [&run](State action, int) -> std::optional<Result> {
    const bool is_survey = action == State::kDrive && run.world.commands_of[State::kSelect] == 0;
    if (is_survey) return NavigationResult{NavigationStatus::kGoalUnknown, std::nullopt};
    return std::nullopt;
  };
  EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
  EXPECT_EQ(run.machine.summary(0.0).failures.at("drive: goal unknown"), config.attempts.max_failures_in_a_row);
}

TEST(MissionMachine, PlacesOfTheSurveyThatCannotBeGoneBackToAreNoFailuresInARow) {
  MissionConfig config = surveying();
  config.attempts.max_failures_in_a_row = 2;
  ToyMission run(config, ToyWorld::ofStacks({1}));
  run.inject = [&run](State action, int) -> std::optional<Result> {
    if (action == State::kSelect) return SelectionResult{SelectionStatus::kLowUtility, std::nullopt, false};
    const bool is_back = action == State::kDrive && run.world.commands_of[State::kSelect] > 0;
    if (is_back) return NavigationResult{NavigationStatus::kGoalOccupied, std::nullopt};
    return std::nullopt;
  };
  EXPECT_TRUE(run.endsAs(EndReason::kNothingWorthGoing));
  EXPECT_EQ(run.machine.summary(0.0).failures.at("drive: goal occupied"), config.views.max_vantage_drives);
}

TEST(MissionMachine, PlansAndSelectsInTheMapOfTheLastLook) {
  ToyMission run(surveying(), ToyWorld::ofStacks({2, 1}));
  run.start();
  double stamp_s = -1.0;
  int seen = 0;
  while (!run.isOver()) {
    const std::size_t before = run.commands.size();
    if (run.world.action == State::kLook) {
      ASSERT_TRUE(run.advance());
      stamp_s = run.now_s;
    } else {
      ASSERT_TRUE(run.advance());
    }
    for (std::size_t i = before; i < run.commands.size(); ++i) {
      if (const auto* plan = std::get_if<command::PlanPick>(&run.commands[i].body)) {
        EXPECT_EQ(plan->min_map_stamp_s, stamp_s);
        ++seen;
      }
      if (const auto* select = std::get_if<command::SelectView>(&run.commands[i].body)) {
        EXPECT_EQ(select->min_map_stamp_s, stamp_s);
        EXPECT_EQ(select->strategy, "gpis");
        ++seen;
      }
    }
  }
  EXPECT_GE(seen, 5);
}

ToyMission missionWithABrickInTheHand() {
  ToyWorld world = ToyWorld::ofStacks({2});
  world.bricks[1].is_gone = true;
  world.hand = 1;
  return {{}, world};
}

TEST(MissionMachine, StowsABrickThatIsInTheHandAtTheStartFirst) {
  ToyMission run = missionWithABrickInTheHand();
  run.start();
  EXPECT_EQ(run.machine.state(), State::kPlanStow);
  ASSERT_TRUE(run.toEnd());
  EXPECT_EQ(run.world.commands_of[State::kLetGo], 1);
  EXPECT_EQ(run.world.stowed, 2);
  EXPECT_EQ(run.machine.counts().bricks_picked, 2);  // of the one nobody knew the id
  EXPECT_EQ(run.machine.endReason(), EndReason::kNoBrickLeft) << tail(run);
}

TEST(MissionMachine, BrickThatStillHangsThereAfterItWasLetGoCountsOnceWhenItHasGone) {
  ToyMission run = missionWithABrickInTheHand();
  run.start();
  while (run.world.running && run.world.action != State::kLetGo) ASSERT_TRUE(run.advance());
  event::Reply reply;
  reply.id = run.world.running->id;
  reply.result = ArmResult{ArmStatus::kSuccess};
  reply.hand = Hand::kHolding;
  run.world.running.reset();
  run.tell(reply);
  EXPECT_EQ(run.machine.counts().bricks_picked, 0);
  EXPECT_EQ(run.machine.state(), State::kPlanStow) << tail(run);
  ASSERT_TRUE(run.toEnd());
  EXPECT_EQ(run.world.commands_of[State::kLetGo], 2);
  EXPECT_EQ(run.machine.counts().bricks_picked, 2);
  EXPECT_EQ(run.machine.endReason(), EndReason::kNoBrickLeft) << tail(run);
}

TEST(MissionMachine, DoesNotMoveWhileItIsNotKnownWhetherTheHandIsEmpty) {
  ToyMission run(surveying(), ToyWorld::ofStacks({1}));
  event::Start start;
  run.tell(start);
  EXPECT_EQ(run.machine.state(), State::kWait);
  for (int i = 0; i < 20 && !run.isOver(); ++i) {
    ASSERT_TRUE(run.world.running);
    EXPECT_TRUE(std::holds_alternative<command::Wait>(run.world.running->body));
    event::Reply reply = run.world.finish(run.now_s);
    reply.hand.reset();
    run.tell(reply);
  }
  EXPECT_EQ(run.machine.endReason(), EndReason::kBrickInHand);
}

TEST(MissionMachine, BrickLostWhileStowedIsLookedForAndPickedAgain) {
  ToyMission run = missionWithABrickInTheHand();
  run.inject = endAs(State::kStow, ArmResult{ArmStatus::kLostOnTheWay}, 1);
  run.start();
  ASSERT_TRUE(run.toEnd());
  EXPECT_EQ(run.world.stowed, 2);
  EXPECT_EQ(run.machine.counts().bricks_picked, 2);
  EXPECT_EQ(run.world.commands_of[State::kStow], 1);
  EXPECT_EQ(run.machine.endReason(), EndReason::kNoBrickLeft) << tail(run);
}

TEST(MissionMachine, BrickThatCannotBeHeldIsLeftAfterItsAttempts) {
  ToyWorld world = ToyWorld::ofStacks({1, 1});
  world.bricks[0].has_no_plate = true;
  MissionConfig config = surveying();
  config.attempts.max_picks_per_brick = 2;
  config.bricks_total = 2;
  ToyMission run(config, world);
  EXPECT_TRUE(run.endsAs(EndReason::kBricksExhausted));
  EXPECT_EQ(run.world.picks[0], 2);
  EXPECT_EQ(run.machine.bricks().bricks().at(0).last_failure, "pick: NOT_ATTACHED");
  EXPECT_EQ(run.machine.counts().bricks_picked, 1);
  EXPECT_GE(run.world.reports.size(), 2u);
}

TEST(MissionMachine, FailureIsReportedBeforeTheNextSelectionAndThePlaceExcluded) {
  ToyWorld world = ToyWorld::ofStacks({1, 1});
  world.bricks[0].is_out_of_reach = true;
  ToyMission run(surveying(), world);
  run.start();
  ASSERT_TRUE(run.toEnd());
  EXPECT_THAT(run.world.reports, testing::Contains("nothing could be picked from here"));
  bool was_excluded = false;
  for (const command::SelectView& select : run.sent<command::SelectView>()) {
    if (select.excluded.empty()) continue;
    was_excluded = true;
    EXPECT_NEAR((select.excluded.front().center - viewPose(0).position()).norm(), 0.0, 1e-12);
  }
  EXPECT_TRUE(was_excluded);
  EXPECT_EQ(run.world.stowed, 1);
}

TEST(MissionMachine, ProtectiveStopIsUnlockedByPolicyAlone) {
  for (const bool may_unlock : {false, true}) {
    MissionConfig config = surveying();
    config.unlocks_protective_stop = may_unlock;
    ToyMission run(config, ToyWorld::ofStacks({1}));
    run.inject = endAs(State::kPick, ArmResult{ArmStatus::kProtectiveStop}, 1);
    EXPECT_TRUE(run.endsAs(may_unlock ? EndReason::kNoBrickLeft : EndReason::kNeedsPerson));
    EXPECT_EQ(run.world.commands_of[State::kRecover], may_unlock ? 1 : 0);
    if (!may_unlock) {
      EXPECT_THAT(run.machine.endMessage(), HasSubstr("PROTECTIVE_STOP"));
    }
  }
}

TEST(MissionMachine, EndsWhenTimeIsUpWithTheHandEmpty) {
  // The limit falls into everything once: into picks, drives, looks.
  for (double limit_s = 5.0; limit_s < 150.0; limit_s += 3.0) {
    MissionConfig config = surveying();
    config.time.limit_s = limit_s;
    ToyMission run(config, ToyWorld::ofStacks({3, 3}));
    EXPECT_TRUE(run.endsAs(EndReason::kTimeUp));
    EXPECT_FALSE(run.world.hand);
    // The longest that is let end is a pick.
    EXPECT_LE(run.machine.usedTime(), limit_s + 21.0);
    EXPECT_GE(run.machine.usedTime(), limit_s);
  }
}

TEST(MissionMachine, StowsWhatItHoldsWhenTheMissionIsOver) {
  MissionConfig config = surveying();
  config.attempts.max_failures_in_a_row = 1;
  ToyMission run(config, ToyWorld::ofStacks({2}));
  run.world.holds_when_pick_fails = true;
  run.inject = endAs(State::kPick, ArmResult{ArmStatus::kTrajectoryAborted}, 1);
  EXPECT_TRUE(run.endsAs(EndReason::kPicksFailed));
  EXPECT_FALSE(run.world.hand);
  EXPECT_EQ(run.world.stowed, 1);
}

TEST(MissionMachine, ActionThatNeverEndsIsCancelledAndCountsAsNoAnswer) {
  MissionConfig config = surveying();
  ToyMission run(config, ToyWorld::ofStacks({1}));
  run.start();
  while (run.world.action != State::kDrive) ASSERT_TRUE(run.advance());
  run.now_s += config.time.action_timeout_s + 1.0;
  run.tell(event::Tick{});
  EXPECT_TRUE(run.world.is_cancelled);
  EXPECT_EQ(run.machine.state(), State::kHalting);
  const std::uint64_t id = run.world.running->id;
  run.world.running.reset();  // its server does not even end it
  run.now_s += config.time.cancel_timeout_s + 1.0;
  run.tell(event::Tick{});
  EXPECT_EQ(run.machine.state(), State::kWait);
  event::Reply late;
  late.id = id;
  late.result = NavigationResult{};
  run.tell(late);
  EXPECT_EQ(run.machine.state(), State::kWait) << "a late reply changed something";
  EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
}

TEST(MissionMachine, PickWithoutAnAnswerWaitsUntilTheHandIsKnown) {
  ToyMission run(surveying(), ToyWorld::ofStacks({2}));
  run.world.holds_when_pick_fails = true;
  run.inject = endAs(State::kPick, NoAnswer{}, 1);
  run.start();
  while (run.world.action != State::kPick) ASSERT_TRUE(run.advance());
  ASSERT_TRUE(run.advance());
  EXPECT_EQ(run.machine.hand(), Hand::kUnknown);
  EXPECT_EQ(run.machine.state(), State::kWait);
  ASSERT_TRUE(run.toEnd());
  EXPECT_EQ(run.machine.counts().bricks_picked, 2);
  EXPECT_EQ(run.world.commands_of[State::kStow], 1);
}

TEST(MissionMachine, ArmThatIsBusyWithSomethingElseIsWaitedFor) {
  for (const State busy : {State::kClear, State::kPick, State::kStow, State::kRecover}) {
    SCOPED_TRACE(toString(busy));
    MissionConfig config = surveying();
    ToyMission run(config, ToyWorld::ofStacks({2}));
    run.inject = [busy](State action, int count) -> std::optional<Result> {
      if (action == busy && count == 1) return ArmResult{ArmStatus::kBusy};
      if (busy == State::kStow && action == State::kPick && count == 1) return ArmResult{ArmStatus::kStalled};
      if (busy == State::kRecover && action == State::kClear && count == 1) return ArmResult{ArmStatus::kNotReady};
      return std::nullopt;
    };
    run.world.holds_when_pick_fails = busy == State::kStow;
    run.start();
    while (run.world.action != busy) ASSERT_TRUE(run.advance()) << tail(run);
    ASSERT_TRUE(run.advance());
    ASSERT_EQ(run.machine.state(), State::kWait) << tail(run);
    const auto& wait = std::get<command::Wait>(run.world.running->body);
    EXPECT_EQ(wait.until, WaitUntil::kArmIdle);
    EXPECT_EQ(wait.limit_s, config.time.ready_timeout_s);
    EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
    EXPECT_EQ(run.machine.counts().bricks_picked, 2);
  }
}

TEST(MissionMachine, LowUtilityLeadsToWhatIsUnseenThenWaitsThenLooksOnceMoreThenEnds) {
  MissionConfig config = surveying();
  ToyMission run(config, ToyWorld::ofStacks({1, 1}));
  run.inject = [](State action, int count) -> std::optional<Result> {
    if (action == State::kSelect) return SelectionResult{SelectionStatus::kLowUtility, viewPose(5), count <= 2};
    return std::nullopt;
  };
  EXPECT_TRUE(run.endsAs(EndReason::kNothingWorthGoing));
  EXPECT_THAT(run.machine.endMessage(), HasSubstr("low utility"));
  EXPECT_EQ(run.machine.counts().views, 2);
  EXPECT_EQ(run.world.commands_of[State::kDrive],
            static_cast<int>(config.survey.x_m.size()) + 2 + config.views.max_vantage_drives);
  int fades = 0;
  for (const command::Wait& wait : run.sent<command::Wait>()) fades += wait.limit_s == config.views.fade_wait_s;
  EXPECT_EQ(fades, config.views.max_fade_waits);
}

// As when a brick falls from the magnet: the place it was in is empty, and nothing is worth going to.
TEST(MissionMachine, BrickThatIsNotThereAnyMoreIsLookedForFromThePlacesOfTheSurvey) {
  for (const SelectionStatus status : {SelectionStatus::kLowUtility, SelectionStatus::kNoPile}) {
    SCOPED_TRACE(static_cast<int>(status));
    MissionConfig config = surveying();
    ToyMission run(config, ToyWorld::ofStacks({1}));
    run.inject = [&](State action, int count) -> std::optional<Result> {
      if (action == State::kPick && count == 1) {
        run.world.unseen = {0};
        return ArmResult{ArmStatus::kNotAttached};
      }
      if (action == State::kDrive && !run.world.unseen.empty()) run.world.unseen.clear();
      if (action == State::kSelect && !run.world.unseen.empty()) return SelectionResult{status, std::nullopt, false};
      return std::nullopt;
    };
    EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
    EXPECT_EQ(run.machine.counts().bricks_picked, 1);
  }
}

// As when a brick rolls to where nobody sees it: an empty place is no claim that none is left.
TEST(MissionMachine, BrickThatIsKnownAndNotSeenAnyMoreIsToldAtTheEnd) {
  for (const int total : {-1, 2}) {
    SCOPED_TRACE(total);
    MissionConfig config = surveying();
    config.bricks_total = total;
    ToyMission run(config, ToyWorld::ofStacks({1, 1}));
    run.inject = [&run](State action, int) -> std::optional<Result> {
      if (action == State::kPick) run.world.unseen = {1};
      const bool is_gone = action == State::kSelect && !run.world.unseen.empty();
      if (is_gone) return SelectionResult{SelectionStatus::kNoPile, std::nullopt, false};
      return std::nullopt;
    };
    EXPECT_TRUE(run.endsAs(EndReason::kNothingWorthGoing));
    EXPECT_THAT(run.machine.endMessage(), HasSubstr("brick 1 is not seen any more"));
    EXPECT_EQ(run.machine.counts().bricks_picked, 1);
  }
}

TEST(MissionMachine, BrickThatWasNeverFoundIsToldAtTheEnd) {
  MissionConfig config = surveying();
  config.bricks_total = 3;
  ToyMission run(config, ToyWorld::ofStacks({1, 1}));
  EXPECT_TRUE(run.endsAs(EndReason::kNothingWorthGoing));
  EXPECT_THAT(run.machine.endMessage(), HasSubstr("1 of 3 bricks never found"));
}

/// A pick that does not let go, up to its being let go again, which nobody answers though the brick has fallen.
ToyMission missionWithAnUnansweredLetGo() {
  ToyMission run(surveying(), ToyWorld::ofStacks({2}));
  run.inject = endAs(State::kPick, ArmResult{ArmStatus::kNotLetGo}, 1);
  run.start();
  while (run.world.action != State::kLetGo && run.advance()) {
  }
  run.world.hand.reset();
  ++run.world.stowed;
  return run;
}

TEST(MissionMachine, BrickThatWasLetGoWithoutAnAnswerCountsWhenTheHandIsEmpty) {
  ToyMission run = missionWithAnUnansweredLetGo();
  ASSERT_EQ(run.machine.state(), State::kLetGo) << tail(run);
  event::Reply reply;
  reply.id = run.world.running->id;
  reply.result = NoAnswer{};
  run.world.running.reset();
  run.tell(reply);
  EXPECT_EQ(run.machine.hand(), Hand::kUnknown);
  EXPECT_EQ(run.machine.counts().bricks_picked, 0) << "it may still hang there";
  // Of a bridge that has just come back and not heard of its magnet yet.
  run.tell(event::HandReport{Hand::kEmpty, std::nullopt});
  EXPECT_EQ(run.machine.counts().bricks_picked, 0);
  ASSERT_TRUE(run.toEnd());
  EXPECT_EQ(run.machine.counts().bricks_picked, 2) << tail(run);
  EXPECT_EQ(run.machine.bricks().numPicked(), 2) << "by their ids";
  EXPECT_EQ(run.machine.endReason(), EndReason::kNoBrickLeft) << tail(run);
}

TEST(MissionMachine, BrickThatWasLetGoWhenTheProcessDiedCountsWhenTheHandIsEmpty) {
  ToyMission run = missionWithAnUnansweredLetGo();
  ASSERT_EQ(run.machine.state(), State::kLetGo) << tail(run);
  run.world.running.reset();
  run.machine = MissionMachine::fromJson(run.config, {}, run.machine.toJson());
  run.start();
  ASSERT_TRUE(run.toEnd());
  EXPECT_EQ(run.machine.bricks().numPicked(), 2) << tail(run);
  EXPECT_EQ(run.machine.endReason(), EndReason::kNoBrickLeft) << tail(run);
}

TEST(MissionMachine, PicksThatAreEndedByLettingGoAgainAreNoFailuresInARow) {
  ToyMission run(surveying(), ToyWorld::ofStacks({3, 3}));
  run.inject = endAs(State::kPick, ArmResult{ArmStatus::kNotLetGo});
  EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
  EXPECT_EQ(run.machine.counts().bricks_picked, 6);
}

TEST(MissionMachine, FruitlessViewsEndTheMission) {
  MissionConfig config = surveying();
  config.views.max_fruitless = 3;
  ToyMission run(config, ToyWorld::ofStacks({1}));
  run.inject = [](State action, int count) -> std::optional<Result> {
    if (action == State::kSelect) return SelectionResult{SelectionStatus::kSuccess, viewPose(1 + count % 5), true};
    return std::nullopt;
  };
  EXPECT_TRUE(run.endsAs(EndReason::kNoProgress));
  EXPECT_EQ(run.machine.counts().views, 3);
}

/// Most commands of a kind between two selections.
template <typename Kind>
int mostInAView(const ToyMission& run) {
  int most = 0;
  int count = 0;
  for (const Command& command : run.commands) {
    if (std::holds_alternative<command::SelectView>(command.body)) count = 0;
    if (std::holds_alternative<Kind>(command.body)) most = std::max(most, ++count);
  }
  return most;
}

TEST(MissionMachine, ViewWhereTooMuchFailsIsLeft) {
  for (const bool of_picks : {false, true}) {
    ToyWorld world({});
    for (int id = 0; id < 6; ++id) {
      ToyBrick brick{id, 0, 0};
      brick.has_no_plate = of_picks;
      brick.is_out_of_reach = !of_picks;
      world.bricks.push_back(brick);
    }
    MissionConfig config = surveying();
    config.attempts.max_pick_failures_per_view = 2;
    config.attempts.max_plan_failures_per_view = 4;
    ToyMission run(config, std::move(world));
    run.start();
    ASSERT_TRUE(run.toEnd());
    if (of_picks) {
      EXPECT_EQ(mostInAView<command::Pick>(run), 2) << tail(run);
    } else {
      EXPECT_EQ(mostInAView<command::PlanPick>(run), 4) << tail(run);
    }
  }
}

TEST(MissionMachine, WhatFailedIsReportedBesideTheBrickTowardsTheRobot) {
  ToyMission run(surveying(), ToyWorld::ofStacks({1, 1}));
  bool has_failed = false;
  Pose2d stood;
  Eigen::Vector3d brick = Eigen::Vector3d::Zero();
  run.inject = [&](State action, int) -> std::optional<Result> {
    if (action != State::kPlanPick || has_failed) return std::nullopt;
    has_failed = true;
    for (const Command& command : run.commands) {
      if (const auto* drive = std::get_if<command::Drive>(&command.body)) stood = drive->T_map_base;
      if (const auto* plan = std::get_if<command::PlanPick>(&command.body)) {
        brick = plan->brick.T_map_brick.translation();
      }
    }
    return PlanResult{PlanStatus::kApproachBlocked};
  };
  run.start();
  ASSERT_TRUE(run.toEnd());
  const std::vector<command::ReportFailure> reports = run.sent<command::ReportFailure>();
  ASSERT_FALSE(reports.empty()) << tail(run);
  const Eigen::Vector2d aside = (reports.front().position - brick).head<2>();
  const Eigen::Vector2d to_robot = stood.position() - brick.head<2>();
  EXPECT_NEAR(aside.norm(), 0.3, 1e-9);
  EXPECT_GT(aside.dot(to_robot), (1.0 - 1e-9) * 0.3 * to_robot.norm());
  EXPECT_EQ(reports.front().position.z(), brick.z());
}

TEST(MissionMachine, PlaceThatCannotBeDrivenToIsExcludedFromTheNextSelection) {
  ToyMission run(surveying(), ToyWorld::ofStacks({1, 1}));
  run.inject = [&run](State action, int) -> std::optional<Result> {
    const bool is_to_view = action == State::kDrive && run.world.commands_of[State::kSelect] == 1;
    if (is_to_view) return NavigationResult{NavigationStatus::kGoalOccupied, std::nullopt};
    return std::nullopt;
  };
  run.start();
  ASSERT_TRUE(run.toEnd());
  EXPECT_THAT(run.world.reports, testing::Contains(HasSubstr("drive: ")));
  const std::vector<command::SelectView> selections = run.sent<command::SelectView>();
  ASSERT_GE(selections.size(), 2u);
  ASSERT_EQ(selections[1].excluded.size(), 1u);
  EXPECT_NEAR((selections[1].excluded[0].center - viewPose(0).position()).norm(), 0.0, 1e-12);
  EXPECT_EQ(run.machine.endReason(), EndReason::kNoBrickLeft) << tail(run);
}

TEST(MissionMachine, LeavesBricksThatNobodyReachesForThoseTriedLessOften) {
  const auto isKeptAway = [](const Command& command) {
    const auto* select = std::get_if<command::SelectView>(&command.body);
    return select != nullptr && std::any_of(select->excluded.begin(), select->excluded.end(),
                                            [](const command::Zone& zone) { return zone.radius_m > 0.5; });
  };
  // The brick of view 0 is worth most, whatever is told about it, unless its surroundings are.
  const auto missionWith = [](const std::vector<ToyBrick>& bricks, double leave_radius_m) {
    MissionConfig config = surveying();
    config.attempts.max_plans_per_brick = 100;
    config.views.leave_radius_m = leave_radius_m;
    auto run = std::make_unique<ToyMission>(config, ToyWorld(bricks));
    run->inject = [world = &run->world](State action, int) -> std::optional<Result> {
      if (action != State::kSelect) return std::nullopt;
      const auto& select = std::get<command::SelectView>(world->running->body);
      const bool is_passed_over =
          std::any_of(select.excluded.begin(), select.excluded.end(), [](const command::Zone& zone) {
            return zone.radius_m > 0.5 && (viewPose(0).position() - zone.center).norm() < zone.radius_m;
          });
      if (is_passed_over) return std::nullopt;
      return SelectionResult{SelectionStatus::kSuccess, viewPose(0), true};
    };
    run->start();
    EXPECT_TRUE(run->toEnd());
    return run;
  };
  const ToyBrick vain{0, 0, 0, false, true};
  const auto run = missionWith({vain, {1, 4, 0}}, 0.8);
  EXPECT_EQ(run->world.stowed, 1) << tail(*run);
  EXPECT_TRUE(std::any_of(run->commands.begin(), run->commands.end(), isKeptAway));

  // Nothing else to go to.
  const auto alone = missionWith({vain}, 0.8);
  EXPECT_TRUE(std::none_of(alone->commands.begin(), alone->commands.end(), isKeptAway));

  // So far about it that nothing is left: once, and then as before.
  const auto far = missionWith({vain, {1, 4, 0}}, 10.0);
  EXPECT_EQ(std::count_if(far->commands.begin(), far->commands.end(), isKeptAway), 1);
  EXPECT_EQ(far->machine.endReason(), EndReason::kNoProgress) << tail(*far);
}

TEST(MissionMachine, FruitlessViewsCountInARowAlone) {
  MissionConfig config = surveying();
  config.views.max_fruitless = 2;
  ToyMission run(config, ToyWorld::ofStacks({1, 1, 1}));
  run.inject = [](State action, int count) -> std::optional<Result> {
    if (action == State::kSelect && count % 2 == 1 && count < 6) {
      return SelectionResult{SelectionStatus::kSuccess, viewPose(5), true};
    }
    return std::nullopt;
  };
  EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
  EXPECT_EQ(run.machine.counts().views, 6);
}

TEST(MissionMachine, ViewThatShowsANewBrickIsNotFruitless) {
  MissionConfig config = surveying();
  config.views.max_fruitless = 2;
  ToyMission run(config, ToyWorld::ofStacks({1}));
  run.inject = [](State action, int count) -> std::optional<Result> {
    if (action == State::kSelect) return SelectionResult{SelectionStatus::kSuccess, viewPose(count % 8), true};
    if (action != State::kDetect) return std::nullopt;
    DetectionResult result;
    for (int id = 0; id < std::min(count, 9); ++id) {
      SeenBrick brick;
      brick.id = id;
      brick.is_in_sector = false;
      result.bricks.push_back(brick);
    }
    return result;
  };
  run.start();
  while (run.world.running) run.advancePastTheWorld();
  EXPECT_EQ(run.machine.endReason(), EndReason::kNoProgress) << tail(run);
  // The looks at the start and at two places of the survey, six views with a new brick each, one more fruitless view.
  EXPECT_EQ(run.machine.counts().views, 7) << tail(run);
}

TEST(MissionMachine, ClockThatIsSetBackTakesNothingBack) {
  MissionConfig config = surveying();
  ToyMission run(config, ToyWorld::ofStacks({1}));
  run.start();
  while (run.world.action != State::kDrive) ASSERT_TRUE(run.advance());
  run.now_s += config.time.action_timeout_s - 100.0;
  run.tell(event::Tick{});
  const double used_s = run.machine.usedTime();
  run.now_s -= 5000.0;
  run.tell(event::Tick{});
  EXPECT_EQ(run.machine.usedTime(), used_s);
  run.now_s += 99.0;
  run.tell(event::Tick{});
  EXPECT_EQ(run.machine.state(), State::kDrive);
  EXPECT_NEAR(run.machine.usedTime(), used_s + 99.0, 1e-9);
  run.now_s += 2.0;
  run.tell(event::Tick{});
  EXPECT_EQ(run.machine.state(), State::kHalting);
}

TEST(MissionMachine, RecoveriesAreCountedUntilTheArmMoves) {
  MissionConfig config = surveying();
  config.attempts.max_failures_in_a_row = 100;
  ToyMission run(config, ToyWorld::ofStacks({1}));
  run.inject = endAs(State::kClear, ArmResult{ArmStatus::kNotReady});
  EXPECT_TRUE(run.endsAs(EndReason::kRecoveryFailed));
  EXPECT_EQ(run.world.commands_of[State::kRecover], config.attempts.max_recoveries_in_a_row);
}

// Nothing that needs the robot's place is answered until somebody tells it again.
TEST(MissionMachine, APlaceThatIsNotKnownIsWaitedForAndNotForEver) {
  MissionConfig config = surveying();
  for (const State first : {State::kPlanClear, State::kPlanPick, State::kDrive, State::kSelect}) {
    const double longest_s = config.attempts.max_failures_in_a_row * config.time.ready_timeout_s;
    for (const double outage_s :
         {50.0, longest_s - config.time.ready_timeout_s, longest_s + config.time.ready_timeout_s}) {
      SCOPED_TRACE(std::string(toString(first)) + ", " + std::to_string(outage_s) + " s");
      ToyMission run(config, ToyWorld::ofStacks({1, 1}));
      std::optional<double> back_s;
      run.inject = [&](State action, int) -> std::optional<Result> {
        if (action == first && !back_s) back_s = run.now_s + outage_s;
        if (!back_s || run.now_s >= *back_s) return std::nullopt;
        if (action == State::kPlanClear || action == State::kPlanPick) return PlanResult{PlanStatus::kNoRobotState};
        if (action == State::kDrive) return NavigationResult{NavigationStatus::kStalePose, {}};
        if (action == State::kSelect) return SelectionResult{SelectionStatus::kNoPose, {}};
        if (action != State::kWait) return std::nullopt;
        const command::Wait& wait = std::get<command::Wait>(run.world.running->body);
        EXPECT_EQ(wait.until, WaitUntil::kPlaceKnown);
        EXPECT_EQ(wait.at_least_s, config.time.retry_wait_s);
        // The toy has let pass the least already.
        run.now_s = std::max(run.now_s, std::min(*back_s, run.now_s - wait.at_least_s + wait.limit_s));
        return WaitResult{};
      };
      run.start();
      ASSERT_TRUE(run.toEnd());
      EXPECT_EQ(run.machine.endReason() == EndReason::kNoBrickLeft, outage_s < longest_s) << tail(run);
    }
  }
}

TEST(MissionMachine, RecoveriesAreFarEnoughApartForADriverToComeBack) {
  const MissionConfig config = surveying();
  for (const ArmStatus status : {ArmStatus::kProgramStopped, ArmStatus::kNotReady, ArmStatus::kDriverGone}) {
    SCOPED_TRACE(toString(status));
    ToyMission run(config, ToyWorld::ofStacks({1}));
    double back_s = 0.0;
    run.inject = [&](State action, int) -> std::optional<Result> {
      if (back_s == 0.0 && action == State::kPick) back_s = run.now_s + config.time.recover_wait_s + 5.0;
      if (run.now_s >= back_s) return std::nullopt;
      if (action == State::kPick || action == State::kRecover) return ArmResult{status};
      if (action != State::kWait) return std::nullopt;
      const command::Wait& wait = std::get<command::Wait>(run.world.running->body);
      EXPECT_EQ(wait.until, WaitUntil::kArmReady);
      run.now_s += wait.limit_s;
      return WaitResult{WaitStatus::kNotReady};
    };
    EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
    EXPECT_EQ(run.world.commands_of[State::kRecover], 3);
  }
}

TEST(MissionMachine, HandThatIsSuddenlyFullIsStowedBeforeAnythingElse) {
  ToyMission run(surveying(), ToyWorld::ofStacks({1, 1}));
  run.start();
  while (run.world.action != State::kSelect) ASSERT_TRUE(run.advance());
  run.world.hand = 1;
  run.world.bricks[1].is_gone = true;
  run.tell(event::HandReport{Hand::kHolding, 1});
  ASSERT_TRUE(run.advance());
  EXPECT_EQ(run.machine.state(), State::kPlanStow) << tail(run);
  ASSERT_TRUE(run.toEnd());
  EXPECT_EQ(run.machine.counts().bricks_picked, 2);
}

TEST(MissionMachine, RepliesThatCannotBeAreRefusedAndChangeNothing) {
  ToyMission run(surveying(), ToyWorld::ofStacks({1}));
  run.start();
  event::Reply reply;
  reply.id = run.world.running->id;
  reply.result = NavigationResult{};
  EXPECT_THROW(run.machine.step(reply, 101.0), std::invalid_argument);
  EXPECT_THROW(run.machine.step(event::Tick{}, std::numeric_limits<double>::quiet_NaN()), std::invalid_argument);
  EXPECT_EQ(run.machine.state(), State::kPlanClear);
  ASSERT_TRUE(run.toEnd());
  EXPECT_EQ(run.machine.endReason(), EndReason::kNoBrickLeft);
}

TEST(MissionMachine, LogLinesParseAndFollowEachOther) {
  ToyMission run(surveying(), ToyWorld::ofStacks({2, 1}));
  run.inject = endAs(State::kPick, ArmResult{ArmStatus::kNoContact}, 1);
  run.start();
  ASSERT_TRUE(run.toEnd());
  double time_s = 0.0;
  std::string state = "idle";
  double since_s = run.log.front().time_s;
  for (const LogEntry& entry : run.log) {
    const std::string text = toJsonLine(entry);
    EXPECT_EQ(text.find('\n'), std::string::npos);
    const nlohmann::json line = nlohmann::json::parse(text);
    EXPECT_GE(line.at("time_s").get<double>(), time_s);
    time_s = line.at("time_s");
    EXPECT_EQ(line.at("state"), state);
    EXPECT_FALSE(entry.reason.empty()) << text;
    if (entry.decision == State::kPlanPick) {
      EXPECT_THAT(entry.reason, HasSubstr("brick ")) << text;
    }
    EXPECT_NEAR(line.at("state_s").get<double>(), time_s - since_s, 1e-9);
    if (line.at("decision") != state) since_s = time_s;
    state = line.at("decision");
    for (const char* key : {"event", "reason", "bricks_picked", "views", "picks_begun", "failures"}) {
      EXPECT_TRUE(line.contains(key)) << key;
    }
  }
  EXPECT_EQ(state, "ended");
  EXPECT_EQ(nlohmann::json::parse(toJsonLine(run.log.back())).at("bricks_picked"), 3);
}

TEST(MissionMachine, LogLineOfAMessageThatIsNoUtf8Parses) {
  LogEntry entry;
  entry.reason = "broken \xff and \"quoted\"\n";
  EXPECT_NO_THROW(nlohmann::json::parse(toJsonLine(entry)));
}

TEST(MissionMachine, SummaryTellsWhatTheMissionKnows) {
  MissionConfig config = surveying();
  config.bricks_total = 3;
  ToyMission run(config, ToyWorld::ofStacks({2, 1}));
  run.inject = endAs(State::kPick, ArmResult{ArmStatus::kNoContact}, 1);
  run.start();
  ASSERT_TRUE(run.toEnd());
  const nlohmann::json json = toJson(run.machine.summary(7.5));
  EXPECT_EQ(json.at("scene"), "toy");
  EXPECT_EQ(json.at("seed"), 1);
  EXPECT_EQ(json.at("strategy"), "gpis");
  EXPECT_EQ(json.at("removed_factor"), "");
  EXPECT_EQ(json.at("bricks_total"), 3);
  EXPECT_EQ(json.at("bricks_picked"), 3);
  EXPECT_EQ(json.at("views"), 2);
  EXPECT_EQ(json.at("end_reason"), "no_brick_left");
  EXPECT_EQ(json.at("failures"), (nlohmann::json{{"pick: NO_CONTACT", 1}}));
  EXPECT_NEAR(json.at("sim_seconds").get<double>(), run.now_s - 100.0, 1e-9);
  EXPECT_EQ(json.at("wall_seconds"), 7.5);
  EXPECT_TRUE(toJson(MissionSummary{}).at("bricks_total").is_null());
}

TEST(MissionMachine, BadConfigurationIsRefusedWithEveryProblem) {
  MissionConfig config = surveying();
  config.look.images = 0;
  config.time.limit_s = -1.0;
  try {
    const MissionMachine machine(config, {});
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), HasSubstr("look/images = 0, must be in [1, 1000]"));
    EXPECT_THAT(error.what(), HasSubstr("time/limit_s = -1 s"));
  }
}

MissionConfig lookingAhead() {
  MissionConfig config = surveying();
  config.look.while_carrying = true;
  return config;
}

/// To the first look while a brick is carried away.
bool toLookAhead(ToyMission& run) {
  run.start();
  while (!run.world.carrying) {
    if (!run.advance()) return false;
  }
  return run.machine.state() == State::kLook;
}

TEST(LookingAhead, PlansTheNextPickWhileABrickIsCarriedAway) {
  double used_s[2];
  for (const bool is_ahead : {false, true}) {
    MissionConfig config = lookingAhead();
    config.look.while_carrying = is_ahead;
    config.stow = {"a", "b", "c", "d"};
    ToyMission run(config, ToyWorld::ofStacks({3}));
    EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
    EXPECT_EQ(run.world.stowed, 3);
    std::vector<bool> ahead;
    for (const command::PlanPick& plan : run.sent<command::PlanPick>()) ahead.push_back(plan.is_after_pick);
    EXPECT_EQ(ahead, (std::vector<bool>{false, is_ahead, is_ahead})) << tail(run);
    used_s[is_ahead ? 1 : 0] = run.machine.usedTime();
  }
  // Of two bricks: a look, a detection, a plan. Of the last one: look, detection and a selection that finds nothing, in vain.
  EXPECT_DOUBLE_EQ(used_s[0] - used_s[1], 2 * 3.0);
}

TEST(LookingAhead, IsNotDoneWithTheBrickThatFillsTheContainerNorWithTheLastOne) {
  MissionConfig full = lookingAhead();
  full.stow = {"a", "b"};
  ToyMission run(full, ToyWorld::ofStacks({3}));
  ASSERT_TRUE(toLookAhead(run)) << tail(run);
  EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
  std::vector<bool> ahead;
  for (const command::PlanPick& plan : run.sent<command::PlanPick>()) ahead.push_back(plan.is_after_pick);
  EXPECT_EQ(ahead, (std::vector<bool>{false, true, false})) << tail(run);

  MissionConfig last = lookingAhead();
  last.bricks_total = 1;
  ToyMission one(last, ToyWorld::ofStacks({1}));
  EXPECT_TRUE(one.endsAs(EndReason::kNoBrickLeft));
  EXPECT_FALSE(one.commands.empty());
  for (const Command& command : one.commands) EXPECT_FALSE(command.is_beside_pick) << tail(one);
}

TEST(LookingAhead, DrivesToAViewThatWasChosenMeanwhileWhenTheArmIsFree) {
  MissionConfig config = lookingAhead();
  config.stow = {"a", "b", "c", "d"};
  ToyMission run(config, ToyWorld::ofStacks({1, 1}));
  EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
  EXPECT_EQ(run.world.stowed, 2);
  // For the first view, beside the first pick, beside the second, which finds no pile, and once more when that is stowed.
  EXPECT_EQ(run.world.commands_of[State::kSelect], 4) << tail(run);
  EXPECT_EQ(run.machine.counts().views, 2);
}

TEST(LookingAhead, APickThatFailsThenMakesItWorthless) {
  for (const ArmStatus status : {ArmStatus::kLostOnTheWay, ArmStatus::kPathBlocked, ArmStatus::kNotLetGo,
                                 ArmStatus::kProtectiveStop, ArmStatus::kStaleState}) {
    for (int steps = 0; steps <= 4; ++steps) {  // look, detect, plan; then only the pick goes on
      SCOPED_TRACE(std::string(toString(status)) + " after " + std::to_string(steps) + " steps");
      MissionConfig config = lookingAhead();
      config.unlocks_protective_stop = true;
      ToyMission run(config, ToyWorld::ofStacks({2}));
      ASSERT_TRUE(toLookAhead(run));
      run.world.carried_until_s = run.now_s + steps;
      while (run.world.carrying && run.world.carried_until_s > run.now_s + 1.0) ASSERT_TRUE(run.advance());
      run.inject = endAs(State::kPick, ArmResult{status}, 1);
      const int plans = run.world.commands_of[State::kPlanPick];
      while (run.world.carrying) ASSERT_TRUE(run.advance());
      EXPECT_NE(run.machine.state(), State::kPick) << "picks by a plan of another pile\n" << tail(run);
      EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
      EXPECT_EQ(run.world.stowed, 2) << tail(run);
      EXPECT_GE(run.world.commands_of[State::kPlanPick], plans + 1);
    }
  }
}

TEST(LookingAhead, SelectsOnceWhereItIsBestToStayWithoutABrick) {
  MissionConfig config = lookingAhead();
  config.views.choose_after_each_pick = true;
  ToyMission run(config, ToyWorld::ofStacks({1, 1}));
  ASSERT_TRUE(toLookAhead(run));
  run.world.carried_until_s = run.now_s + 20.0;
  SelectionResult here;
  here.T_map_base = viewPose(0);
  here.stays = true;
  run.inject = endAs(State::kSelect, here);
  const int before = run.world.commands_of[State::kSelect];
  while (run.world.carrying) ASSERT_TRUE(run.advance());
  EXPECT_EQ(run.world.commands_of[State::kSelect], before + 1) << tail(run);
}

TEST(LookingAhead, WithoutAViewItIsDecidedWhenTheBrickIsStowed) {
  ToyMission run(lookingAhead(), ToyWorld::ofStacks({1}));
  run.inject = endAs(State::kSelect, SelectionResult{SelectionStatus::kLowUtility, viewPose(0), false}, 2);
  ASSERT_TRUE(toLookAhead(run));
  while (run.world.carrying) ASSERT_TRUE(run.advance());
  EXPECT_EQ(run.machine.state(), State::kLook) << tail(run);
  EXPECT_EQ(run.machine.counts().bricks_picked, 1);
}

TEST(LookingAhead, AnActionBesideThatTakesTooLongIsDroppedAndThePickAwaited) {
  ToyMission run(lookingAhead(), ToyWorld::ofStacks({2}));
  ASSERT_TRUE(toLookAhead(run));
  run.now_s += run.config.time.action_timeout_s;
  run.tell(event::Tick{});
  EXPECT_EQ(run.machine.state(), State::kPick);
  run.world.running.reset();
  run.world.carried_until_s = run.now_s;
  ASSERT_TRUE(run.advance());
  EXPECT_EQ(run.machine.counts().bricks_picked, 1) << tail(run);
  EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
  EXPECT_EQ(run.world.stowed, 2);
}

TEST(LookingAhead, APauseComesWhenTheBrickIsStowed) {
  ToyMission run(lookingAhead(), ToyWorld::ofStacks({2}));
  ASSERT_TRUE(toLookAhead(run));
  run.tell(event::Pause{});
  while (run.machine.state() != State::kPaused) ASSERT_TRUE(run.advance()) << tail(run);
  EXPECT_EQ(run.machine.counts().bricks_picked, 1);
  EXPECT_FALSE(run.world.carrying);
  run.tell(event::Resume{});
  EXPECT_TRUE(run.endsAs(EndReason::kNoBrickLeft));
  EXPECT_EQ(run.world.stowed, 2);
}

TEST(LookingAhead, AfterACrashThePickCountsAsFailed) {
  ToyMission run(lookingAhead(), ToyWorld::ofStacks({2}));
  ASSERT_TRUE(toLookAhead(run));
  ASSERT_TRUE(run.advance());  // another action has been answered since
  run.machine = MissionMachine::fromJson(run.config, {}, run.machine.toJson());
  EXPECT_EQ(run.machine.bricks().bricks().at(1).picks_failed, 1);
}

}  // namespace
}  // namespace toy
