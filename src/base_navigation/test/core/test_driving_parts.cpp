// SPDX-License-Identifier: BSD-3-Clause
// The parts of BaseNavigator, each alone.
#include <cmath>

#include <gmock/gmock.h>

#include "driving/arrival.h"
#include "driving/base_stop_input.h"
#include "driving/drive_data.h"
#include "driving/path_drive.h"
#include "driving/plan_attempts.h"
#include "driving/stuck_detector.h"

namespace base_navigation {
namespace {

using ::testing::HasSubstr;

const MotionLimits kLimits{0.8, 0.1, 0.6, 0.2, 0.6, 1.0};

TEST(Arrival, AveragesPosesOfDifferentStamps) {
  Arrival arrival;
  arrival.start(10.0);
  EXPECT_FALSE(arrival.add(10.1, 10.1, {1.0, 0.0, M_PI - 0.1}));
  EXPECT_FALSE(arrival.add(10.2, 10.1, {9.0, 9.0, 1.0}));  // the same pose, carried on by odometry
  const auto mean = arrival.add(10.4, 10.4, {3.0, 2.0, -M_PI + 0.1});
  ASSERT_TRUE(mean);
  EXPECT_DOUBLE_EQ(mean->x_m, 2.0);
  EXPECT_DOUBLE_EQ(mean->y_m, 1.0);
  EXPECT_NEAR(std::abs(mean->yaw_rad), M_PI, 1e-12);
}

TEST(Arrival, NeedsAPoseThatCameAfterTheStart) {
  Arrival arrival;
  arrival.start(10.0);
  ASSERT_TRUE(arrival.add(11.0, 10.5, {}));
  arrival.start(12.0);
  EXPECT_FALSE(arrival.add(13.0, 10.5, {}));
  EXPECT_TRUE(arrival.add(13.0, 12.5, {}));
}

/// A base at rest, all sources fresh at `now_s`.
NavigationInput freshInput(double now_s) {
  NavigationInput input;
  input.now_s = input.pose_stamp_s = input.odometry_stamp_s = input.scan_stamp_s = input.grid_stamp_s = now_s;
  input.scan = std::make_shared<Scan>();
  input.grid = std::make_shared<NavigationGrid>();
  return input;
}

TEST(DriveData, ReportsTheFirstSourceThatIsStale) {
  const BaseNavigatorConfig config;
  DriveData data(config, kLimits);
  EXPECT_EQ(data.stale(1.0)->status, NavigationStatus::kStaleOdometry);
  data.take(freshInput(1.0));
  EXPECT_FALSE(data.stale(1.0));
  NavigationInput next = freshInput(1.45);
  next.scan_stamp_s = 1.0;
  data.take(next);
  const auto stale = data.stale(1.45);
  ASSERT_TRUE(stale);
  EXPECT_EQ(stale->status, NavigationStatus::kStaleScan);
  EXPECT_EQ(stale->message, "the scan is 0.45 s old, may be 0.40 s");
  next.scan_problem = "a scan without ranges";
  next.now_s = 1.46;
  data.take(next);
  EXPECT_EQ(data.stale(1.46)->status, NavigationStatus::kBadInput);
  EXPECT_EQ(data.stale(1.46)->message, "a scan without ranges");
}

TEST(DriveData, TellsJumpsOfLocalisationFromMotion) {
  const BaseNavigatorConfig config;
  DriveData data(config, kLimits);
  data.take(freshInput(1.0));
  NavigationInput next = freshInput(1.1);
  next.T_odom_base = next.T_map_base = {0.08, 0.0, 0.0};
  data.take(next);
  EXPECT_FALSE(data.has_jumped);
  next = freshInput(1.2);
  next.T_odom_base = {0.16, 0.0, 0.0};
  next.T_map_base = {0.16, 0.3, 0.0};
  next.scan_stamp_s = 1.15;
  data.take(next);
  EXPECT_TRUE(data.has_jumped);
  EXPECT_THAT(data.jump, HasSubstr("the localisation has jumped by 0.30 m"));
  EXPECT_TRUE(data.isScanFromBeforeJump());
}

TEST(DriveData, TakesTheMotionSinceTheScanFromOdometry) {
  const BaseNavigatorConfig config;
  DriveData data(config, kLimits);
  for (int i = 0; i <= 4; ++i) {
    NavigationInput input = freshInput(1.0 + 0.1 * i);
    input.T_odom_base = input.T_map_base = {0.05 * i, 0.0, 0.0};
    input.scan_stamp_s = 1.15;
    if (i < 2) input.scan.reset();
    data.take(input);
  }
  EXPECT_NEAR(data.motionSinceScan().x_m, 0.2 - 0.075, 1e-12);
}

TEST(StuckDetector, FindsWheelsThatSlip) {
  const BaseNavigatorConfig config;
  StuckDetector detector(config);
  DriveData data(config, kLimits);
  for (int i = 0; i <= 200; ++i) {
    data.T_odom_base.x_m = 0.02 * 0.2 * i;
    data.T_map_base_at_pose.x_m = 0.1 * data.T_odom_base.x_m;
    detector.add(10.0 + 0.02 * i, 0.02, {0.2, 0.0}, data);
  }
  EXPECT_THAT(detector.find(14.0, config.stuck_s), HasSubstr("the wheels slip: commanded to move"));
  detector.reset();
  EXPECT_EQ(detector.find(14.0, 0.0), "");
}

TEST(StuckDetector, FindsNothingWhereAFifthIsMeasured) {
  const BaseNavigatorConfig config;
  StuckDetector detector(config);
  DriveData data(config, kLimits);
  for (int i = 0; i <= 200; ++i) {
    data.T_odom_base.x_m = data.T_map_base_at_pose.x_m = 0.25 * 0.02 * 0.2 * i;
    detector.add(10.0 + 0.02 * i, 0.02, {0.2, 0.0}, data);
  }
  EXPECT_EQ(detector.find(14.0, config.stuck_s), "");
}

TEST(BaseStopInput, EndsTheNextGoalOnce) {
  BaseStopInput stop;
  stop.take(BaseStop::kNone);
  stop.take(BaseStop::kButton);
  stop.take(BaseStop::kNone);
  EXPECT_FALSE(stop.isActive());
  EXPECT_TRUE(stop.endsGoal());
  EXPECT_THAT(stop.words(), HasSubstr("before this goal (its emergency button is pressed)"));
  stop.goalHasEnded();
  EXPECT_FALSE(stop.endsGoal());
}

TEST(BaseStopInput, ScannerAndFirstReportEndNothing) {
  BaseStopInput stop;
  stop.take(BaseStop::kButton);  // at the start
  stop.take(BaseStop::kNone);
  stop.take(BaseStop::kScanner);
  EXPECT_TRUE(stop.isActive());
  EXPECT_FALSE(stop.endsGoal());
}

BasePlan failedPlan() {
  BasePlan plan;
  plan.status = BasePlanStatus::kGoalOccupied;
  plan.message = "the goal is occupied";
  return plan;
}

TEST(PlanAttempts, FirstFailureEndsTheGoal) {
  const BaseNavigatorConfig config;
  PlanAttempts attempts(config);
  attempts.start();
  ASSERT_FALSE(attempts.begin());
  const auto end = attempts.fail(failedPlan(), 10.0);
  ASSERT_TRUE(end);
  EXPECT_EQ(end->status, NavigationStatus::kGoalOccupied);
  EXPECT_EQ(end->message, "the goal is occupied");
}

TEST(PlanAttempts, WaitsOnceBeforeAReplanEndsTheGoal) {
  const BaseNavigatorConfig config;
  PlanAttempts attempts(config);
  attempts.start();
  ASSERT_FALSE(attempts.begin());
  attempts.succeed();
  attempts.request("an obstacle", true);
  EXPECT_FALSE(attempts.waiting(10.0));
  ASSERT_FALSE(attempts.begin());
  ASSERT_FALSE(attempts.fail(failedPlan(), 10.0));
  const auto reason = attempts.waiting(10.0 + 0.9 * config.blocked_patience_s);
  ASSERT_TRUE(reason);
  EXPECT_EQ(*reason, "an obstacle; replanning: the goal is occupied");
  EXPECT_FALSE(attempts.waiting(10.0 + config.blocked_patience_s));
  ASSERT_FALSE(attempts.begin());
  const auto end = attempts.fail(failedPlan(), 14.0);
  ASSERT_TRUE(end);
  EXPECT_EQ(end->status, NavigationStatus::kObstacle);
}

TEST(PlanAttempts, EndsAtTheMostPlans) {
  BaseNavigatorConfig config;
  config.max_plans = 2;
  PlanAttempts attempts(config);
  attempts.start();
  EXPECT_FALSE(attempts.begin());
  EXPECT_FALSE(attempts.begin());
  attempts.request("the way is blocked", false);
  const auto end = attempts.begin();
  ASSERT_TRUE(end);
  EXPECT_EQ(end->status, NavigationStatus::kTooManyPlans);
  EXPECT_EQ(end->message, "planned 2 times, may be 2: the way is blocked");
  EXPECT_EQ(attempts.count(), 2);
}

/// The commanded speed after braking for `num_steps` from 0.2 m/s.
double speedAfterBraking(bool is_hard, int num_steps) {
  const BaseNavigatorConfig config;
  DriveData data(config, kLimits);
  data.take(freshInput(10.0));
  PathDrive drive({}, kLimits);
  BasePath path;
  path.motions.push_back({2.0, 0.0});
  drive.setTime(10.0, 0.02);
  drive.start(path);
  while (drive.command().linear_m_s < 0.2) {
    data.T_map_base.x_m += 0.02 * drive.command().linear_m_s;
    drive.follow(data.T_map_base, 1.0);
  }
  drive.setHard(is_hard);
  for (int i = 0; i < num_steps; ++i) drive.brake(data);
  EXPECT_EQ(drive.isOffPath(), is_hard);
  return drive.command().linear_m_s;
}

TEST(PathDrive, BrakesHarderOnRequestAndLeavesThePath) {
  EXPECT_LT(speedAfterBraking(true, 5), speedAfterBraking(false, 5));
}

TEST(PathDrive, MeasuresBrakingTimeFromCommandedZero) {
  const BaseNavigatorConfig config;
  DriveData data(config, kLimits);
  PathDrive drive({}, kLimits);
  NavigationInput input = freshInput(10.0);
  input.odometry_twist = {0.3, 0.0};
  data.take(input);
  drive.setTime(10.0, 0.02);
  EXPECT_FALSE(drive.comeToStand(data)) << "commanded zero, and moves by odometry";
  drive.setTime(10.1, 0.1);
  EXPECT_FALSE(drive.comeToStand(data));
  EXPECT_NEAR(drive.brakingTime(), 0.1, 1e-12);
  data.take(freshInput(10.1));
  EXPECT_TRUE(drive.comeToStand(data));
  EXPECT_EQ(drive.brakingTime(), 0.0);
}

}  // namespace
}  // namespace base_navigation
