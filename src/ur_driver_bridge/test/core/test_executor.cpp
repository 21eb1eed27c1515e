// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/executor.h"

#include <gmock/gmock.h>

#include "support/fake_arm.h"

namespace ur_driver_bridge {
namespace {

using Answer = FakeArm::Answer;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

constexpr double kPlate_m = 0.4;  // over the arm's base frame
constexpr double kTouchFrom_m = 0.03;
constexpr double kOvertravel_m = 0.01;
constexpr double kBrick_kg = 1.0;
// Between the cubics of what is sent and of what is planned there are microradians; a stop's first point makes up for one
// step's delay within 30 ms, on the path but for its curvature.
constexpr double kOnPath_rad = 1e-3;

ArmVector above(double z_m, const ArmVector& near_rad) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() << 0.75, 0.0, z_m;
  T.linear() = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()).toRotationMatrix();
  const std::vector<ArmVector> solutions = fakeKinematics()->inverse(T, near_rad);
  if (solutions.empty()) throw std::logic_error("out of reach");
  return solutions.front();
}

JointTrajectory straight(const ArmVector& from_rad, double from_m, double to_m, double speed_m_s) {
  motion_planning::JointPath path;
  const int parts = std::max(1, static_cast<int>(std::ceil(std::abs(to_m - from_m) / 0.005)));
  ArmVector near_rad = from_rad;
  for (int i = 0; i <= parts; ++i) {
    near_rad = above(from_m + (to_m - from_m) * i / parts, near_rad);
    path.push_back(near_rad);
  }
  return motion_planning::timeParametrize(path, {}, {}, motion_planning::tipSpeedLimit(fakeKinematics(), speed_m_s));
}

/// A pick as a planner would make it; made once.
struct Scene {
  ArmVector home_rad, over_rad, side_rad;
  PickRequest pick;
  JointTrajectory move;
};
const Scene& scene() {
  static const Scene kScene = [] {
    Scene made;
    ArmVector near_rad;
    near_rad << 0.0, -1.5, 1.5, -1.5, -1.5, 0.0;
    made.over_rad = above(kPlate_m + kTouchFrom_m, near_rad);
    made.home_rad = made.over_rad;
    made.home_rad[0] -= 0.2;
    made.side_rad = made.over_rad;
    made.side_rad[0] += 1.0;
    PickRequest& pick = made.pick;
    pick.brick_mass_kg = kBrick_kg;
    pick.T_tip_brick.translation().z() = 0.1;
    pick.contact_travel_m = kTouchFrom_m;
    pick.approach = motion_planning::timeParametrize({made.home_rad, made.over_rad}, {});
    pick.touch = straight(made.over_rad, kPlate_m + kTouchFrom_m, kPlate_m - kOvertravel_m, 0.06);
    pick.lift = straight(made.over_rad, kPlate_m, kPlate_m + 0.08, 0.15);
    ArmVector stow_rad = pick.lift.points.back().position_rad;
    stow_rad[0] += 0.2;
    pick.stow = motion_planning::timeParametrize({pick.lift.points.back().position_rad, stow_rad}, {});
    pick.lets_go = true;
    made.move = motion_planning::timeParametrize({made.over_rad, made.side_rad}, {});
    return made;
  }();
  return kScene;
}

/// With short waits: what they are for is not simulated here.
ExecutorConfig quick() {
  ExecutorConfig config;
  config.gate.max_map_age_s = 0.3;
  config.pick.settle_s = 0.03;
  config.pick.magnet_settle_s = 0.05;
  config.load.weigh_s = 0.1;
  config.load.lost_s = 0.04;
  config.recovery.unlock_wait_s = 0.5;
  config.recovery.step_timeout_s = 1.0;
  return config;
}

struct Mover : FakeArm {
  explicit Mover(const ExecutorConfig& config = quick()) : FakeArm(config, scene().over_rad) {
    step();
    executor.move(scene().move);
  }
  /// To where it moves fast.
  void getGoing() {
    while (speed() < 0.5 && steps < 1000) step();
    ASSERT_GE(speed(), 0.5);
  }
};

struct Picker : FakeArm {
  explicit Picker(PickRequest request = scene().pick, const ExecutorConfig& config = quick())
      : FakeArm(config, request.approach.points.front().position_rad) {
    plate_z_m = kPlate_m;
    step();
    executor.pick(request);
  }
  void runTo(const std::string& stage, double more_s = 0.0) {
    while (executor.stage() != stage && finished_count == 0 && steps < 5000) step();
    for (double t = 0.0; t < more_s && executor.stage() == stage; t += kStep_s) step();
    ASSERT_EQ(executor.stage(), stage);
  }
};

void expectEnds(FakeArm& arm, ArmStatus status, double within_s = 20.0) {
  const std::optional<Finished> finished = arm.run(within_s);
  ASSERT_TRUE(finished) << "goes on in " << arm.executor.stage();
  EXPECT_EQ(finished->verdict.status, status)
      << toString(finished->verdict.status) << ": " << finished->verdict.message;
  EXPECT_EQ(finished->verdict.message.empty(), status == ArmStatus::kSuccess) << finished->verdict.message;
  EXPECT_TRUE(arm.isAtRest());
  EXPECT_TRUE(arm.executor.isIdle());
  EXPECT_EQ(arm.finished_count, 1);
}

/// Whatever happens.
void expectOrderly(const FakeArm& arm, double stop_s = MotionConfig().stop_s) {
  EXPECT_LE(arm.worst_off_path_rad, kOnPath_rad);
  // The stop is asked for in one step and taken in the next.
  EXPECT_LE(arm.longest_stop_s, stop_s + 2.5 * FakeArm::kStep_s);
  EXPECT_EQ(arm.executor.isHolding(), arm.is_attached);
  EXPECT_TRUE(arm.dropped == 0 || arm.dropped_in == "let_go") << arm.dropped_in;
}

// ------------------------------------------------------------------------------------------------------------ motion

TEST(Executor, MovesWatchedToTheEnd) {
  Mover arm;
  expectEnds(arm, ArmStatus::kSuccess);
  expectOrderly(arm);
  EXPECT_THAT(arm.calls, ElementsAre("watch", "send", "unwatch"));
  EXPECT_LT((arm.position_rad - scene().side_rad).cwiseAbs().maxCoeff(), 1e-6);
  EXPECT_EQ(arm.finished->stage, "move");
}

TEST(Executor, ASecondRequestIsRefusedAndTheFirstGoesOn) {
  Mover arm;
  arm.step();
  EXPECT_THROW(arm.executor.move(scene().move), std::logic_error);
  EXPECT_THROW(arm.executor.pick(scene().pick), std::logic_error);
  EXPECT_THROW(arm.executor.letGo(), std::logic_error);
  EXPECT_THROW(arm.executor.recover({}), std::logic_error);
  expectEnds(arm, ArmStatus::kSuccess);
}

TEST(Executor, BeginsOnlyWhereItStandsAndWhatTheArmCanDo) {
  const auto outcome = [](const JointTrajectory& trajectory) {
    FakeArm arm(quick(), scene().over_rad);
    arm.step();
    arm.executor.move(trajectory);
    const auto finished = arm.run(1.0);
    EXPECT_EQ(arm.count("send"), 0);
    return finished ? finished->verdict.status : ArmStatus::kSuccess;
  };
  EXPECT_EQ(outcome({}), ArmStatus::kBadRequest);
  JointTrajectory elsewhere = scene().move;
  for (TrajectoryPoint& point : elsewhere.points) point.position_rad[1] += 0.03;
  EXPECT_EQ(outcome(elsewhere), ArmStatus::kStartMismatch);
  JointTrajectory fast = scene().move;
  for (TrajectoryPoint& point : fast.points) {
    point.time_s /= 10.0;
    point.velocity_rad_s *= 10.0;
    point.acceleration_rad_s2 *= 100.0;
  }
  EXPECT_EQ(outcome(fast), ArmStatus::kBeyondLimits);
}

TEST(Executor, ATrajectoryToWhereItStandsIsDoneAtOnce) {
  FakeArm arm(quick(), scene().over_rad);
  JointTrajectory nowhere;
  nowhere.points.push_back(scene().move.points.front());
  arm.step();
  arm.executor.move(nowhere);
  expectEnds(arm, ArmStatus::kSuccess, 0.1);
  EXPECT_THAT(arm.calls, testing::IsEmpty());
}

