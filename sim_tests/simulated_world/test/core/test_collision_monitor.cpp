// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/collision_monitor.h"

#include <stdexcept>

#include <gtest/gtest.h>

#include "observation_builder.h"

namespace simulated_world {
namespace {

class CollisionMonitorTest : public testing::Test {
 protected:
  CollisionMonitorTest() : monitor(CollisionConfig()) {
    world.add(1, {0.0, 0.0, 0.05});
    world.add(2, {1.0, 0.0, 0.05});
  }

  int collisionsOf(const std::string& robot_body, const std::string& other_body) {
    world.touch(robot_body, other_body);
    CollisionMonitor fresh{CollisionConfig()};
    world.hold(fresh, 0.1);
    return fresh.collisions();
  }

  ObservedWorld world;
  CollisionMonitor monitor;
};

TEST_F(CollisionMonitorTest, WheelsMayTouchTheGroundAndNothingElse) {
  EXPECT_EQ(collisionsOf("wheel_front_left_link", "ground"), 0);
  EXPECT_EQ(collisionsOf("wheel_front_right_link", "ground"), 0);
  EXPECT_EQ(collisionsOf("wheel_front_left_link", brickBodyName(1)), 1);
  EXPECT_EQ(collisionsOf("base_link", "ground"), 1);
}

TEST_F(CollisionMonitorTest, NothingOfTheRobotMayTouchAnObstacle) {
  for (const char* body : {"wheel_front_left_link", "base_link", "magnet", "container"}) {
    EXPECT_EQ(collisionsOf(body, obstacleBodyName(0)), 1) << body;
  }
}

TEST_F(CollisionMonitorTest, TheToolMayTouchTheTargetById) {
  EXPECT_EQ(collisionsOf("magnet", brickBodyName(1)), 1);
  world.now.target_id = 1;
  EXPECT_EQ(collisionsOf("magnet", brickBodyName(1)), 0);
  EXPECT_EQ(collisionsOf("magnet", brickBodyName(2)), 1);
  EXPECT_EQ(collisionsOf("forearm", brickBodyName(1)), 1);
  EXPECT_EQ(collisionsOf("magnet", "ground"), 1);
}

TEST_F(CollisionMonitorTest, TheToolMayTouchWhatItHoldsOrHasReleased) {
  world.brick(1).status = BrickStatus::kHeld;
  EXPECT_EQ(collisionsOf("magnet", brickBodyName(1)), 0);
  world.brick(1).status = BrickStatus::kReleased;
  EXPECT_EQ(collisionsOf("magnet", brickBodyName(1)), 0);
  world.brick(1).status = BrickStatus::kDropped;
  EXPECT_EQ(collisionsOf("magnet", brickBodyName(1)), 1);
}

TEST_F(CollisionMonitorTest, TheContainerMayTouchCarriedBricksButNotThePile) {
  for (const BrickStatus status :
       {BrickStatus::kHeld, BrickStatus::kReleased, BrickStatus::kStowed, BrickStatus::kDropped}) {
    world.brick(1).status = status;
    EXPECT_EQ(collisionsOf("container", brickBodyName(1)), 0);
  }
  EXPECT_EQ(collisionsOf("container", brickBodyName(2)), 1);
  EXPECT_EQ(collisionsOf("container", "ground"), 1);
}

TEST_F(CollisionMonitorTest, WhatTheLoadTouchesIsCountedApart) {
  for (const char* other : {"brick_2", "ground", "wall_0"}) {
    world.now.contacts = {{"brick_1", other, 30.0, true}};
    CollisionMonitor fresh{CollisionConfig()};
    const auto begin = world.hold(fresh, 0.2);
    world.now.contacts.clear();
    const auto end = world.hold(fresh, 1.0);
    EXPECT_EQ(fresh.collisions(), 0) << other;
    EXPECT_EQ(fresh.loadContacts(), 1) << other;
    EXPECT_EQ(fresh.maxForce(), 0.0) << "of collisions alone";
    ASSERT_EQ(begin.size(), 1U);
    EXPECT_EQ(begin[0].kind, JudgeEventKind::kLoadContact);
    ASSERT_EQ(end.size(), 1U);
    EXPECT_EQ(end[0].kind, JudgeEventKind::kLoadContactEnd);
    EXPECT_EQ(end[0].max_force_N, 30.0);
    EXPECT_NEAR(end[0].duration_s, 0.15, 1e-9);  // observed every 0.05 s
  }
}

TEST_F(CollisionMonitorTest, UnknownBodiesCount) {
  EXPECT_EQ(collisionsOf("forearm", "wall"), 1);
  EXPECT_EQ(collisionsOf("magnet", "brick_99"), 1);
  EXPECT_EQ(collisionsOf("forearm", "base_link"), 1);
}

TEST_F(CollisionMonitorTest, AnEpisodeCountsOnceWithItsLargestForceAndItsDuration) {
  world.now.contacts = {{"forearm", "brick_1", 5.0}};
  world.hold(monitor, 1.0);
  world.now.contacts = {{"forearm", "brick_1", 80.0}};
  world.hold(monitor, 0.05);
  world.now.contacts.clear();
  EXPECT_TRUE(world.hold(monitor, 0.4).empty());  // shorter than the gap
  world.now.contacts = {{"forearm", "brick_1", 7.0}};
  EXPECT_TRUE(world.hold(monitor, 0.5).empty());
  world.now.contacts.clear();
  const auto events = world.hold(monitor, 1.0);
  EXPECT_EQ(monitor.collisions(), 1);
  ASSERT_EQ(events.size(), 1U);
  EXPECT_EQ(events[0].kind, JudgeEventKind::kCollisionEnd);
  EXPECT_EQ(events[0].robot_body, "forearm");
  EXPECT_EQ(events[0].other_body, "brick_1");
  EXPECT_EQ(events[0].max_force_N, 80.0);
  EXPECT_NEAR(events[0].duration_s, 1.9, 1e-9);  // from 0.05 s to 1.95 s
  EXPECT_EQ(monitor.maxForce(), 80.0);
}

TEST_F(CollisionMonitorTest, ContactAfterTheGapIsAnotherCollision) {
  for (int i = 0; i < 3; ++i) {
    world.touch("forearm", "brick_1");
    world.hold(monitor, 0.2);
    world.now.contacts.clear();
    world.hold(monitor, 0.6);
  }
  EXPECT_EQ(monitor.collisions(), 3);
}

TEST_F(CollisionMonitorTest, PairsAreCountedApartAndFinishEndsThem) {
  world.now.contacts = {{"forearm", "brick_1", 1.0}, {"forearm", "brick_2", 2.0}, {"wrist", "brick_1", 3.0}};
  EXPECT_EQ(world.hold(monitor, 0.2).size(), 3U);
  EXPECT_EQ(monitor.finish().size(), 3U);
  EXPECT_TRUE(monitor.finish().empty());
  EXPECT_EQ(monitor.collisions(), 3);
}

TEST(CollisionMonitor, RefusesAnImpossibleConfig) {
  CollisionConfig config;
  config.end_gap_s = 0.0;
  config.tool_body.clear();
  EXPECT_EQ(config.validate().size(), 2U);
  EXPECT_THROW(CollisionMonitor{config}, std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
