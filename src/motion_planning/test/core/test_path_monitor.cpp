// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/path_monitor.h"

#include <chrono>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>

#include "kinematics/arm_reach.h"
#include "support/exact_motion.h"
#include "support/pick_world.h"

namespace motion_planning {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

ArmVector reaching(double pan_rad) {
  ArmVector q;
  q << pan_rad, -1.2, 1.2, -0.5 * M_PI, -0.5 * M_PI, 0.0;
  return q;
}

/// The arm reaches out and swings from right to left.
JointTrajectory swing() {
  MotionLimits limits;
  return timeParametrize({reaching(-1.0), reaching(1.0)}, limits);
}

PickWorld worldWith(const std::vector<OrientedBox>& boxes) {
  PickWorld pick = emptyPickWorld();
  pick.world.boxes = boxes;
  pick.makeScene();
  return pick;
}

/// A plate that stands in the tip's way at this angle of the pan joint.
OrientedBox plateAt(double pan_rad, double thickness_m) {
  const PickWorld pick = emptyPickWorld();
  OrientedBox box;
  const Eigen::Isometry3d T_base_tip = shippedArm()->tipPose(reaching(pan_rad));
  box.T_map_box = pick.T_map_base * Eigen::Translation3d(T_base_tip.translation()) *
                  Eigen::AngleAxisd(pan_rad, Eigen::Vector3d::UnitZ());
  box.size_m = {0.3, thickness_m, 0.3};
  return box;
}

CollisionChecker checkerOf(const PickWorld& pick) {
  return {shippedArm(), pick.scene, pick.T_map_base};
}

PathMonitor monitorOf(const JointTrajectory& trajectory, const PathMonitorConfig& config = {}) {
  PathMonitor monitor(config);
  monitor.start(trajectory, shippedArm());
  return monitor;
}

TEST(PathMonitor, LetsAFreeMotionPass) {
  const PickWorld pick = worldWith({});
  const CollisionChecker checker = checkerOf(pick);
  PathMonitor monitor = monitorOf(swing());
  for (const double elapsed_s : {-1.0, 0.0, 1.0, swing().duration(), 100.0}) {
    const PathVerdict verdict = monitor.check(elapsed_s, checker);
    EXPECT_FALSE(verdict.must_stop) << verdict.reason;
    EXPECT_THAT(verdict.reason, IsEmpty());
    EXPECT_EQ(verdict.time_to_contact_s, std::numeric_limits<double>::infinity());
    EXPECT_GT(verdict.clearance_m, 0.0);
  }
}

TEST(PathMonitor, StopsBeforeWhatHasComeIntoTheWay) {
  const PickWorld pick = worldWith({plateAt(0.5, 0.1)});
  const CollisionChecker checker = checkerOf(pick);
  const JointTrajectory trajectory = swing();
  // When the checker first objects, looked for every millisecond.
  double first_s = 0.0;
  while (checker.isFree(trajectory.sample(first_s).position_rad)) first_s += 1e-3;
  for (const double elapsed_s : {0.0, 0.5 * first_s}) {
    PathMonitor monitor = monitorOf(trajectory);
    const PathVerdict verdict = monitor.check(elapsed_s, checker);
    EXPECT_TRUE(verdict.must_stop);
    EXPECT_TRUE(verdict.contact);
    EXPECT_THAT(verdict.reason, HasSubstr(verdict.contact.describe()));
    // It is found at the next sample.
    EXPECT_GE(verdict.time_to_contact_s, first_s - elapsed_s - 1e-3);
    EXPECT_LE(verdict.time_to_contact_s, first_s - elapsed_s + PathMonitorConfig().sample_s);
  }
}

TEST(PathMonitor, SeesAThinPlateAtFullSpeed) {
  // The fastest that the arm moves: by sample_s alone the tip would go 8 cm between samples.
  MotionLimits limits;
  limits.velocity_rad_s.setConstant(M_PI);
  limits.acceleration_rad_s2.setConstant(30.0);
  const JointTrajectory trajectory = timeParametrize({reaching(-1.0), reaching(1.0)}, limits);
  for (int n = 0; n < 20; ++n) {
    const PickWorld pick = worldWith({plateAt(-0.3 + 0.03 * n, 0.01)});
    const CollisionChecker checker = checkerOf(pick);
    PathMonitor monitor = monitorOf(trajectory);
    EXPECT_TRUE(monitor.check(0.0, checker).must_stop) << n;
  }
}

TEST(PathMonitor, WhatIsBehindDoesNotMatter) {
  const PickWorld pick = worldWith({plateAt(-0.5, 0.1)});
  const CollisionChecker checker = checkerOf(pick);
  const JointTrajectory trajectory = swing();
  PathMonitor monitor = monitorOf(trajectory);
  EXPECT_FALSE(monitor.check(0.75 * trajectory.duration(), checker).must_stop);
  EXPECT_TRUE(monitor.check(0.0, checker).must_stop);
}

TEST(PathMonitor, LooksNoFartherThanItsHorizon) {
  const PickWorld pick = worldWith({plateAt(0.9, 0.05)});
  const CollisionChecker checker = checkerOf(pick);
  PathMonitorConfig config;
  config.horizon_s = 0.3;
  PathMonitor monitor = monitorOf(swing(), config);
  EXPECT_FALSE(monitor.check(0.0, checker).must_stop);
  EXPECT_TRUE(monitor.check(swing().duration() - 0.3, checker).must_stop);
}

TEST(PathMonitor, StopsUntilStartedAgain) {
  const PickWorld blocked = worldWith({plateAt(0.5, 0.1)});
  const PickWorld free = worldWith({});
  PathMonitor monitor = monitorOf(swing());
  EXPECT_FALSE(monitor.check(0.0, checkerOf(free)).must_stop);
  const PathVerdict stop = monitor.check(0.1, checkerOf(blocked));
  ASSERT_TRUE(stop.must_stop);
  const PathVerdict later = monitor.check(0.2, checkerOf(free));
  EXPECT_TRUE(later.must_stop);
  EXPECT_EQ(later.reason, stop.reason);
  monitor.start(swing(), shippedArm());
  EXPECT_FALSE(monitor.check(0.3, checkerOf(free)).must_stop);
}

TEST(PathMonitor, TellsTheSmallestClearanceAhead) {
  // A box below the swing, that the tip passes over.
  const Eigen::Vector3d tip_base = shippedArm()->tipPose(reaching(0.2)).translation();
  PickWorld pick = emptyPickWorld();
  OrientedBox box;
  box.T_map_box = pick.T_map_base * Eigen::Translation3d(tip_base - Eigen::Vector3d(0.0, 0.0, 0.08 + 0.1));
  box.size_m = {0.1, 0.1, 0.2};
  pick = worldWith({box});
  const CollisionChecker checker = checkerOf(pick);
  const JointTrajectory trajectory = swing();
  const double half_s = 0.3 * trajectory.duration();
  for (const double elapsed_s : {0.0, half_s, 0.9 * trajectory.duration()}) {
    double exact_m = kMaxClearance_m;
    for (double t = elapsed_s; t < trajectory.duration(); t += 0.01) {
      exact_m = std::min(exact_m, checker.clearance(trajectory.sample(t).position_rad, kMaxClearance_m));
    }
    PathMonitor monitor = monitorOf(trajectory);
    const PathVerdict verdict = monitor.check(elapsed_s, checker);
    EXPECT_FALSE(verdict.must_stop) << verdict.reason;
    EXPECT_GE(verdict.clearance_m, exact_m - 1e-3);  // 0.01 s of motion between the looks of this test
    EXPECT_LE(verdict.clearance_m, exact_m + PathMonitorConfig().clearance_step_m);
  }
}

TEST(PathMonitor, StopsBelowTheClearanceAskedFor) {
  const Eigen::Vector3d tip_base = shippedArm()->tipPose(reaching(0.2)).translation();
  PickWorld pick = emptyPickWorld();
  OrientedBox box;
  box.T_map_box = pick.T_map_base * Eigen::Translation3d(tip_base - Eigen::Vector3d(0.0, 0.0, 0.08 + 0.1));
  box.size_m = {0.1, 0.1, 0.2};
  pick = worldWith({box});
  PathMonitorConfig config;
  config.stop_clearance_m = 0.15;
  PathMonitor monitor = monitorOf(swing(), config);
  const PathVerdict verdict = monitor.check(0.0, checkerOf(pick));
  EXPECT_TRUE(verdict.must_stop);
  EXPECT_FALSE(verdict.contact);
  EXPECT_THAT(verdict.reason, HasSubstr("allowed are 0.15 m"));
  EXPECT_GT(verdict.time_to_contact_s, 0.0);
  EXPECT_LT(verdict.time_to_contact_s, swing().duration());
}

TEST(PathMonitor, FirstPosturesReachBeyondWhereOthersAre) {
  const ArmKinematics& arm = *shippedArm();
  const JointTrajectory trajectory = swing();
  const std::vector<ArmVector> first = firstPostures(arm, trajectory);
  const auto wayTo = [&](const ArmVector& q) {
    return (arm.tipPose(q).translation() - arm.tipPose(first.front()).translation()).norm();
  };
  EXPECT_EQ(first.front(), trajectory.points.front().position_rad);
  ASSERT_GT(first.size(), 2U);
  EXPECT_GT(wayTo(first.back()), kAmongOthers_m);
  EXPECT_LE(wayTo(first[first.size() - 2]), kAmongOthers_m);
  JointTrajectory standing = trajectory;
  standing.points.resize(1);
  EXPECT_THAT(firstPostures(arm, standing), SizeIs(1));
  EXPECT_THROW(firstPostures(arm, {}), std::invalid_argument);
}

// What is planned with a leave for the place where a brick hangs, and without it from there on, is watched so.
TEST(PathMonitor, MayBeWhatEitherCheckerAllows) {
  const PickWorld pick = worldWith({plateAt(-0.6, 0.1), plateAt(0.5, 0.1)});
  const PickWorld without_first = worldWith({plateAt(0.5, 0.1)});
  const PickWorld without_second = worldWith({plateAt(-0.6, 0.1)});
  const CollisionChecker all = checkerOf(pick), first_allowed = checkerOf(without_first),
                         second_allowed = checkerOf(without_second);
  EXPECT_TRUE(monitorOf(swing()).check(0.0, all, &first_allowed).must_stop);
  const PathVerdict verdict = monitorOf(swing()).check(0.0, first_allowed, &second_allowed);
  EXPECT_FALSE(verdict.must_stop) << verdict.reason;
  EXPECT_GT(verdict.clearance_m, 0.0);
}

TEST(PathMonitor, RefusesWhatItCannotDo) {
  PathMonitor monitor{PathMonitorConfig()};
  const PickWorld pick = worldWith({});
  EXPECT_THROW(monitor.check(0.0, checkerOf(pick)), std::logic_error);
  EXPECT_THROW(monitor.start({}, shippedArm()), std::invalid_argument);
  monitor.start(swing(), shippedArm());
  EXPECT_THROW(monitor.check(std::numeric_limits<double>::quiet_NaN(), checkerOf(pick)), std::invalid_argument);
  monitor.stop();
  EXPECT_THROW(monitor.check(0.0, checkerOf(pick)), std::logic_error);
  PathMonitorConfig config;
  config.sample_s = 0.0;
  EXPECT_THROW(PathMonitor{config}, std::invalid_argument);
}

TEST(ArmReach, NoPointMovesFartherThanReachSays) {
  const ArmKinematics& arm = *shippedArm();
  const PickWorld pick = emptyPickWorld();
  const HeldBrick held{Eigen::Isometry3d(Eigen::Translation3d(0.05, 0.02, 0.1)), {0.3, 0.2, 0.2}};
  std::mt19937_64 rng(5);
  std::uniform_real_distribution<double> angle(-3.0, 3.0);
  for (const bool is_holding : {false, true}) {
    ExactMotion motion(arm, pick, 0.05);
    if (is_holding) motion.setHeld(held);
    const ArmVector reach_m = armReach(arm, is_holding ? std::optional<HeldBrick>(held) : std::nullopt);
    ArmVector used = ArmVector::Zero();
    for (int n = 0; n < 300; ++n) {
      const ArmVector q = ArmVector::NullaryExpr([&] { return angle(rng); });
      const auto before = motion.points(q);
      for (int joint = 0; joint < 6; ++joint) {
        ArmVector moved = q;
        moved[joint] += 1e-4;
        const auto after = motion.points(moved);
        for (std::size_t i = 0; i < before.size(); ++i) {
          used[joint] = std::max(used[joint], (after[i] - before[i]).norm() / 1e-4);
        }
      }
    }
    for (int joint = 0; joint < 6; ++joint) {
      EXPECT_LE(used[joint], reach_m[joint] + 1e-6) << joint;
      // Not needlessly long. Wrist 3 turns what lies about its own axis: the bound counts the tool's length too.
      if (joint == 5) continue;
      EXPECT_GE(used[joint], 0.5 * reach_m[joint]) << joint;
    }
  }
}

}  // namespace
}  // namespace motion_planning