TEST(Executor, AShortTrajectoryFromALittleOffIsAsGentleAsALongOne) {
  // 0.015 rad off the start of a trajectory of 0.1 s.
  ArmVector near_rad = scene().over_rad;
  near_rad[3] += 0.004;
  FakeArm arm(quick(), scene().over_rad + ArmVector::Constant(0.015));
  arm.step();
  arm.executor.move(motion_planning::timeParametrize({scene().over_rad, near_rad}, {}));
  expectEnds(arm, ArmStatus::kSuccess);
  EXPECT_LT((arm.position_rad - near_rad).cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_EQ(arm.sent.at(0).points.front().position_rad, (scene().over_rad + ArmVector::Constant(0.015)).eval());
  TrajectoryLimits limits = fakeModel().limits;
  limits.acceleration_rad_s2.setConstant(MotionConfig().acceleration_rad_s2);
  const Verdict verdict = checkTrajectory(arm.sent.at(0), limits);
  EXPECT_TRUE(verdict.isFine()) << verdict.message;
}

TEST(Executor, StopsOnItsPathAtEveryStepOfAMotion) {
  const int steps = [] {
    Mover arm;
    arm.run(20.0);
    return arm.steps;
  }();
  for (int k = 1; k < steps; ++k) {
    SCOPED_TRACE("stopped before step " + std::to_string(k));
    Mover arm;
    while (arm.steps < k) arm.step();
    arm.executor.stop({ArmStatus::kCancelled, "test"});
    const auto finished = arm.run(5.0);
    ASSERT_TRUE(finished);
    const bool is_over = finished->verdict.isFine();
    EXPECT_TRUE(is_over || finished->verdict.status == ArmStatus::kCancelled) << finished->verdict.message;
    EXPECT_TRUE(arm.isAtRest());
    expectOrderly(arm);
    const ArmVector stood_rad = arm.position_rad;
    for (int i = 0; i < 30; ++i) arm.step();
    EXPECT_LT((arm.position_rad - stood_rad).cwiseAbs().maxCoeff(), 1e-9) << "the arm moves after the end";
    if (testing::Test::HasFailure()) break;
  }
}

TEST(Executor, AStopBeforeTheControllerHasAnsweredStopsWhatItTakesLater) {
  for (const double delay_s : {0.02, 0.05, 0.2, 0.6}) {
    SCOPED_TRACE(delay_s);
    Mover arm;
    arm.manners["send"].delay_s = delay_s;
    while (arm.count("send") == 0) arm.step();
    arm.executor.stop({ArmStatus::kCancelled, "test"});
    expectEnds(arm, ArmStatus::kCancelled, 2.0);
    const ArmVector stood_rad = arm.position_rad;
    for (int i = 0; i < 100; ++i) arm.step();
    EXPECT_LT((arm.position_rad - stood_rad).cwiseAbs().maxCoeff(), 1e-9) << "the arm moves after the end";
    // Nothing but the step from its being taken until it is called back.
    EXPECT_LT((arm.position_rad - scene().over_rad).cwiseAbs().maxCoeff(), 0.01);
  }
}

TEST(Executor, AnUnheardAcceptanceDoesNotMakeTheStopJumpBack) {
  Mover arm;
  arm.hides_acceptance = true;  // it moves already, its word is late
  arm.getGoing();
  arm.hides_acceptance = false;
  EXPECT_EQ(arm.executor.phase(), ExecutorPhase::kStarting);
  const double turned_rad = arm.position_rad[0];
  arm.executor.stop({ArmStatus::kCancelled, "test"});
  expectEnds(arm, ArmStatus::kCancelled);
  EXPECT_GT(arm.position_rad[0], turned_rad);
  EXPECT_EQ(arm.count("brake"), 1);
  expectOrderly(arm);
}

TEST(Executor, AStopThatTheControllerRefusesOrDoesNotAnswerIsACancel) {
  for (const Answer answer : {Answer::kNo, Answer::kNever}) {
    Mover arm;
    arm.manners["brake"].answer = answer;
    arm.getGoing();
    arm.executor.stop({ArmStatus::kCancelled, "test"});
    expectEnds(arm, ArmStatus::kCancelled, 3.0);
    EXPECT_GE(arm.count("cancel"), 1);
    // stop_s for the answer that does not come, 50 ms for this controller's own stop.
    EXPECT_LE(arm.longest_stop_s, 0.1 + 0.05 + 3.5 * FakeArm::kStep_s);
  }
}

TEST(Executor, StopsOnce) {
  Mover arm;
  arm.getGoing();
  arm.executor.stop({ArmStatus::kCancelled, "first"});
  arm.step();
  arm.step();
  arm.executor.stop({ArmStatus::kHeld, "second"});
  arm.gate.is_held = true;
  expectEnds(arm, ArmStatus::kCancelled);
  EXPECT_EQ(arm.finished->verdict.message, "first");
  EXPECT_EQ(arm.count("brake"), 1);
  expectOrderly(arm);
}

TEST(Executor, ASuccessOfTheOldGoalIsNotThatOfTheStop) {
  Mover arm;
  arm.getGoing();
  const std::uint64_t old = arm.last_sent_id;
  arm.executor.stop({ArmStatus::kCancelled, "test"});
  arm.step();
  arm.extra_events.push_back({old, TrajectoryEvent::Kind::kSucceeded, ""});
  arm.step();
  EXPECT_FALSE(arm.executor.isIdle());
  expectEnds(arm, ArmStatus::kCancelled);
  expectOrderly(arm);
}

TEST(Executor, EventsAndRepliesOfOthersChangeNothing) {
  Mover arm;
  arm.getGoing();
  for (const auto kind : {TrajectoryEvent::Kind::kRejected, TrajectoryEvent::Kind::kAborted,
                          TrajectoryEvent::Kind::kSucceeded, TrajectoryEvent::Kind::kLost}) {
    arm.extra_events.push_back({77777, kind, ""});
  }
  CallReply reply;
  reply.id = 77777;
  arm.extra_replies.push_back(reply);
  arm.extra_events.push_back({arm.last_sent_id, TrajectoryEvent::Kind::kAccepted, ""});
  expectEnds(arm, ArmStatus::kSuccess);
}

TEST(Executor, SuccessBeforeAcceptanceIsSuccess) {
  Mover arm;
  arm.manners["send"].answer = Answer::kNever;
  while (arm.count("send") == 0) arm.step();
  arm.extra_events.push_back({arm.last_sent_id, TrajectoryEvent::Kind::kSucceeded, ""});
  arm.extra_events.push_back({arm.last_sent_id, TrajectoryEvent::Kind::kAccepted, ""});
  expectEnds(arm, ArmStatus::kSuccess, 1.0);
}

TEST(Executor, EveryEndThatTheControllerTells) {
  using Kind = TrajectoryEvent::Kind;
  const std::pair<Kind, ArmStatus> cases[] = {{Kind::kAborted, ArmStatus::kTrajectoryAborted},
                                              {Kind::kCancelled, ArmStatus::kTrajectoryAborted},
                                              {Kind::kLost, ArmStatus::kDriverGone}};
  for (const auto& [kind, status] : cases) {
    Mover arm;
    arm.getGoing();
    arm.abort(kind, "its reason");
    expectEnds(arm, status);
    EXPECT_THAT(arm.finished->verdict.message, HasSubstr("its reason"));
  }
  Mover arm;
  arm.manners["send"].answer = Answer::kNo;
  expectEnds(arm, ArmStatus::kTrajectoryRefused);
}

TEST(Executor, TheCauseThatTheRobotTellsAfterTheAbortIsTheVerdict) {
  Mover arm;
  arm.getGoing();
  arm.abort(TrajectoryEvent::Kind::kAborted, "aborted");
  const int at = arm.steps;
  const auto finished = arm.run(2.0, [&] {
    if (arm.steps == at + 12) arm.gate.arm.safety_mode = safety_mode::kProtectiveStop;
  });
  ASSERT_TRUE(finished);
  EXPECT_EQ(finished->verdict.status, ArmStatus::kProtectiveStop) << finished->verdict.message;
  EXPECT_THAT(finished->verdict.message, HasSubstr("aborted"));
}

TEST(Executor, AnArmThatDoesNotStandAtTheEndIsNoSuccess) {
  Mover arm;
  arm.run(20.0, [&] {
    if (arm.steps == 30) arm.extra_events.push_back({arm.last_sent_id, TrajectoryEvent::Kind::kSucceeded, ""});
    arm.ignores_cancel = true;
    arm.scaling = arm.steps < 30 ? 1.0 : 0.1;  // so that it goes on for long
  });
  ASSERT_TRUE(arm.finished);
  EXPECT_EQ(arm.finished->verdict.status, ArmStatus::kNotReady) << arm.finished->verdict.message;
  EXPECT_GE(arm.count("cancel"), 1);
}

// ------------------------------------------------------------------------------------------------------- who is silent

TEST(Executor, NobodyWatches) {
  for (const Answer answer : {Answer::kNo, Answer::kGone, Answer::kNever}) {
    Mover arm;
    arm.manners["watch"].answer = answer;
    expectEnds(arm, ArmStatus::kMonitorGone, 2.0);
    EXPECT_EQ(arm.count("send"), 0);
    // Nothing is waited for any longer: in lock step the clock would.
    arm.step();
    EXPECT_FALSE(arm.executor.isWaitingForReply());
  }
}

TEST(Executor, WithoutAMonitorByTheConfigurationItMovesUnwatched) {
  ExecutorConfig config = quick();
  config.gate.max_monitor_age_s = 0.0;
  Mover arm(config);
  arm.is_monitor_silent = true;
  expectEnds(arm, ArmStatus::kSuccess);
  EXPECT_THAT(arm.calls, ElementsAre("send"));
}

TEST(Executor, TheControllerDoesNotAnswer) {
  Mover arm;
  arm.manners["send"].answer = Answer::kNever;
  expectEnds(arm, ArmStatus::kDriverGone, 4.0);
  EXPECT_GE(arm.count("cancel"), 1);
}

TEST(Executor, NothingIsSentWhileTheGateIsClosed) {
  // It closes while the monitor thinks.
  Mover arm;
  arm.manners["watch"].delay_s = 0.5;
  while (arm.count("watch") == 0) arm.step();
  arm.gate.is_held = true;
  expectEnds(arm, ArmStatus::kHeld, 2.0);
  EXPECT_EQ(arm.count("send"), 0);
  EXPECT_EQ(arm.count("unwatch"), 1);
}

struct Closing {
  const char* name;
  ArmStatus status;
  double notice_s;  // until it can be known
  void (*close)(FakeArm&);
};
// The ages are those of SafetyGateConfig and quick().
const Closing kClosings[] = {
    {"held", ArmStatus::kHeld, 0.0, [](FakeArm& arm) { arm.gate.is_held = true; }},
    {"must_stop", ArmStatus::kPathBlocked, 0.0, [](FakeArm& arm) { arm.must_stop = "a wall"; }},
    {"heartbeat", ArmStatus::kHeartbeatLost, 0.13, [](FakeArm& arm) { arm.is_mission_silent = true; }},
    {"monitor", ArmStatus::kMonitorGone, 0.5, [](FakeArm& arm) { arm.is_monitor_silent = true; }},
    {"map", ArmStatus::kStaleMap, 0.3, [](FakeArm& arm) { arm.is_map_silent = true; }},
    {"protective", ArmStatus::kProtectiveStop, 0.0,
     [](FakeArm& arm) {
       arm.gate.arm.safety_mode = safety_mode::kProtectiveStop;
       arm.abort(TrajectoryEvent::Kind::kAborted, "robot");
     }},
    {"emergency", ArmStatus::kEmergencyStop, 0.0,
     [](FakeArm& arm) {
       arm.gate.arm.safety_mode = safety_mode::kRobotEmergencyStop;
       arm.abort(TrajectoryEvent::Kind::kAborted, "robot");
     }},
    {"program", ArmStatus::kProgramStopped, 0.0,
     [](FakeArm& arm) {
       arm.gate.arm.is_program_running = false;
       arm.abort(TrajectoryEvent::Kind::kAborted, "robot");
     }},
    {"mode", ArmStatus::kNotReady, 0.0,
     [](FakeArm& arm) {
       arm.gate.arm.robot_mode = robot_mode::kPowerOff;
       arm.abort(TrajectoryEvent::Kind::kAborted, "robot");
     }},
    {"driver", ArmStatus::kDriverGone, 0.0, [](FakeArm& arm) { arm.gate.arm.is_controller_there = false; }},
    {"joints", ArmStatus::kStaleState, 0.1, [](FakeArm& arm) { arm.is_joints_silent = true; }},
};

TEST(Executor, TheGateStopsTheArmOnItsPath) {
  for (const Closing& closing : kClosings) {
    SCOPED_TRACE(closing.name);
    Mover arm;
    arm.getGoing();
    closing.close(arm);
    const double since_s = arm.now_s;
    double stood_s = 0.0;
    const auto finished = arm.run(6.0, [&] {
      if (arm.speed() > 0.0) stood_s = arm.now_s;
    });
    ASSERT_TRUE(finished);
    EXPECT_EQ(finished->verdict.status, closing.status) << finished->verdict.message;
    EXPECT_LE(stood_s - since_s, closing.notice_s + MotionConfig().stop_s + 4.0 * FakeArm::kStep_s);
    EXPECT_LE(arm.worst_off_path_rad, kOnPath_rad);
    // Nothing begins behind a gate that is closed.
    arm.finished_count = 0;
    const int sent = arm.count("send");
    arm.executor.move(scene().move);
    arm.run(6.0);
    EXPECT_EQ(arm.finished_count, 1);
    EXPECT_EQ(arm.count("send"), sent);
  }
}

TEST(Executor, AProtectiveStopIsToldThoughTheRobotFirstTellsThatItsProgramStands) {
  Mover arm;
  arm.getGoing();
  arm.gate.arm.is_program_running = false;
  arm.abort(TrajectoryEvent::Kind::kAborted, "robot");
  const double since_s = arm.now_s;
  while (arm.now_s - since_s < 0.1) arm.step();
  arm.gate.arm.safety_mode = safety_mode::kProtectiveStop;
  expectEnds(arm, ArmStatus::kProtectiveStop);
}

TEST(Executor, ASlowedArmIsWatchedAnewWhereItIsAndArrives) {
  // At 0.8 a watch is older than a monitor may be silent when the next begins.
  for (const auto& [scaling, least_watches] : {std::pair(0.1, 11), std::pair(0.8, 2)}) {
    Mover arm;
    arm.scaling = scaling;
    const auto finished = arm.run(60.0, [&] {
      if (arm.executor.phase() != ExecutorPhase::kMoving) return;
      const double believed_s = arm.now_s - arm.watched.start_s;
      const double is_s = arm.executor.progress() * arm.watched.trajectory.duration();
      // A step until it is seen, one for the call, one in which the arm goes on.
      EXPECT_NEAR(believed_s, is_s, MotionConfig().watch_drift_s + 3.0 * FakeArm::kStep_s);
    });
    ASSERT_TRUE(finished);
    EXPECT_TRUE(finished->verdict.isFine()) << finished->verdict.message;
    EXPECT_GE(arm.count("watch"), least_watches);
    expectOrderly(arm);
  }
}

TEST(Executor, AStopThatIsTakenLateDoesNotTurnTheArmBack) {
  Mover arm;
  arm.manners["brake"].delay_s = 0.02;
  arm.getGoing();
  arm.executor.stop({ArmStatus::kCancelled, "test"});
  double slowest_rad_s = 0.0;
  const auto finished = arm.run(2.0, [&] { slowest_rad_s = std::min(slowest_rad_s, arm.velocity_rad_s[0]); });
  ASSERT_TRUE(finished);
  EXPECT_GT(slowest_rad_s, -1e-6);
  expectOrderly(arm, MotionConfig().stop_s + 0.02);
}

TEST(Executor, AStopAtTheVeryEndIsATrajectoryThatAControllerTakes) {
  ExecutorConfig config = quick();
  config.motion.latency_s = 0.05;  // so that there is something to find
  Mover arm(config);
  while (arm.executor.progress() * scene().move.duration() < scene().move.duration() - 0.04) arm.step();
  arm.executor.stop({ArmStatus::kCancelled, "test"});
  expectEnds(arm, ArmStatus::kCancelled);
  ASSERT_EQ(arm.sent.size(), 2u);
  EXPECT_GT(arm.sent[1].points.front().time_s, 0.0);
  expectOrderly(arm);
}

TEST(Executor, ASlowedArmStopsAsFast) {
  Mover arm;
  arm.scaling = 0.3;
  while (arm.speed() < 0.2) arm.step();
  arm.executor.stop({ArmStatus::kCancelled, "test"});
  expectEnds(arm, ArmStatus::kCancelled);
  expectOrderly(arm);
}

TEST(Executor, ADumbMonitorOnTheWayStopsTheArm) {
  Mover arm;
  arm.scaling = 0.1;
  while (arm.count("send") == 0) arm.step();
  for (int i = 0; i < 5; ++i) arm.step();
  arm.manners["watch"].answer = Answer::kNever;
  expectEnds(arm, ArmStatus::kMonitorGone, 3.0);
  EXPECT_THAT(arm.finished->verdict.message, HasSubstr("has not answered"));
  expectOrderly(arm);
}

TEST(Executor, APausedArmGoesOnOrIsGivenUp) {
  Mover arm;
  arm.getGoing();
  arm.scaling = 0.0;
  for (int i = 0; i < 900; ++i) arm.step();
  EXPECT_FALSE(arm.executor.isIdle());
  arm.scaling = 1.0;
  expectEnds(arm, ArmStatus::kSuccess);

  Mover other;
  other.getGoing();
  other.scaling = 0.0;
  const double since_s = other.now_s;
  expectEnds(other, ArmStatus::kStalled, 20.0);
  EXPECT_NEAR(other.now_s - since_s, MotionConfig().stall_patience_s, 0.2);
  other.scaling = 1.0;
  const ArmVector stood_rad = other.position_rad;
  for (int i = 0; i < 100; ++i) other.step();
  EXPECT_LT((other.position_rad - stood_rad).cwiseAbs().maxCoeff(), 0.05) << "goes on after it was given up";
}

TEST(Executor, ATrajectoryThatDoesNotEndIsGivenUp) {
  Mover arm;
  arm.manners["send"].answer = Answer::kNever;
  while (arm.count("send") == 0) arm.step();
  arm.extra_events.push_back({arm.last_sent_id, TrajectoryEvent::Kind::kAccepted, ""});
  ExecutorConfig config = quick();
  const double limit_s = scene().move.duration() + config.motion.end_patience_s + config.motion.answer_timeout_s;
  // The monitor goes on: what it is told anew never comes nearer to its end.
  expectEnds(arm, ArmStatus::kStalled, limit_s + 1.0);
}

TEST(Executor, TheMonitorsWatchMayEndAMomentBeforeTheTrajectoryByItsClock) {
  Mover arm;
  arm.watch_over_s = -0.05;
  expectEnds(arm, ArmStatus::kSuccess);
  Mover early;
  early.watch_over_s = -0.3;
  expectEnds(early, ArmStatus::kMonitorGone);
}

TEST(Executor, AClockThatRunsBackStopsAndTimesOutAllTheSame) {
  Mover arm;
  arm.getGoing();
  arm.now_s -= 500.0;
  expectEnds(arm, ArmStatus::kStaleState, 5.0);
  EXPECT_THAT(arm.finished->verdict.message, HasSubstr("set back by"));
  EXPECT_LE(arm.worst_off_path_rad, kOnPath_rad);

  Mover waiting;
  waiting.manners["send"].answer = Answer::kNever;
  while (waiting.count("send") == 0) waiting.step();
  waiting.now_s -= 0.05;  // less than what counts as set back
  expectEnds(waiting, ArmStatus::kDriverGone, 4.0);
}

TEST(Executor, NumbersThatAreNoneCloseTheGateAndBreakNothing) {
  Mover arm;
  arm.getGoing();
  arm.scaling = 1.0;
  arm.gate.arm.commanded_rad = Stamped<ArmVector>{arm.now_s, ArmVector::Constant(std::nan(""))};
  expectEnds(arm, ArmStatus::kSuccess);
}

TEST(Executor, APostureThatTheControllerToldLongAgoIsNotWhereTheArmIs) {
  Mover told_once, silent;
  told_once.gate.arm.commanded_rad = Stamped<ArmVector>{told_once.now_s, told_once.position_rad};
  for (Mover* arm : {&told_once, &silent}) arm->getGoing();
  EXPECT_GT(silent.executor.progress(), 0.1);
  EXPECT_EQ(told_once.executor.progress(), silent.executor.progress());
}

// --------------------------------------------------------------------------------------------------------------- pick

TEST(ExecutorPick, PicksStowsAndLetsGo) {
  Picker arm;
  expectEnds(arm, ArmStatus::kSuccess, 30.0);
  expectOrderly(arm);
  EXPECT_THAT(arm.stages, ElementsAre("", "approach", "zero", "touch", "magnet", "lift_a_little", "weigh", "payload",
                                      "lift", "stow", "let_go", ""));
  const Finished& finished = *arm.finished;
  EXPECT_NEAR(finished.figures.contact_travel_m, kTouchFrom_m, 3e-3);
  EXPECT_GT(finished.figures.contact_force_N, ContactDetectorConfig().threshold_N);
  EXPECT_NEAR(finished.figures.load_kg, kBrick_kg, 0.01);
  ASSERT_EQ(arm.payloads.size(), 2u);
  EXPECT_NEAR(arm.payloads[0].mass_kg, fakeModel().tool.mass_kg + kBrick_kg, 1e-12);
  EXPECT_EQ(arm.payloads[1].mass_kg, fakeModel().tool.mass_kg);
  EXPECT_FALSE(arm.executor.isHolding());
}

TEST(ExecutorPick, KeepsTheBrickUntilItIsToldToLetGo) {
  PickRequest request = scene().pick;
  request.lets_go = false;
  Picker arm(request);
  expectEnds(arm, ArmStatus::kSuccess, 30.0);
  EXPECT_TRUE(arm.executor.isHolding());
  EXPECT_TRUE(arm.is_magnet_on);
  EXPECT_THROW(arm.executor.pick(request), std::logic_error);
  EXPECT_TRUE(arm.executor.isIdle());
  arm.finished_count = 0;
  arm.executor.letGo();
  expectEnds(arm, ArmStatus::kSuccess);
  EXPECT_FALSE(arm.executor.isHolding());
  EXPECT_FALSE(arm.is_attached);
  EXPECT_EQ(arm.payloads.back().mass_kg, fakeModel().tool.mass_kg);
  // And does not miss it any more.
  for (int i = 0; i < 30; ++i) arm.step();
  arm.finished_count = 0;
  arm.executor.move(reversed(request.stow));
  expectEnds(arm, ArmStatus::kSuccess);
}

TEST(ExecutorPick, TheMagnetHasItsTime) {
  Picker arm;
  arm.runTo("magnet");
  const double since_s = arm.now_s;
  while (arm.count("attach") == 0 && arm.executor.stage() == "magnet") arm.step();
  EXPECT_GE(arm.now_s - since_s, quick().pick.magnet_settle_s);
}

/// Stopped before each step of a whole pick.
TEST(ExecutorPick, CancelledAtEveryStepItEndsAtRestAndKnowsWhatItHolds) {
  const int steps = [] {
    Picker arm;
    arm.run(30.0);
    return arm.steps;
  }();
  for (int k = 1; k < steps; ++k) {
    Picker arm;
    while (arm.steps < k) arm.step();
    const std::string stage = arm.executor.stage();
    SCOPED_TRACE("cancelled before step " + std::to_string(k) + " in " + stage);
    arm.executor.stop({ArmStatus::kCancelled, "test"});
    const auto finished = arm.run(5.0);
    ASSERT_TRUE(finished);
    EXPECT_TRUE(finished->verdict.isFine() || finished->verdict.status == ArmStatus::kCancelled)
        << finished->verdict.message;
    for (int i = 0; i < 5; ++i) arm.step();
    EXPECT_EQ(arm.finished_count, 1);
    EXPECT_TRUE(arm.isAtRest());
    expectOrderly(arm);
    EXPECT_EQ(arm.executor.isHolding(), arm.has_brick);
    EXPECT_EQ(arm.dropped > 0, finished->verdict.isFine()) << "let go, or not, as it says";
    if (!arm.executor.isHolding() && !arm.payloads.empty()) {
      EXPECT_EQ(arm.payloads.back().mass_kg, fakeModel().tool.mass_kg) << "no brick, but its payload";
    }
    if (testing::Test::HasFailure()) break;
  }
}

TEST(ExecutorPick, TheGateClosesAtEveryTenthStepForEveryReason) {
  const int steps = [] {
    Picker arm;
    arm.run(30.0);
    return arm.steps;
  }();
  for (const Closing& closing : kClosings) {
    for (int k = 2; k < steps; k += 10) {
      Picker arm;
      while (arm.steps < k) arm.step();
      const std::string stage = arm.executor.stage();
      SCOPED_TRACE(std::string(closing.name) + " before step " + std::to_string(k) + " in " + stage);
      const bool is_letting_go = stage == "let_go";
      closing.close(arm);
      const auto finished = arm.run(6.0);
      ASSERT_TRUE(finished) << arm.executor.stage();
      if (!is_letting_go && !finished->verdict.isFine() && !(closing.notice_s > 0.0)) {
        EXPECT_EQ(finished->verdict.status, closing.status)
            << toString(finished->verdict.status) << ": " << finished->verdict.message;
        EXPECT_EQ(arm.dropped, 0);
      }
      EXPECT_LE(arm.worst_off_path_rad, kOnPath_rad);
      EXPECT_EQ(arm.executor.isHolding(), arm.is_attached);
      EXPECT_TRUE(arm.isAtRest());
      EXPECT_TRUE(!arm.hangs() || (arm.is_magnet_on && arm.executor.isHolding()));
      if (testing::Test::HasFailure()) return;
    }
  }
}

TEST(ExecutorPick, TheMagnetIsNotSwitchedBehindAClosedGate) {
  Picker arm;
  arm.runTo("touch");
  while (arm.executor.phase() != ExecutorPhase::kStopping) arm.step();
  arm.gate.is_held = true;  // while it stops at contact
  expectEnds(arm, ArmStatus::kHeld);
  EXPECT_EQ(arm.count("magnet_on"), 0);

  // In the very step in which the stow ends.
  const int last = [] {
    Picker whole;
    whole.runTo("let_go");
    return whole.steps;
  }();
  Picker other;
  while (other.steps < last - 1) other.step();
  EXPECT_EQ(other.executor.stage(), "stow");
  other.gate.is_held = true;
  expectEnds(other, ArmStatus::kHeld);
  EXPECT_EQ(other.finished->stage, "let_go");
  EXPECT_EQ(other.count("magnet_off"), 0);
  EXPECT_TRUE(other.executor.isHolding());
}

TEST(ExecutorPick, ImpossibleTrajectoriesAreFoundBeforeAnythingMoves) {
  const auto outcome = [](const PickRequest& request) {
    Picker arm(request);
    const auto finished = arm.run(1.0);
    EXPECT_TRUE(finished);
    EXPECT_THAT(arm.calls, testing::IsEmpty());
    return finished ? std::string(toString(finished->verdict.status)) + " in " + finished->stage : "";
  };
  PickRequest request = scene().pick;
  request.stow.points[1].time_s = request.stow.points[2].time_s;
  EXPECT_EQ(outcome(request), "BAD_REQUEST in stow");
  request = scene().pick;
  for (TrajectoryPoint& point : request.stow.points) point.position_rad[2] += 0.03;
  EXPECT_EQ(outcome(request), "START_MISMATCH in stow");
  request = scene().pick;
  for (TrajectoryPoint& point : request.lift.points) point.position_rad[0] += 0.03;
  EXPECT_EQ(outcome(request), "START_MISMATCH in lift");
  request = scene().pick;
  for (TrajectoryPoint& point : request.touch.points) point.position_rad[0] += 0.03;
  EXPECT_EQ(outcome(request), "START_MISMATCH in touch");
  request = scene().pick;
  request.approach.points[1].velocity_rad_s.setConstant(5.0);
  EXPECT_EQ(outcome(request), "BEYOND_LIMITS in approach");
}

TEST(ExecutorPick, RequestsThatMakeNoSenseAreRefused) {
  FakeArm arm(quick(), scene().home_rad);
  const auto expectRefused = [&](auto spoil) {
    PickRequest request = scene().pick;
    spoil(request);
    EXPECT_THROW(arm.executor.pick(request), std::invalid_argument);
    EXPECT_TRUE(arm.executor.isIdle());
  };
  expectRefused([](PickRequest& request) { request.touch.points.clear(); });
  expectRefused([](PickRequest& request) { request.brick_mass_kg = 0.0; });
  expectRefused([](PickRequest& request) { request.brick_mass_kg = 4.3; });
  expectRefused([](PickRequest& request) { request.brick_mass_kg = std::nan(""); });
  expectRefused([](PickRequest& request) { request.contact_travel_m = std::nan(""); });
  expectRefused([](PickRequest& request) { request.T_tip_brick.translation().x() = std::nan(""); });
}

TEST(ExecutorPick, WithoutContactItGoesBackToWhereTheTouchBegan) {
  Picker arm;
  arm.plate_z_m = -10.0;
  expectEnds(arm, ArmStatus::kNoContact, 30.0);
  EXPECT_EQ(arm.finished->stage, "weigh");
  EXPECT_THAT(arm.finished->verdict.message, HasSubstr("no contact along"));
  EXPECT_EQ(arm.count("magnet_off"), 1);
  EXPECT_FALSE(arm.is_magnet_on);
  EXPECT_LT((arm.position_rad - scene().over_rad).cwiseAbs().maxCoeff(), 1e-3);
  EXPECT_EQ(arm.count("magnet_on"), 1);
  EXPECT_TRUE(std::isnan(arm.finished->figures.contact_travel_m));
  expectOrderly(arm);
}

TEST(ExecutorPick, ALooseBrickThatGivesWayIsTakenAllTheSame) {
  // It slides before the magnet's face: no force to speak of, and yet they touch.
  Picker arm;
  arm.gives_way = true;
  expectEnds(arm, ArmStatus::kSuccess, 30.0);
  EXPECT_TRUE(std::isnan(arm.finished->figures.contact_travel_m));
  EXPECT_NEAR(arm.finished->figures.load_kg, kBrick_kg, 0.01);
  expectOrderly(arm);
}

TEST(ExecutorPick, ContactThatComesTooEarlyIsLeftAlone) {
  Picker arm;
  arm.plate_z_m = kPlate_m + 0.023;
  expectEnds(arm, ArmStatus::kContactTooEarly, 30.0);
  EXPECT_LT((arm.position_rad - scene().over_rad).cwiseAbs().maxCoeff(), 1e-3);
  EXPECT_EQ(arm.count("magnet_on"), 0);
  EXPECT_NEAR(arm.finished->figures.contact_travel_m, 0.007, 3e-3);
  expectOrderly(arm);

  Picker sideways;
  sideways.runTo("touch", 0.5);
  sideways.sideways_N = 50.0;
  expectEnds(sideways, ArmStatus::kContactTooEarly, 30.0);
  EXPECT_THAT(sideways.finished->verdict.message, HasSubstr("across the tool"));
}

TEST(ExecutorPick, ABrickThatRocksUnderTheMagnetIsLeft) {
  Picker arm;
  arm.runTo("touch");
  const auto finished = arm.run(30.0, [&arm] {
    // As long as the magnet touches it.
    arm.shaking_rad_s.setConstant(arm.tipHeight() < kPlate_m ? 0.02 : 0.0);
  });
  ASSERT_TRUE(finished);
  EXPECT_EQ(finished->verdict.status, ArmStatus::kNotAttached) << finished->verdict.message;
  EXPECT_EQ(finished->stage, "touch");
  EXPECT_LT((arm.position_rad - scene().over_rad).cwiseAbs().maxCoeff(), 1e-3);
  EXPECT_EQ(arm.count("magnet_on"), 0);
  expectOrderly(arm);
}

TEST(ExecutorPick, ContactAtTheVeryEndOfTheTouchIsContact) {
  // The plate is met in the last millimetre: 8 N at 20 N/mm are 0.4 mm, and the debounce ends when the arm stands.
  for (const double before_end_m : {0.00045, 0.0006, 0.001}) {
    SCOPED_TRACE(before_end_m);
    PickRequest request = scene().pick;
    Picker arm(request);
    arm.plate_z_m = kPlate_m - kOvertravel_m + before_end_m;
    expectEnds(arm, ArmStatus::kSuccess, 30.0);
    EXPECT_NEAR(arm.finished->figures.contact_travel_m, kTouchFrom_m + kOvertravel_m, 1.5e-3);
  }
}

TEST(ExecutorPick, ContactIsLookedForUntilItCouldBeKnown) {
  ExecutorConfig config = quick();
  config.contact.debounce_s = 0.1;
  Picker arm(scene().pick, config);
  arm.plate_z_m = kPlate_m - kOvertravel_m + 0.0006;
  expectEnds(arm, ArmStatus::kSuccess, 30.0);
}

TEST(ExecutorPick, APlateThatIsHigherOrLowerThanPlannedIsLiftedAllTheSameAndPutBackThere) {
  for (const double off_m : {0.018, 0.01, -0.008}) {
    SCOPED_TRACE(off_m);
    Picker arm;
    arm.plate_z_m = kPlate_m + off_m;
    arm.runTo("lift_a_little");
    const double touched_m = arm.tipHeight();
    double lowest_m = touched_m;
    const auto finished = arm.run(30.0, [&] {
      if (arm.executor.stage() == "lift_a_little") lowest_m = std::min(lowest_m, arm.tipHeight());
    });
    ASSERT_TRUE(finished);
    EXPECT_TRUE(finished->verdict.isFine()) << finished->verdict.message;
    EXPECT_GT(lowest_m, touched_m - 5e-4) << "pressed down before it was lifted";

    Picker light;
    light.plate_z_m = kPlate_m + off_m;
    light.mass_kg = 0.2;
    expectEnds(light, ArmStatus::kNotAttached, 30.0);
    EXPECT_EQ(light.dropped, 0);
    expectOrderly(light);
  }
}

// A lift as fast as the arm may be, begun and stopped on its way, from where the touch happened to end.
TEST(ExecutorPick, AFastLiftIsStoppedToWeighWithinTheArmsAccelerations) {
  ExecutorConfig config = quick();
  config.pick.ramp_s = 0.1;
  for (const double off_m : {0.018, 0.0, -0.008}) {
    SCOPED_TRACE(off_m);
    Picker arm(scene().pick, config);
    arm.plate_z_m = kPlate_m + off_m;
    expectEnds(arm, ArmStatus::kSuccess, 30.0);
  }
}

TEST(ExecutorPick, WhatWeighsTooLittleOrTooMuchIsPutBack) {
  for (const double mass_kg : {0.0, 0.4, 1.9}) {
    SCOPED_TRACE(mass_kg);
    Picker arm;
    arm.mass_kg = mass_kg;
    arm.holds_plate = mass_kg > 0.0;
    expectEnds(arm, ArmStatus::kNotAttached, 30.0);
    EXPECT_EQ(arm.finished->stage, "weigh");
    EXPECT_NEAR(arm.finished->figures.load_kg, mass_kg, 0.01);
    EXPECT_FALSE(arm.is_magnet_on);
    EXPECT_EQ(arm.dropped, 0);
    EXPECT_FALSE(arm.executor.isHolding());
    EXPECT_LT((arm.position_rad - scene().over_rad).cwiseAbs().maxCoeff(), 1e-3);
    EXPECT_THAT(arm.stages, Contains("put_back"));
    expectOrderly(arm);
  }
}

TEST(ExecutorPick, ABrickThatTakesAnotherAlongIsPutBack) {
  for (const double at_s : {0.02, 0.2}) {
    Picker arm;
    arm.runTo("lift", at_s);
    const double height_m = arm.tipHeight();
    arm.mass_kg += 0.9;
    double highest_m = height_m;
    const auto finished = arm.run(30.0, [&] { highest_m = std::max(highest_m, arm.tipHeight()); });
    ASSERT_TRUE(finished);
    EXPECT_EQ(finished->verdict.status, ArmStatus::kNotAttached) << finished->verdict.message;
    EXPECT_EQ(finished->stage, "lift");
    EXPECT_THAT(finished->verdict.message, HasSubstr("takes something along"));
    EXPECT_LT(highest_m, height_m + 0.05) << "it went on";
    EXPECT_FALSE(arm.is_magnet_on);
    EXPECT_EQ(arm.dropped, 0);
    EXPECT_FALSE(arm.executor.isHolding());
    EXPECT_LT((arm.position_rad - scene().over_rad).cwiseAbs().maxCoeff(), 1e-3);
    expectOrderly(arm);
  }
  Picker little;
  little.runTo("lift", 0.1);
  little.mass_kg += 0.7;
  expectEnds(little, ArmStatus::kSuccess, 30.0);
}

TEST(ExecutorPick, ABrickIsNotDroppedWhenWhatRestsOnItSlidesOff) {
  for (const char* stage : {"payload", "lift"}) {
    SCOPED_TRACE(stage);
    Picker arm;
    arm.mass_kg += 0.6;
    arm.runTo(stage);
    arm.mass_kg -= 0.6;
    expectEnds(arm, ArmStatus::kSuccess, 30.0);
    EXPECT_EQ(arm.dropped_in, "let_go");
  }
}

TEST(ExecutorPick, ABrickIsPutBackWhereItsLiftIsBlocked) {
  for (const char* stage : {"lift_a_little", "lift"}) {
    for (const double at_s : {0.0, 0.02, 0.2}) {  // 0: before it moves
      Picker arm;
      arm.runTo(stage, at_s);
      arm.must_stop = "unseen space";
      while (arm.executor.stage() == stage) arm.step();
      arm.must_stop.clear();   // of the way up, not of the way back
      arm.brick_z_m += 0.015;  // something has slid below: it rests before it is where it was
      expectEnds(arm, ArmStatus::kPathBlocked, 30.0);
      EXPECT_EQ(arm.finished->stage, stage);
      EXPECT_FALSE(arm.is_magnet_on);
      EXPECT_EQ(arm.dropped, 0);
      EXPECT_FALSE(arm.executor.isHolding());
      EXPECT_LT((arm.position_rad - scene().over_rad).cwiseAbs().maxCoeff(), 1e-3);
      expectOrderly(arm);
    }
  }
  Picker enclosed;
  enclosed.runTo("lift", 0.2);
  enclosed.must_stop = "a person";
  expectEnds(enclosed, ArmStatus::kPathBlocked, 30.0);
  EXPECT_THAT(enclosed.finished->verdict.message, HasSubstr("the retreat failed, too"));
  EXPECT_TRUE(enclosed.executor.isHolding());
  EXPECT_EQ(enclosed.dropped, 0);
}

TEST(ExecutorPick, AForceThatDoesNotComeToRestIsNoWeight) {
  Picker arm;
  arm.runTo("weigh");
  arm.noise_N = 5.0;
  expectEnds(arm, ArmStatus::kNotAttached, 30.0);
  EXPECT_EQ(arm.dropped, 0);

  Picker later;
  later.runTo("payload");
  later.noise_N = 5.0;
  expectEnds(later, ArmStatus::kStaleState, 30.0);
  EXPECT_TRUE(later.executor.isHolding());
}

TEST(ExecutorPick, APutBackThatIsStoppedKeepsTheBrick) {
  Picker arm;
  arm.mass_kg = 0.3;
  arm.runTo("put_back", 0.2);
  arm.executor.stop({ArmStatus::kCancelled, "test"});
  expectEnds(arm, ArmStatus::kNotAttached);
  EXPECT_THAT(arm.finished->verdict.message, HasSubstr("the retreat failed, too"));
  EXPECT_TRUE(arm.is_magnet_on);
  EXPECT_EQ(arm.dropped, 0);
  expectOrderly(arm);
}

TEST(ExecutorPick, ALostBrickIsToldOfAtOnceAlsoWhenTheMagnetDoesNotObey) {
  for (const Answer answer : {Answer::kYes, Answer::kNo, Answer::kNever}) {
    for (const char* stage : {"lift", "stow"}) {
      SCOPED_TRACE(stage);
      Picker arm;
      arm.manners["magnet_off"].answer = answer;
      arm.runTo(stage, 0.1);
      arm.has_brick = false;
      const double since_s = arm.now_s;
      double told_s = 0.0;
      const auto finished = arm.run(10.0, [&] {
        if (arm.is_attached) told_s = arm.now_s;
      });
      ASSERT_TRUE(finished);
      EXPECT_EQ(finished->verdict.status, ArmStatus::kLostOnTheWay) << finished->verdict.message;
      EXPECT_FALSE(arm.executor.isHolding());
      EXPECT_LT(told_s - since_s, 0.5);
      expectOrderly(arm);
    }
  }
}

TEST(ExecutorPick, ABrickThatSomethingPushesUpIsNotLost) {
  for (const bool is_protective : {false, true}) {
    SCOPED_TRACE(is_protective);
    Picker arm;
    arm.runTo("stow", 0.1);
    arm.push_up_N = 7.0;  // of 9.8 N
    while (arm.executor.phase() != ExecutorPhase::kStopping) arm.step();
    if (is_protective) arm.gate.arm.safety_mode = safety_mode::kProtectiveStop;
    arm.run(0.05);
    if (!is_protective) arm.push_up_N = 0.0;  // over before the arm is at rest
    expectEnds(arm, is_protective ? ArmStatus::kProtectiveStop : ArmStatus::kPathBlocked);
    EXPECT_TRUE(arm.executor.isHolding());
    EXPECT_TRUE(arm.is_attached);
    EXPECT_TRUE(arm.is_magnet_on);
    EXPECT_EQ(arm.dropped, 0);
    expectOrderly(arm);
  }
}

TEST(ExecutorPick, ALossAndAStopTogetherLeaveNoBrickBehind) {
  Picker arm;
  arm.runTo("stow", 0.1);
  arm.has_brick = false;
  while (arm.executor.phase() != ExecutorPhase::kStopping) arm.step();
  arm.executor.stop({ArmStatus::kCancelled, "test"});
  expectEnds(arm, ArmStatus::kLostOnTheWay);
  EXPECT_FALSE(arm.executor.isHolding());
  EXPECT_FALSE(arm.is_magnet_on);
  EXPECT_EQ(arm.payloads.back().mass_kg, fakeModel().tool.mass_kg);
}

TEST(ExecutorPick, ABrickThatFallsWhileItIsWeighedIsNoPick) {
  Picker weighed;
  weighed.runTo("weigh", 0.03);
  weighed.has_brick = false;
  expectEnds(weighed, ArmStatus::kNotAttached, 30.0);

  Picker declared;
  declared.runTo("payload");
  declared.has_brick = false;
  expectEnds(declared, ArmStatus::kLostOnTheWay, 30.0);
  EXPECT_FALSE(declared.executor.isHolding());
  EXPECT_EQ(declared.payloads.back().mass_kg, fakeModel().tool.mass_kg);
}

TEST(ExecutorPick, ABrickLostWhileNothingMovesIsFoundBeforeTheNextMotion) {
  PickRequest request = scene().pick;
  request.lets_go = false;
  Picker arm(request);
  expectEnds(arm, ArmStatus::kSuccess, 30.0);
  arm.has_brick = false;
  for (int i = 0; i < 30; ++i) arm.step();
  const int sent = arm.count("send");
  arm.finished_count = 0;
  arm.executor.move(reversed(request.stow));
  expectEnds(arm, ArmStatus::kLostOnTheWay);
  EXPECT_EQ(arm.count("send"), sent);
  EXPECT_FALSE(arm.executor.isHolding());
}

TEST(ExecutorPick, AMagnetThatDoesNotObeyIsSwitchedOffAndLeft) {
  Picker refused;
  refused.manners["magnet_on"].answer = Answer::kNo;
  expectEnds(refused, ArmStatus::kIoRefused, 30.0);
  EXPECT_EQ(refused.count("magnet_off"), 1);
  EXPECT_LT((refused.position_rad - scene().over_rad).cwiseAbs().maxCoeff(), 1e-3);

  for (const Answer answer : {Answer::kGone, Answer::kNever}) {
    Picker gone;
    gone.manners["magnet_on"].answer = answer;
    expectEnds(gone, ArmStatus::kDriverGone, 30.0);
    EXPECT_EQ(gone.count("magnet_off"), 1);
  }
  Picker stuck;
  stuck.is_pin_stuck = true;
  expectEnds(stuck, ArmStatus::kIoRefused, 30.0);
  EXPECT_THAT(stuck.finished->verdict.message, HasSubstr("the gripper is not on"));
  EXPECT_FALSE(stuck.is_magnet_on);
  EXPECT_EQ(stuck.count("attach"), 0);

  // Told to stop while it waits for an answer that is a no: switched off all the same, without the way back.
  Picker stopped;
  stopped.manners["magnet_on"] = {Answer::kNo, 0.1};
  stopped.runTo("magnet");
  stopped.executor.stop({ArmStatus::kCancelled, "test"});
  expectEnds(stopped, ArmStatus::kIoRefused);
  EXPECT_EQ(stopped.count("magnet_off"), 1);
}

TEST(ExecutorPick, AVacuumThatHoldsNothingIsSwitchedOffAndLeft) {
  Picker arm;
  arm.is_held_by_pressure = false;
  expectEnds(arm, ArmStatus::kNotAttached, 30.0);
  EXPECT_THAT(arm.finished->verdict.message, HasSubstr("the gripper is on, and holds nothing"));
  EXPECT_EQ(arm.count("magnet_off"), 1);
  EXPECT_EQ(arm.count("attach"), 0);
  EXPECT_LT((arm.position_rad - scene().over_rad).cwiseAbs().maxCoeff(), 1e-3);
}

TEST(ExecutorPick, PressureTellsOfALossBeforeTheWeightDoes) {
  Picker arm;
  arm.is_held_by_pressure = true;
  arm.runTo("stow", 0.1);
  arm.is_held_by_pressure = false;
  expectEnds(arm, ArmStatus::kLostOnTheWay, 10.0);
  EXPECT_THAT(arm.finished->verdict.message, HasSubstr("the gripper reports that it holds nothing"));
  EXPECT_FALSE(arm.executor.isHolding());
}

TEST(ExecutorPick, WhatTheDriverRefusesEndsThePick) {
  for (const auto& [call, stage] : {std::pair{"zero", "zero"}, std::pair{"payload", "payload"}}) {
    for (const Answer answer : {Answer::kNo, Answer::kGone, Answer::kNever}) {
      SCOPED_TRACE(call);
      Picker arm;
      arm.manners[call].answer = answer;
      expectEnds(arm, answer == Answer::kNo ? ArmStatus::kIoRefused : ArmStatus::kDriverGone, 30.0);
      EXPECT_EQ(arm.finished->stage, stage);
      EXPECT_EQ(arm.dropped, 0);
      EXPECT_EQ(arm.executor.isHolding(), arm.has_brick);
    }
  }
}

TEST(ExecutorPick, SlowAnswersAreWaitedForAndAnswersAfterTheEndChangeNothing) {
  Picker slow;
  for (const char* call : {"watch", "unwatch", "send", "magnet_on", "magnet_off", "zero", "payload"}) {
    slow.manners[call].delay_s = 0.15;  // longer, and the monitor's watch of the little lift is over before its start
  }
  expectEnds(slow, ArmStatus::kSuccess, 60.0);

  Picker late;
  late.manners["payload"].delay_s = 1.5;
  expectEnds(late, ArmStatus::kDriverGone, 60.0);
  const bool was_holding = late.executor.isHolding();
  for (int i = 0; i < 200; ++i) late.step();
  EXPECT_EQ(late.executor.isHolding(), was_holding);
  EXPECT_EQ(late.finished_count, 1);
  EXPECT_FALSE(late.executor.isWaitingForReply());
}

TEST(ExecutorPick, AnArmThatNeverRestsIsNotZeroed) {
  Picker arm;
  arm.runTo("zero");
  arm.shaking_rad_s.setConstant(0.02);
  expectEnds(arm, ArmStatus::kNotReady, 10.0);
  EXPECT_EQ(arm.finished->stage, "zero");
  EXPECT_EQ(arm.count("zero"), 0);
}

TEST(ExecutorPick, ASilentForceStopsTheTouchAndTheHeldBrick) {
  for (const char* stage : {"touch", "weigh", "lift", "stow"}) {
    SCOPED_TRACE(stage);
    Picker arm;
    arm.runTo(stage, 0.05);
    arm.is_force_silent = true;
    expectEnds(arm, ArmStatus::kStaleState, 5.0);
    EXPECT_EQ(arm.dropped, 0);
    expectOrderly(arm);
  }
}

// ------------------------------------------------------------------------------------------------------------- let go

TEST(ExecutorLetGo, OfNothingIsToldOfAndAMagnetThatIsOnIsSwitchedOff) {
  FakeArm arm(quick(), scene().over_rad);
  arm.step();
  arm.executor.letGo();
  expectEnds(arm, ArmStatus::kNothingHeld, 1.0);
  EXPECT_THAT(arm.calls, testing::IsEmpty());

  FakeArm other(quick(), scene().over_rad);
  other.is_magnet_on = true;  // since before the executor was
  other.step();
  other.executor.letGo();
  expectEnds(other, ArmStatus::kSuccess, 2.0);
  EXPECT_FALSE(other.is_magnet_on);
  EXPECT_THAT(other.calls, ElementsAre("magnet_off", "detach", "payload"));
}

TEST(ExecutorLetGo, AWeightThatStaysIsStillHeld) {
  PickRequest request = scene().pick;
  request.lets_go = false;
  Picker arm(request);
  expectEnds(arm, ArmStatus::kSuccess, 30.0);
  arm.finished_count = 0;
  arm.executor.letGo();
  const auto finished = arm.run(5.0, [&] { arm.has_brick = true; });  // it sticks to what is left of the field
  ASSERT_TRUE(finished);
  EXPECT_EQ(finished->verdict.status, ArmStatus::kNotLetGo) << finished->verdict.message;
  EXPECT_TRUE(arm.executor.isHolding());
  EXPECT_TRUE(arm.is_attached);
  // Again, and now it falls.
  arm.finished_count = 0;
  arm.executor.letGo();
  expectEnds(arm, ArmStatus::kSuccess, 5.0);
  EXPECT_FALSE(arm.executor.isHolding());
}

TEST(ExecutorLetGo, WhatWasNeverWeighedIsWeighedFirst) {
  // Broken off before it was weighed, and after its payload was declared.
  for (const auto& [stage, after_s] : {std::pair("lift_a_little", 0.3), std::pair("payload", 0.05)}) {
    for (const bool is_there : {true, false}) {
      SCOPED_TRACE(std::string(stage) + (is_there ? ", there" : ", gone"));
      PickRequest request = scene().pick;
      request.lets_go = false;
      Picker arm(request);
      arm.runTo(stage, after_s);
      arm.executor.stop({ArmStatus::kCancelled, "test"});
      expectEnds(arm, ArmStatus::kCancelled, 5.0);
      ASSERT_TRUE(arm.executor.isHolding());
      if (!is_there) arm.has_brick = false;
      arm.finished_count = 0;
      arm.executor.letGo();
      expectEnds(arm, is_there ? ArmStatus::kSuccess : ArmStatus::kLostOnTheWay, 10.0);
      EXPECT_FALSE(arm.executor.isHolding());
      EXPECT_FALSE(arm.is_attached);
      EXPECT_FALSE(arm.is_magnet_on);
      EXPECT_EQ(arm.payloads.back().mass_kg, fakeModel().tool.mass_kg);
    }
  }
  // A force that is silent keeps nothing from being let go.
  PickRequest request = scene().pick;
  request.lets_go = false;
  Picker silent(request);
  silent.runTo("lift_a_little", 0.06);
  silent.executor.stop({ArmStatus::kCancelled, "test"});
  expectEnds(silent, ArmStatus::kCancelled, 5.0);
  silent.is_force_silent = true;
  silent.finished_count = 0;
  silent.executor.letGo();
  expectEnds(silent, ArmStatus::kSuccess, 10.0);
}

TEST(ExecutorLetGo, OnceTheMagnetIsOffAStopChangesNothing) {
  PickRequest request = scene().pick;
  request.lets_go = false;
  Picker arm(request);
  expectEnds(arm, ArmStatus::kSuccess, 30.0);
  arm.finished_count = 0;
  arm.executor.letGo();
  arm.step();
  arm.executor.stop({ArmStatus::kCancelled, "test"});
  expectEnds(arm, ArmStatus::kSuccess, 5.0);
  EXPECT_FALSE(arm.executor.isHolding());
  EXPECT_EQ(arm.payloads.back().mass_kg, fakeModel().tool.mass_kg);
}

// ------------------------------------------------------------------------------------------------------------ recover

TEST(ExecutorRecover, BringsTheArmBackAndTellsHow) {
  FakeArm arm(quick(), scene().over_rad);
  arm.gate.arm.safety_mode = safety_mode::kProtectiveStop;
  arm.gate.arm.is_program_running = false;
  arm.step();
  RecoveryPermit permit;
  permit.unlock_protective_stop = true;
  arm.executor.recover(permit);
  arm.step();
  EXPECT_EQ(arm.executor.phase(), ExecutorPhase::kRecovering);
  expectEnds(arm, ArmStatus::kSuccess, 5.0);
  EXPECT_THAT(arm.finished->recovery_commands, ElementsAre("dashboard/unlock_protective_stop", "dashboard/play"));
  EXPECT_EQ(arm.calls.front(), "cancel");
}

TEST(ExecutorRecover, TellsOfABrickThatTheStopHasCost) {
  for (const bool is_lost : {false, true}) {
    SCOPED_TRACE(is_lost);
    PickRequest request = scene().pick;
    request.lets_go = false;
    Picker arm(request);
    arm.runTo("stow", 0.1);
    arm.gate.arm.safety_mode = safety_mode::kProtectiveStop;
    expectEnds(arm, ArmStatus::kProtectiveStop, 5.0);
    ASSERT_TRUE(arm.executor.isHolding());
    if (is_lost) arm.has_brick = false;
    arm.finished_count = 0;
    RecoveryPermit permit;
    permit.unlock_protective_stop = true;
    arm.executor.recover(permit);
    expectEnds(arm, is_lost ? ArmStatus::kLostOnTheWay : ArmStatus::kSuccess, 15.0);
    EXPECT_THAT(arm.finished->recovery_commands, Contains("dashboard/unlock_protective_stop"));
    EXPECT_EQ(arm.executor.isHolding(), !is_lost);
    EXPECT_EQ(arm.is_attached, !is_lost);
    EXPECT_EQ(arm.is_magnet_on, !is_lost);
    EXPECT_EQ(arm.payloads.back().mass_kg == fakeModel().tool.mass_kg, is_lost);
  }
}

TEST(ExecutorRecover, NotWithoutTheOperatorNorWithoutTheDashboard) {
  FakeArm arm(quick(), scene().over_rad);
  arm.gate.arm.safety_mode = safety_mode::kProtectiveStop;
  arm.step();
  arm.executor.recover({});
  expectEnds(arm, ArmStatus::kProtectiveStop, 5.0);

  for (const Answer answer : {Answer::kGone, Answer::kNever}) {
    FakeArm silent(quick(), scene().over_rad);
    silent.manners["dashboard/play"].answer = answer;
    silent.gate.arm.is_program_running = false;
    silent.step();
    silent.executor.recover({});
    expectEnds(silent, ArmStatus::kDriverGone, 5.0);
  }
  FakeArm stopped(quick(), scene().over_rad);
  stopped.gate.arm.safety_mode = safety_mode::kRobotEmergencyStop;
  stopped.step();
  stopped.executor.recover({});
  stopped.step();
  stopped.executor.stop({ArmStatus::kCancelled, "test"});
  expectEnds(stopped, ArmStatus::kCancelled, 1.0);
}

TEST(ExecutorConfig, EveryProblemIsNamed) {
  ExecutorConfig config;
  config.motion.stop_s = 0.0;
  config.pick.ramp_s = -1.0;
  config.gripper.io_timeout_s = 0.0;
  EXPECT_THAT(interactive_mapping::problemsOf(config),
              ElementsAre(HasSubstr("motion/stop_s = 0 s"), HasSubstr("pick/ramp_s = -1 s"),
                          HasSubstr("gripper/io_timeout_s = 0 s")));
  EXPECT_THROW(Executor(config, fakeModel()), std::invalid_argument);
  EXPECT_THROW(Executor(ExecutorConfig(), ArmModel()), std::invalid_argument);
}

}  // namespace
}  // namespace ur_driver_bridge
