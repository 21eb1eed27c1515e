// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/trajectory_follower.h"

#include <cmath>
#include <limits>
#include <stdexcept>

#include <gtest/gtest.h>

#include "arm_plant.h"

namespace simulated_world {
namespace {

constexpr double kDt_s = 0.002;

class TrajectoryFollowerTest : public testing::Test {
 public:
  TrajectoryFollowerTest() { step(); }

  /// One cycle; keeps the results and checks that the setpoint never jumps.
  void step(double scaling = 1.0) {
    now_s += kDt_s;
    const Eigen::VectorXd before = follower.desired().position_rad;
    const JointMotion& setpoint = follower.update(now_s, kDt_s, scaling, plant.position_rad, plant.velocity_rad_s);
    // 3 rad/s is the faster joint's limit, 1.9 the peak over the mean speed of a quintic from rest to rest.
    EXPECT_LT((setpoint.position_rad - before).cwiseAbs().maxCoeff(), 1.9 * 3.0 * kDt_s) << now_s;
    plant.follow(setpoint, kDt_s);
    for (const GoalResult& result : follower.takeResults()) {
      results.push_back(result);
    }
  }

  void run(double duration_s, double scaling = 1.0) {
    for (const double end_s = now_s + duration_s - 0.5 * kDt_s; now_s < end_s;) {
      step(scaling);
    }
  }

  /// Time until the next goal ends; infinity: not within the limit.
  double timeToResult(double limit_s, double scaling = 1.0) {
    const double start_s = now_s;
    const std::size_t before = results.size();
    while (results.size() == before) {
      if (now_s - start_s > limit_s) return std::numeric_limits<double>::infinity();
      step(scaling);
    }
    return now_s - start_s;
  }

  void accept(const TrajectoryGoal& goal) {
    const GoalAnswer answer = follower.acceptGoal(goal, now_s);
    ASSERT_TRUE(answer.accepted) << answer.text;
  }

