// SPDX-License-Identifier: BSD-3-Clause
// The stages of BasePlanner, each alone.
#include "planning/stages.h"

#include <cmath>

#include <gmock/gmock.h>

#include "support/grids.h"
#include "support/pile_scene.h"

namespace base_navigation {
namespace {

using ::testing::HasSubstr;

/// The robot in the middle of a hall of 8 m, its goal 2 m ahead.
struct Hall {
  NavigationGrid grid{makeGrid(160, 160, SpaceState::kFree)};
  BasePlannerConfig config;
  std::function<bool()> is_cancelled;

  PlanTask task() const {
    return {config,          kBaseLimits,     kBaseFootprint, std::make_shared<NavigationGrid>(grid),
            {4.0, 4.0, 0.0}, {6.0, 4.0, 0.0}, is_cancelled};
  }
};

TEST(FindApproach, IsAsLongAsAllowedWhereAllIsFree) {
  const Hall hall;
  const PlanTask task = hall.task();
  const auto approach = findApproach(task);
  ASSERT_TRUE(approach);
  EXPECT_DOUBLE_EQ(approach->length_m, hall.config.approach_m);
  EXPECT_NEAR(approach->pose_map.x_m, 6.0 - hall.config.approach_m, 1e-12);
}

TEST(FindApproach, SaysWhatIsInTheWay) {
  Hall hall;
  // Behind the footprint at the goal, which ends at 5.473 m.
  fillRectangle(&hall.grid, 5.35, 3.9, 5.44, 4.1, SpaceState::kOccupied);
  const PlanTask task = hall.task();
  const auto approach = findApproach(task);
  ASSERT_FALSE(approach);
  EXPECT_EQ(approach.failure().status, BasePlanStatus::kNoApproach);
  EXPECT_THAT(approach.failure().message, HasSubstr("meet occupied ground at"));
}

TEST(FindLaunches, StaysWhereTheBaseCanTurn) {
  const Hall hall;
  const PlanTask task = hall.task();
  const auto launches = findLaunches(task);
  ASSERT_TRUE(launches);
  ASSERT_EQ(launches->size(), 1u);
  EXPECT_EQ(launches->front().length_m, 0.0);
}

TEST(FindLaunches, BacksOffFromAWall) {
  Hall hall;
  // 5 cm before the front: nearer than the padding.
  fillRectangle(&hall.grid, 4.35, 3.0, 4.6, 5.0, SpaceState::kOccupied);
  const PlanTask task = hall.task();
  const auto launches = findLaunches(task);
  ASSERT_TRUE(launches);
  ASSERT_EQ(launches->size(), 1u);
  const Launch& launch = launches->front();
  EXPECT_LT(launch.length_m, 0.0);
  EXPECT_GT(launch.tight_m, 0.0);
  EXPECT_TRUE(task.roomy.canTurnAt(launch.pose_map));
}

TEST(FindLaunches, FailsBetweenWalls) {
  Hall hall;
  fillRectangle(&hall.grid, 4.35, 3.0, 4.6, 5.0, SpaceState::kOccupied);
  fillRectangle(&hall.grid, 3.2, 3.0, 3.44, 5.0, SpaceState::kOccupied);
  const PlanTask task = hall.task();
  const auto launches = findLaunches(task);
  ASSERT_FALSE(launches);
  EXPECT_EQ(launches.failure().status, BasePlanStatus::kStartOccupied);
}

TEST(Connections, AllEndWhereTheyShould) {
  const Connections connections(0.35);
  const Pose2d from{0.0, 0.0, 0.0};
  for (const Pose2d& to : {Pose2d{2.0, 1.0, 1.0}, Pose2d{-1.0, 0.2, -2.0}, Pose2d{0.1, 0.0, M_PI}}) {
    const std::vector<Motions> all = connections.between(from, to);
    EXPECT_GE(all.size(), 3u);
    for (const Motions& motions : all) {
      EXPECT_LE(away_m(follow(from, motions), to), kSamePlace);
      EXPECT_LE(away_rad(follow(from, motions), to), kSamePlace);
    }
  }
}

TEST(Shorten, ReplacesADetour) {
  const Hall hall;
  const PlanTask task = hall.task();
  const auto approach = findApproach(task);
  ASSERT_TRUE(approach);
  const Launch launch{0.0, 0.0, task.start_map};
  const Connections connections(hall.config.turn_radius_m);
  // 1.6 m straight on, as three sides of a rectangle.
  const Motions detour = {{0.0, M_PI / 2},  {1.0, 0.0}, {0.0, -M_PI / 2}, {1.6, 0.0},
                          {0.0, -M_PI / 2}, {1.0, 0.0}, {0.0, M_PI / 2}};
  ASSERT_LT(away_m(follow(task.start_map, detour), approach->pose_map), 1e-9);
  interactive_mapping::Random random(1);
  const Motions shorter = shorten(task, connections, launch, *approach, detour, &random);
  const Candidate candidate = assemble(task, launch, *approach, shorter);
  EXPECT_NEAR(candidate.path.length(), 2.0, 1e-6);
  EXPECT_TRUE(isWholeFree(task, candidate));
}

TEST(PlanTask, NothingIsFreeOnceCancelled) {
  Hall hall;
  hall.is_cancelled = [] { return true; };
  const PlanTask task = hall.task();
  EXPECT_FALSE(task.isFree(task.start_map));
  EXPECT_FALSE(task.isFree(task.start_map, {{0.5, 0.0}}));
}

TEST(BestPath, KeepsTheFastestThatStandsTheCheck) {
  const Hall hall;
  const PlanTask task = hall.task();
  BestPath best(task);
  Candidate straight;
  straight.path = {task.start_map, {{2.0, 0.0}}};
  straight.cost_s = 5.0;
  EXPECT_TRUE(best.offer(straight));
  Candidate astray = straight;
  astray.path.motions = {{1.9, 0.0}};
  astray.cost_s = 1.0;
  EXPECT_FALSE(best.offer(astray));
  ASSERT_TRUE(best.best());
  EXPECT_EQ(best.best()->cost_s, 5.0);
}

}  // namespace
}  // namespace base_navigation
