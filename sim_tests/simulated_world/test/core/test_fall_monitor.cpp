// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/fall_monitor.h"

#include <stdexcept>

#include <gtest/gtest.h>

#include "observation_builder.h"

namespace simulated_world {
namespace {

const Eigen::Vector3d kX = Eigen::Vector3d::UnitX();
const Eigen::Vector3d kY = Eigen::Vector3d::UnitY();
const Eigen::Vector3d kZ = Eigen::Vector3d::UnitZ();

class FallMonitorTest : public testing::Test {
 protected:
  FallMonitorTest() : monitor(FallConfig()) {
    world.add(1, {0.0, 0.0, 0.05});
    world.add(2, {1.0, 0.0, 0.05});
    world.hold(monitor, 1.0);
  }

  ObservedWorld world;
  FallMonitor monitor;
};

TEST(TiltBetween, IsTheLeanOfWhatWasUpWhateverTheYaw) {
  const auto rotation = [](double angle_rad, const Eigen::Vector3d& axis) {
    return Eigen::AngleAxisd(angle_rad, axis).toRotationMatrix();
  };
  const Eigen::Matrix3d standing = rotation(0.7, kZ) * rotation(1.3, kX);  // no axis of the brick points up
  for (const double yaw_rad : {0.0, 1.0, 3.0}) {
    for (const double lean_rad : {0.0, 0.1, 1.0, 3.1}) {
      const Eigen::Matrix3d now = rotation(yaw_rad, kZ) * rotation(lean_rad, kY) * standing;
      EXPECT_NEAR(tiltBetween(standing, now), lean_rad, 1e-12);  // rounding
    }
  }
}

TEST_F(FallMonitorTest, AStandingPileHasNoFalls) {
  world.hold(monitor, 10.0);
  EXPECT_EQ(monitor.falls(), 0);
  EXPECT_EQ(monitor.drops(), 0);
}

TEST_F(FallMonitorTest, MoreThanFiveCentimetresIsAFallAndLessIsNone) {
  world.brick(1).T_map_brick.translation().x() = 0.049;
  world.hold(monitor, 1.0);
  EXPECT_EQ(monitor.falls(), 0);
  world.brick(1).T_map_brick.translation().x() = 0.051;
  const auto events = world.hold(monitor, 0.05);
  ASSERT_EQ(events.size(), 1U);
  EXPECT_EQ(events[0].kind, JudgeEventKind::kFall);
  EXPECT_EQ(events[0].brick_id, 1);
  EXPECT_NEAR(events[0].distance_m, 0.051, 1e-12);
}

TEST_F(FallMonitorTest, MoreThanFifteenDegreesIsAFallAndLessIsNone) {
  world.turn(1, kY, 14.9 * kDegree);
  world.hold(monitor, 1.0);
  EXPECT_EQ(monitor.falls(), 0);
  world.turn(1, kY, 15.1 * kDegree);
  world.hold(monitor, 0.05);
  EXPECT_EQ(monitor.falls(), 1);
}

TEST_F(FallMonitorTest, TurningAboutTheVerticalIsNoFall) {
  for (double yaw_rad = 0.0; yaw_rad < 3.0; yaw_rad += 0.1) {
    world.turn(1, kZ, yaw_rad);
    world.hold(monitor, 0.05);
  }
  EXPECT_EQ(monitor.falls(), 0);
}

TEST_F(FallMonitorTest, ABrickThatRollsFarIsOneFallWithItsWholeWay) {
  for (int i = 1; i <= 40; ++i) {
    world.brick(1).T_map_brick.translation().x() = 0.05 * i;
    world.turn(1, kY, 0.2 * i);
    world.hold(monitor, 0.05);
  }
  EXPECT_EQ(monitor.falls(), 1);
  const auto events = world.hold(monitor, 1.0);
  ASSERT_EQ(events.size(), 1U);
  EXPECT_EQ(events[0].kind, JudgeEventKind::kFallEnd);
  EXPECT_NEAR(events[0].distance_m, 2.0, 1e-12);
  EXPECT_EQ(monitor.falls(), 1);
}

TEST_F(FallMonitorTest, ARockingBrickIsNotAtRestWhenItPassesItsOldPose) {
  world.brick(1).T_map_brick.translation().x() = 0.2;
  world.hold(monitor, 0.05);
  // Back at the same pose every window, which two poses a window apart would call rest.
  for (int i = 0; i < 40; ++i) {
    world.turn(1, kY, i % 10 < 5 ? 0.0 : 30.0 * kDegree);
    world.hold(monitor, 0.05);
    EXPECT_FALSE(monitor.isAtRest(1)) << i;
  }
  EXPECT_EQ(monitor.falls(), 1);
}

TEST_F(FallMonitorTest, DisturbedAgainAfterRestIsASecondFall) {
  world.brick(1).T_map_brick.translation().x() = 0.2;
  world.hold(monitor, 1.0);
  EXPECT_EQ(monitor.falls(), 1);
  world.brick(1).T_map_brick.translation().x() = 0.24;  // 4 cm from where it lies now, 24 cm from its first place
  world.hold(monitor, 1.0);
  EXPECT_EQ(monitor.falls(), 1);
  world.brick(1).T_map_brick.translation().x() = 0.26;
  world.hold(monitor, 1.0);
  EXPECT_EQ(monitor.falls(), 2);
}

TEST_F(FallMonitorTest, CreepingAddsUp) {
  for (int i = 1; i <= 6; ++i) {
    world.brick(1).T_map_brick.translation().x() = 0.01 * i;
    world.hold(monitor, 2.0);  // at rest in between
  }
  EXPECT_EQ(monitor.falls(), 1);
}

TEST_F(FallMonitorTest, HandledBricksDoNotFall) {
  for (const BrickStatus status :
       {BrickStatus::kHeld, BrickStatus::kReleased, BrickStatus::kStowed, BrickStatus::kMovedByHand}) {
    world.brick(1).status = status;
    world.brick(1).T_map_brick.translation().x() += 1.0;
    world.turn(1, kY, 1.0);
    world.hold(monitor, 1.0);
    EXPECT_FALSE(monitor.isAtRest(1));
  }
  EXPECT_EQ(monitor.falls(), 0);
  EXPECT_EQ(monitor.drops(), 0);
}

TEST_F(FallMonitorTest, WhatSomebodyPutElsewhereIsWatchedFromItsNextRestOn) {
  world.brick(1).status = BrickStatus::kMovedByHand;
  world.brick(1).T_map_brick.translation().x() = 0.5;
  world.hold(monitor, 0.1);
  world.brick(1).status = BrickStatus::kInPile;
  world.brick(1).T_map_brick.translation().x() = 0.6;  // slides on a little
  world.hold(monitor, 1.0);
  EXPECT_EQ(monitor.falls(), 0);
  world.brick(1).T_map_brick.translation().x() = 0.66;
  world.hold(monitor, 1.0);
  EXPECT_EQ(monitor.falls(), 1);
}

TEST_F(FallMonitorTest, ADroppedBrickIsADropAndWhatItHitsFalls) {
  world.brick(1).status = BrickStatus::kHeld;
  world.brick(1).T_map_brick.translation() = Eigen::Vector3d(1.0, 0.0, 0.6);
  world.hold(monitor, 1.0);
  world.brick(1).status = BrickStatus::kDropped;
  for (int i = 0; i < 5; ++i) {
    world.brick(1).T_map_brick.translation().z() -= 0.09;
    world.hold(monitor, 0.05);
  }
  world.brick(2).T_map_brick.translation().y() = 0.1;
  world.hold(monitor, 2.0);
  EXPECT_EQ(monitor.drops(), 1);
  EXPECT_EQ(monitor.falls(), 1);

  // It lies where it fell and can fall from there.
  world.brick(1).T_map_brick.translation().z() = 0.05;
  world.hold(monitor, 1.0);
  EXPECT_EQ(monitor.drops(), 1);
  EXPECT_EQ(monitor.falls(), 2);

  // Picked again and dropped again.
  world.brick(1).status = BrickStatus::kHeld;
  world.hold(monitor, 1.0);
  world.brick(1).status = BrickStatus::kDropped;
  world.hold(monitor, 1.0);
  EXPECT_EQ(monitor.drops(), 2);
}

TEST_F(FallMonitorTest, TheTargetMayBePulledByTheToolAndNothingElseMay) {
  for (const bool is_target : {false, true}) {
    for (const std::string tool : {"forearm", "magnet"}) {
      ObservedWorld other = world;
      FallMonitor fresh = monitor;
      other.now.target_id = is_target ? 1 : 2;
      other.touch(tool, brickBodyName(1));
      for (int i = 1; i <= 10; ++i) {
        other.brick(1).T_map_brick.translation().x() = 0.02 * i;
        other.hold(fresh, 0.05);
      }
      EXPECT_EQ(fresh.falls(), is_target && tool == "magnet" ? 0 : 1) << is_target << " " << tool;
    }
  }
}

TEST_F(FallMonitorTest, ATargetThatFallsWhileTheToolIsElsewhereFalls) {
  world.now.target_id = 1;
  world.touch("magnet", brickBodyName(2));
  world.brick(1).T_map_brick.translation().x() = 0.3;
  world.hold(monitor, 0.1);
  EXPECT_EQ(monitor.falls(), 1);
}

TEST_F(FallMonitorTest, ATargetThatSlipsOffTheToolFalls) {
  world.now.target_id = 1;
  world.touch("magnet", brickBodyName(1));
  world.brick(1).T_map_brick.translation().x() = 0.3;
  world.hold(monitor, 0.1);
  world.now.contacts.clear();
  world.brick(1).T_map_brick.translation().x() = 0.34;
  world.hold(monitor, 0.1);
  EXPECT_EQ(monitor.falls(), 0);  // 4 cm from where the tool left it
  world.brick(1).T_map_brick.translation().x() = 0.36;
  world.hold(monitor, 0.1);
  EXPECT_EQ(monitor.falls(), 1);
}

TEST(FallMonitor, RefusesAnImpossibleConfigWithAllReasons) {
  FallConfig config;
  config.fall_distance_m = 0.0;
  config.rest_window_s = -1.0;
  EXPECT_EQ(config.validate().size(), 2U);
  EXPECT_THROW(FallMonitor{config}, std::invalid_argument);
  EXPECT_TRUE(FallConfig().validate().empty());
}

}  // namespace
}  // namespace simulated_world