  TrajectoryFollower follower{twoJoints(), {}};
  ArmPlant plant;
  double now_s = 100.0;
  std::vector<GoalResult> results;
};

TEST_F(TrajectoryFollowerTest, ReachesTheGoalOnTime) {
  accept(goTo("a", 1.0, -0.5, 1.0));
  EXPECT_EQ(follower.activeGoal(), "a");
  EXPECT_NEAR(timeToResult(3.0), 1.0, 2.0 * kDt_s);  // the end falls into a cycle
  ASSERT_EQ(results.size(), 1u);
  EXPECT_EQ(results[0].goal_id, "a");
  EXPECT_EQ(results[0].outcome, GoalOutcome::kSucceeded);
  EXPECT_EQ(results[0].error, GoalError::kSuccessful);
  EXPECT_NEAR((plant.position_rad - Eigen::Vector2d(1.0, -0.5)).norm(), 0.0, 1e-9);  // rounding
  EXPECT_FALSE(follower.activeGoal());
  run(0.5);
  EXPECT_NEAR((plant.position_rad - Eigen::Vector2d(1.0, -0.5)).norm(), 0.0, 1e-9) << "held";
}

TEST_F(TrajectoryFollowerTest, PassesEveryPointAtItsTime) {
  TrajectoryGoal goal = goTo("a", 0.2, -0.1, 0.5);
  goal.points[0].velocities_rad_s = {0.3, 0.1};
  goal.points.push_back({{0.5, 0.1}, {0.2, 0.0}, {}, 1.0});
  goal.points.push_back({{0.4, 0.3}, {}, {}, 1.6});
  accept(goal);
  double last_s = 0.0;
  for (const TrajectoryPoint& point : goal.points) {
    run(point.time_from_start_s - last_s);
    last_s = point.time_from_start_s;
    // Half a cycle's rounding of the clock at less than 1 rad/s.
    EXPECT_NEAR(follower.desired().position_rad[0], point.positions_rad[0], 1e-3) << last_s;
    EXPECT_NEAR(follower.desired().position_rad[1], point.positions_rad[1], 1e-3) << last_s;
  }
}

TEST_F(TrajectoryFollowerTest, HalfTheSpeedTakesTwiceTheTimeOnTheSamePath) {
  accept(goTo("a", 1.0, -0.5, 1.0));
  TrajectoryFollower full(twoJoints(), {});
  full.update(now_s, kDt_s, 1.0, plant.position_rad, plant.velocity_rad_s);
  ASSERT_TRUE(full.acceptGoal(goTo("a", 1.0, -0.5, 1.0), now_s).accepted);
  ArmPlant other;
  for (int i = 0; i < 400; ++i) {
    step(0.5);
    step(0.5);
    other.follow(full.update(now_s, kDt_s, 1.0, other.position_rad, other.velocity_rad_s), kDt_s);
    EXPECT_NEAR((plant.position_rad - other.position_rad).norm(), 0.0, 1e-9);  // rounding of the summed time
    EXPECT_NEAR((2.0 * plant.velocity_rad_s - other.velocity_rad_s).norm(), 0.0, 1e-9);
  }
  EXPECT_NEAR(timeToResult(3.0, 0.5), 2.0 - 1.6, 2.0 * kDt_s);
  EXPECT_EQ(results.back().outcome, GoalOutcome::kSucceeded);
}

TEST_F(TrajectoryFollowerTest, WaitsWhileTheSpeedIsZero) {
  accept(goTo("a", 1.0, -0.5, 1.0));
  run(0.5);
  const Eigen::VectorXd middle = plant.position_rad;
  run(10.0, 0.0);
  EXPECT_TRUE(results.empty());
  EXPECT_EQ(plant.position_rad, middle);
  EXPECT_NEAR(timeToResult(3.0), 0.5, 2.0 * kDt_s);
  EXPECT_EQ(results.back().outcome, GoalOutcome::kSucceeded);
}

TEST_F(TrajectoryFollowerTest, AbortsWhenTheArmFallsBehindThePathTolerance) {
  accept(goTo("a", 2.0, 0.0, 2.0));
  plant.is_blocked = true;
  EXPECT_LT(timeToResult(2.0), 1.0);
  ASSERT_EQ(results.size(), 1u);
  EXPECT_EQ(results[0].outcome, GoalOutcome::kAborted);
  EXPECT_EQ(results[0].error, GoalError::kPathToleranceViolated);
  EXPECT_NE(results[0].text.find("joint pan: path position error = 0.20"), std::string::npos) << results[0].text;
  EXPECT_NE(results[0].text.find("[-0.2, 0.2] rad"), std::string::npos) << results[0].text;
  run(0.6);
  EXPECT_EQ(follower.desired().velocity_rad_s.norm(), 0.0) << "stopped";
  EXPECT_LT(follower.desired().position_rad[0], 1.0) << "went on";
}

TEST_F(TrajectoryFollowerTest, ToleratesWhatTheGoalTolerates) {
  TrajectoryGoal goal = goTo("a", 0.15, 0.0, 1.0);
  plant.is_blocked = true;
  goal.path_tolerance = {{"pan", 0.05, 0.0, 0.0}};
  accept(goal);
  timeToResult(2.0);
  EXPECT_EQ(results.back().error, GoalError::kPathToleranceViolated);
  run(1.0);
  TrajectoryGoal easy = goTo("b", 0.5, 0.0, 1.0);
  easy.path_tolerance = {{"pan", -1.0, 0.0, 0.0}};
  easy.goal_tolerance = {{"pan", -1.0, -1.0, 0.0}};
  accept(easy);
  timeToResult(2.0);
  EXPECT_EQ(results.back().outcome, GoalOutcome::kSucceeded) << results.back().text;
}

TEST_F(TrajectoryFollowerTest, GivesTheArmTimeToArrive) {
  // The arm lags by less than the way, 0.2 rad, and catches up as exp(-t / 0.2 s): 0.02 rad after 0.46 s at the latest.
  plant.time_constant_s = 0.2;
  TrajectoryGoal goal = goTo("a", 0.2, 0.0, 0.4);
  goal.goal_tolerance = {{"pan", 0.02, 0.2, 0.0}};
  accept(goal);
  const double took_s = timeToResult(2.0);
  EXPECT_EQ(results.back().outcome, GoalOutcome::kSucceeded) << results.back().text;
  EXPECT_GT(took_s, 0.4 + 0.05);
  EXPECT_LT(took_s, 0.4 + 0.6);
}

TEST_F(TrajectoryFollowerTest, AbortsWhenTheArmDoesNotArriveInTime) {
  accept(goTo("a", 0.15, 0.0, 0.5));
  plant.is_blocked = true;  // 0.15 rad: within the path's tolerance, not the goal's
  EXPECT_NEAR(timeToResult(3.0), 0.5 + 0.6, 2.0 * kDt_s);
  EXPECT_EQ(results.back().outcome, GoalOutcome::kAborted);
  EXPECT_EQ(results.back().error, GoalError::kGoalToleranceViolated);
  EXPECT_NE(results.back().text.find("joint pan: goal position error = 0.15 rad"), std::string::npos);
}

TEST_F(TrajectoryFollowerTest, GoalTimeIsScaledWithTheSpeed) {
  accept(goTo("a", 0.15, 0.0, 0.5));
  plant.is_blocked = true;
  EXPECT_NEAR(timeToResult(9.0, 0.25), (0.5 + 0.6) / 0.25, 2.0 * kDt_s);
  EXPECT_EQ(results.back().error, GoalError::kGoalToleranceViolated);
}

TEST_F(TrajectoryFollowerTest, TheArmMustStandStillAtTheEnd) {
  TrajectoryGoal goal = goTo("a", 0.1, 0.0, 0.5);
  accept(goal);
  run(0.5 - 2.0 * kDt_s);
  // Shakes within the position tolerance, faster than the stopped velocity tolerance of 0.05 rad/s.
  for (int i = 0; i < 400 && results.empty(); ++i) {
    step();
    plant.velocity_rad_s = Eigen::Vector2d(0.06, 0.0);
  }
  ASSERT_EQ(results.size(), 1u);
  EXPECT_EQ(results[0].error, GoalError::kGoalToleranceViolated);
  EXPECT_NE(results[0].text.find("joint pan: goal velocity error = -0.06 rad/s"), std::string::npos) << results[0].text;
}

TEST_F(TrajectoryFollowerTest, ANewGoalReplacesTheOldOneWithoutAJump) {
  accept(goTo("a", 1.0, -0.5, 1.0));
  run(0.5);
  const Eigen::VectorXd velocity = follower.desired().velocity_rad_s;
  accept(goTo("b", 0.0, 0.0, 1.0));
  EXPECT_EQ(follower.activeGoal(), "b");
  step();
  ASSERT_EQ(results.size(), 1u);
  EXPECT_EQ(results[0].goal_id, "a");
  EXPECT_EQ(results[0].outcome, GoalOutcome::kPreempted);
  // One cycle at the quintic's acceleration, of the order of 20 rad/s^2.
  EXPECT_NEAR((follower.desired().velocity_rad_s - velocity).norm(), 0.0, 0.1);
  EXPECT_NEAR(timeToResult(3.0), 1.0, 3.0 * kDt_s);
  EXPECT_EQ(results[1].goal_id, "b");
  EXPECT_EQ(results[1].outcome, GoalOutcome::kSucceeded);
  EXPECT_NEAR(plant.position_rad.norm(), 0.0, 1e-9);
}

TEST_F(TrajectoryFollowerTest, ANewGoalDoesNotChangeTheSpeedAtOnceWhenScaled) {
  accept(goTo("a", 1.0, -0.5, 1.0));
  run(1.0, 0.5);
  const Eigen::VectorXd velocity = follower.desired().velocity_rad_s;
  ASSERT_GT(velocity.norm(), 0.5);
  accept(goTo("b", 0.0, 0.0, 1.0));
  step(0.5);
  EXPECT_NEAR((follower.desired().velocity_rad_s - velocity).norm(), 0.0, 0.1);  // as above
}

TEST_F(TrajectoryFollowerTest, CancellingStopsTheArmSmoothly) {
  accept(goTo("a", 1.0, -0.5, 1.0));
  run(0.5);
  const JointMotion before = follower.desired();
  EXPECT_FALSE(follower.cancelGoal("b"));
  EXPECT_TRUE(follower.cancelGoal("a"));
  EXPECT_FALSE(follower.cancelGoal("a")) << "twice";
  double last = before.velocity_rad_s[0];
  while (follower.desired().velocity_rad_s[0] > 0.0) {
    step();
    // Constant deceleration over the stop's 0.5 s.
    EXPECT_NEAR(last - follower.desired().velocity_rad_s[0], before.velocity_rad_s[0] / 0.5 * kDt_s, 1e-9);
    last = follower.desired().velocity_rad_s[0];
  }
  EXPECT_NEAR(follower.desired().position_rad[0] - before.position_rad[0], 0.5 * 0.5 * before.velocity_rad_s[0], 1e-9);
  ASSERT_EQ(results.size(), 1u);
  EXPECT_EQ(results[0].outcome, GoalOutcome::kCanceled);
  const Eigen::VectorXd held = follower.desired().position_rad;
  run(1.0);
  EXPECT_EQ(follower.desired().position_rad, held);
}

TEST_F(TrajectoryFollowerTest, StopsBeforeALimit) {
  TrajectoryGoal goal = goTo("a", 0.0, 0.99, 1.0);
  goal.points[0].velocities_rad_s = {0.0, 1.0};
  goal.points[0].accelerations_rad_s2.clear();
  goal.points.push_back({{0.0, 1.0}, {}, {}, 1.1});
  accept(goal);
  run(0.996);
  ASSERT_TRUE(follower.cancelGoal("a"));
  run(1.0);
  EXPECT_LE(follower.desired().position_rad[1], 1.0 + 1e-12);  // rounding
}

TEST_F(TrajectoryFollowerTest, HaltingKillsTheGoalAndBrakesFromWhereTheArmIs) {
  plant.time_constant_s = 0.05;
  accept(goTo("a", 1.0, -0.5, 1.0));
  run(0.5);
  const JointMotion before = follower.actual();
  ASSERT_GT(follower.error().position_rad.norm(), 0.05) << "the arm lags behind";
  follower.halt("protective stop");
  now_s += kDt_s;
  follower.update(now_s, kDt_s, 0.0, plant.position_rad, plant.velocity_rad_s);
  // The deceleration of one cycle: half of 4 rad/s^2 times (2 ms)^2.
  EXPECT_NEAR((follower.desired().position_rad - before.position_rad - kDt_s * before.velocity_rad_s).norm(), 0.0,
              1e-5);
  run(1.0, 0.0);
  EXPECT_EQ(follower.desired().velocity_rad_s.norm(), 0.0);
  ASSERT_EQ(results.size(), 1u);
  EXPECT_EQ(results[0].outcome, GoalOutcome::kAborted);
  EXPECT_EQ(results[0].text, "protective stop");
  const Eigen::VectorXd held = follower.desired().position_rad;
  follower.restart();
  run(2.0);
  EXPECT_NEAR((follower.desired().position_rad - held).norm(), 0.0, 1e-6) << "the old trajectory came back to life";
}

TEST_F(TrajectoryFollowerTest, ATrajectoryThatBeginsElsewhereIsAbortedAtOnce) {
  TrajectoryGoal goal = goTo("a", 1.0, 0.0, 1.0);
  goal.points.insert(goal.points.begin(), TrajectoryPoint{{0.5, 0.0}, {}, {}, 0.0});
  accept(goal);
  step();
  ASSERT_EQ(results.size(), 1u);
  EXPECT_EQ(results[0].error, GoalError::kPathToleranceViolated);
  EXPECT_NE(results[0].text.find("joint pan: position at the start, error = 0.5 rad"), std::string::npos)
      << results[0].text;
  EXPECT_EQ(plant.position_rad.norm(), 0.0);
}

TEST_F(TrajectoryFollowerTest, ATrajectoryThatBeginsNearIsJoined) {
  TrajectoryGoal goal = goTo("a", 1.0, 0.0, 1.0);
  goal.points.insert(goal.points.begin(), TrajectoryPoint{{0.1, 0.0}, {0.0, 0.0}, {}, 0.0});
  accept(goal);
  timeToResult(2.0);
  EXPECT_EQ(results.back().outcome, GoalOutcome::kSucceeded) << results.back().text;
}

TEST_F(TrajectoryFollowerTest, RefusesAWayToTheFirstPointThatIsTooFast) {
  const GoalAnswer answer = follower.acceptGoal(goTo("a", 0.0, 0.5, 0.25), now_s);
  EXPECT_FALSE(answer.accepted);
  EXPECT_EQ(answer.error, GoalError::kInvalidGoal);
  EXPECT_NE(answer.text.find("path to point 0: joint lift: mean speed from 0 to 0.5 rad within 0.25 s = 2 rad/s"),
            std::string::npos)
      << answer.text;
  EXPECT_FALSE(follower.activeGoal());
}

TEST_F(TrajectoryFollowerTest, RefusesATrajectoryOfThePast) {
  TrajectoryGoal goal = goTo("a", 0.1, 0.0, 1.0);
  goal.start_s = now_s - 1.5;
  const GoalAnswer answer = follower.acceptGoal(goal, now_s);
  EXPECT_FALSE(answer.accepted);
  EXPECT_EQ(answer.error, GoalError::kOldHeaderTimestamp);
  EXPECT_NE(answer.text.find("was due 0.5 s ago"), std::string::npos) << answer.text;
}

TEST_F(TrajectoryFollowerTest, JoinsATrajectoryThatHasBegun) {
  TrajectoryGoal goal = goTo("a", 0.0, 0.0, 0.5);
  goal.points.push_back({{1.0, 0.0}, {0.0, 0.0}, {0.0, 0.0}, 1.5});
  goal.start_s = now_s - 0.5;
  accept(goal);
  EXPECT_NEAR(timeToResult(3.0), 1.0, 2.0 * kDt_s);
  EXPECT_EQ(results.back().outcome, GoalOutcome::kSucceeded);
}

TEST_F(TrajectoryFollowerTest, StandsStillUntilTheStart) {
  TrajectoryGoal goal = goTo("a", 0.5, 0.0, 1.0);
  goal.start_s = now_s + 1.0;
  accept(goal);
  run(0.99);
  EXPECT_EQ(plant.position_rad.norm(), 0.0);
  EXPECT_EQ(follower.activeGoal(), "a");
  EXPECT_NEAR(timeToResult(3.0), 1.01, 2.0 * kDt_s);
  EXPECT_EQ(results.back().outcome, GoalOutcome::kSucceeded);
}

TEST_F(TrajectoryFollowerTest, AWaitingGoalCanBeCancelled) {
  TrajectoryGoal goal = goTo("a", 0.5, 0.0, 1.0);
  goal.start_s = now_s + 1.0;
  accept(goal);
  EXPECT_TRUE(follower.cancelGoal("a"));
  run(3.0);
  EXPECT_EQ(plant.position_rad.norm(), 0.0);
  ASSERT_EQ(results.size(), 1u);
  EXPECT_EQ(results[0].outcome, GoalOutcome::kCanceled);
}

TEST_F(TrajectoryFollowerTest, AnEmptyTrajectoryStopsTheArm) {
  accept(goTo("a", 1.0, -0.5, 1.0));
  run(0.5);
  TrajectoryGoal nothing;
  nothing.id = "b";
  nothing.joint_names = {"pan", "lift"};
  accept(nothing);
  step();
  EXPECT_NEAR(timeToResult(2.0), 0.5, 2.0 * kDt_s);
  ASSERT_EQ(results.size(), 2u);
  EXPECT_EQ(results[0].outcome, GoalOutcome::kPreempted);
  EXPECT_EQ(results[1].outcome, GoalOutcome::kSucceeded);
  EXPECT_EQ(plant.velocity_rad_s.norm(), 0.0);
}

TEST_F(TrajectoryFollowerTest, ReportsDesiredMinusActual) {
  accept(goTo("a", 0.15, 0.0, 0.5));
  plant.is_blocked = true;
  run(0.7);
  EXPECT_NEAR(follower.error().position_rad[0], 0.15, 1e-9);  // rounding
  EXPECT_NEAR(follower.trajectoryTime(), 0.7, 1e-9);
}

TEST(TrajectoryFollower, AcceptsNothingBeforeItKnowsTheArm) {
  TrajectoryFollower follower(twoJoints(), {});
  const GoalAnswer answer = follower.acceptGoal(goTo("a", 0.0, 0.0, 1.0), 0.0);
  EXPECT_FALSE(answer.accepted);
  EXPECT_EQ(answer.text, "Can't accept new action goals. Controller is not running.");
}

TEST(TrajectoryFollower, RefusesImpossibleJointsAndMeasurements) {
  EXPECT_THROW(TrajectoryFollower({}, {}), std::invalid_argument);
  EXPECT_THROW(TrajectoryFollower({{"pan", 1.0, -1.0, 1.0, 1.0}}, {}), std::invalid_argument);
  TrajectoryFollower follower(twoJoints(), {});
  const Eigen::Vector2d zero = Eigen::Vector2d::Zero();
  EXPECT_THROW(follower.update(0.0, 0.0, 1.0, zero, zero), std::invalid_argument);
  EXPECT_THROW(follower.update(0.0, 0.1, 1.1, zero, zero), std::invalid_argument);
  EXPECT_THROW(follower.update(0.0, 0.1, 1.0, Eigen::Vector3d::Zero(), zero), std::invalid_argument);
  EXPECT_THROW(follower.update(0.0, 0.1, 1.0, zero, Eigen::Vector2d(NAN, 0.0)), std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
