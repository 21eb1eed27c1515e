// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/judge.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <gtest/gtest.h>

#include "observation_builder.h"

namespace simulated_world {
namespace {

const Eigen::Vector3d kSize_m(0.3, 0.15, 0.1);
const double kTop_m2 = 0.3 * 0.15;
const double kSides_m2 = 2.0 * (0.3 * 0.1 + 0.15 * 0.1);

/// The top of the brick at a given place, as a mesh.
StrategySurface topOf(const Eigen::Vector3d& center_m, double stamp_s) {
  StrategySurface surface;
  surface.stamp_s = stamp_s;
  const Eigen::Vector3d u(0.15, 0.0, 0.0);
  const Eigen::Vector3d v(0.0, 0.075, 0.0);
  const Eigen::Vector3d top = center_m + Eigen::Vector3d(0.0, 0.0, 0.05);
  surface.points_map = {top - u - v, top + u - v, top + u + v, top - u + v};
  surface.triangles = {{0, 1, 2}, {0, 2, 3}};
  return surface;
}

class JudgeTest : public testing::Test {
 protected:
  JudgeTest() : judge(JudgeConfig()) {
    world.add(1, {0.0, 0.0, 0.05});
    world.add(2, {0.0, 0.0, 0.15});
    world.add(3, {1.0, 0.0, 0.05});
  }

  void hold(double duration_s) {
    for (int i = 0; i < static_cast<int>(duration_s / 0.1 + 0.5); ++i) {
      world.now.time_s += 0.1;
      judge.observe(world.now);
    }
  }

  void take(int id) {
    world.brick(id).status = BrickStatus::kHeld;
    world.brick(id).T_map_brick.translation().z() += 0.5;
    hold(1.0);
    world.brick(id).status = BrickStatus::kStowed;
    hold(1.0);
  }

  JudgeReport report() const { return judge.report(); }

  ObservedWorld world;
  Judge judge;
};

TEST_F(JudgeTest, CountsABrickAsStowedOnce) {
  hold(1.0);
  EXPECT_EQ(report().bricks_total, 3);
  EXPECT_EQ(report().totals.stowed, 0);
  take(2);
  EXPECT_EQ(report().totals.stowed, 1);
  world.now.bricks.erase(world.now.bricks.begin() + 1);  // gone from the world
  hold(1.0);
  EXPECT_EQ(report().totals.stowed, 1);
  take(1);
  EXPECT_EQ(report().totals.stowed, 2);
  EXPECT_EQ(std::count_if(judge.events().begin(), judge.events().end(),
                          [](const JudgeEvent& event) { return event.kind == JudgeEventKind::kStow; }),
            2);
  EXPECT_EQ(report().totals.falls, 0);
  EXPECT_EQ(report().totals.drops, 0);
}

TEST_F(JudgeTest, BrickThatWasBroughtBackIsNotStowed) {
  hold(1.0);
  take(2);
  world.brick(2).status = BrickStatus::kMovedByHand;
  hold(1.0);
  EXPECT_EQ(report().totals.stowed, 0);
  take(2);
  EXPECT_EQ(report().totals.stowed, 1);
  EXPECT_EQ(report().totals.falls, 0);
}

TEST_F(JudgeTest, AddsUpHowFarBricksWereMovedThatTheToolDidNotTouch) {
  hold(1.0);
  world.now.target_id = 2;
  world.brick(2).T_map_brick.translation().x() += 0.02;  // by the touch
  world.brick(1).T_map_brick.translation().y() += 0.03;
  hold(1.0);
  EXPECT_NEAR(report().totals.disturbance_m, 0.03, 1e-12);
  world.now.target_id.reset();
  take(2);
  world.brick(3).T_map_brick.translation().x() -= 0.04;
  hold(1.0);
  EXPECT_NEAR(report().totals.disturbance_m, 0.07, 1e-12);
  world.brick(1).T_map_brick.translation().y() -= 0.01;  // back by a part
  hold(1.0);
  take(1);
  EXPECT_NEAR(report().totals.disturbance_m, 0.06, 1e-12) << "what was moved before it was picked still counts";
  world.brick(3).status = BrickStatus::kMovedByHand;
  world.brick(3).T_map_brick.translation().x() += 1.0;
  hold(1.0);
  world.brick(3).status = BrickStatus::kInPile;
  hold(1.0);
  EXPECT_NEAR(report().totals.disturbance_m, 0.02, 1e-12) << "by a person";
}

TEST_F(JudgeTest, AddsUpTheBasesWayAndNotItsTremor) {
  hold(0.5);
  for (int i = 0; i < 200; ++i) {
    world.now.base_xy_m.x() = i % 2 == 0 ? 0.002 : 0.0;
    hold(0.1);
  }
  EXPECT_EQ(report().totals.distance_m, 0.0);
  // A quarter of a circle in steps of 2 mm, and back on the chord.
  for (int i = 0; i <= 785; ++i) {
    world.now.base_xy_m = Eigen::Vector2d(std::sin(0.002 * i), 1.0 - std::cos(0.002 * i));
    hold(0.1);
  }
  world.now.base_xy_m.setZero();
  hold(0.1);
  // The last piece shorter than a step is not counted, and the arc is measured by chords of up to 6 mm.
  EXPECT_NEAR(report().totals.distance_m, 1.570 + std::sqrt(2.0), 0.011);
}

TEST_F(JudgeTest, ExposedAreaIsWhatCanBeSeen) {
  hold(0.1);
  // 2 stands on 1, 3 is alone: two tops and three times the sides.
  EXPECT_NEAR(report().exposed_area_m2, 2.0 * kTop_m2 + 3.0 * kSides_m2, 1e-12);
  EXPECT_EQ(report().totals.coverage, 0.0);
  take(2);
  EXPECT_NEAR(report().exposed_area_m2, 3.0 * kTop_m2 + 3.0 * kSides_m2, 1e-12);
}

TEST_F(JudgeTest, AllThatIsExposedOfBricksApartIsCoverable) {
  hold(0.1);
  EXPECT_NEAR(report().coverable_area_m2, report().exposed_area_m2, 1e-12);
}

TEST(JudgeLookouts, DepthOfACleftIsExposedAndNotCoverable) {
  // Two rows of bricks, long faces 2 cm apart: from above one looks down between them, from a camera 3 m away not so
  // deep.
  ObservedWorld world;
  JudgeConfig config;
  config.lookouts.clearance_m = 3.0;
  config.lookouts.margin_m = 4.0;
  Judge judge(config);
  for (int i = 0; i < 5; ++i) {
    world.add(2 * i, {0.3 * i, 0.0, 0.05});
    world.add(2 * i + 1, {0.3 * i, 0.17, 0.05});
  }
  world.now.time_s += 0.1;
  judge.observe(world.now);
  const JudgeReport before = judge.report();
  const double deep_m2 = before.exposed_area_m2 - before.coverable_area_m2;
  // Of ten faces of 0.3 m, 2 to 6 of 10 cm: 80 degrees onto a face at least, 24 degrees above the ground at most 5 cm of
  // the cleft's depth, straight from above nearly all of it.
  EXPECT_GT(deep_m2, 10.0 * 0.3 * 0.02);
  EXPECT_LT(deep_m2, 10.0 * 0.3 * 0.06);
  // With one row taken away the other's faces stand open: coverable is what ever was.
  for (int i = 0; i < 5; ++i) world.brick(2 * i + 1).status = BrickStatus::kStowed;
  for (int i = 0; i < 20; ++i) {
    world.now.time_s += 0.1;
    judge.observe(world.now);
  }
  const JudgeReport after = judge.report();
  // Half of the deep faces; the grid does not lie evenly about the two rows.
  EXPECT_NEAR(after.exposed_area_m2 - after.coverable_area_m2, 0.5 * deep_m2, 0.1 * deep_m2);
}

TEST(JudgeLookouts, NobodyStandsOnTheBricks) {
  // No place is free within the grid: nobody sees anything.
  ObservedWorld world;
  JudgeConfig config;
  config.lookouts.clearance_m = 20.0;
  Judge judge(config);
  world.add(1, {0.0, 0.0, 0.05});
  world.now.time_s += 0.1;
  judge.observe(world.now);
  EXPECT_GT(judge.report().exposed_area_m2, 0.1);
  EXPECT_EQ(judge.report().coverable_area_m2, 0.0);
}

TEST_F(JudgeTest, CoverageIsTheShareOfTheAreaNearTheSurface) {
  hold(0.1);
  EXPECT_EQ(judge.judgeSurface(topOf({0.0, 0.0, 0.15}, 0.1)), SurfaceVerdict::kJudged);
  // The top, and of the sides the uppermost of five rows of samples: 1 cm below the edge, the next being at 3 cm.
  EXPECT_NEAR(report().covered_area_m2, kTop_m2 + kSides_m2 / 5.0, 1e-12);
  EXPECT_NEAR(report().totals.coverage.value(), report().covered_area_m2 / report().coverable_area_m2, 1e-12);
  const double before = report().covered_area_m2;
  judge.judgeSurface(topOf({0.0, 0.0, 0.15}, 0.1));
  EXPECT_EQ(report().covered_area_m2, before);        // nothing counts twice
  judge.judgeSurface(topOf({0.0, 0.0, 0.175}, 0.1));  // 2.5 cm over the top
  EXPECT_EQ(report().covered_area_m2, before);
}

TEST_F(JudgeTest, WhatIsHiddenCannotBeCovered) {
  hold(0.1);
  judge.judgeSurface(topOf({0.0, 0.0, 0.05}, 0.1));  // between the bricks: guessed, or left over
  // Rows of samples of the sides 1 cm above and below the joint.
  const double rows_m2 = 2.0 * kSides_m2 / 5.0;
  EXPECT_NEAR(report().covered_area_m2, rows_m2, 1e-12);
  take(2);
  EXPECT_NEAR(report().covered_area_m2, rows_m2, 1e-12);  // the surface shown then is not judged again now
  judge.judgeSurface(topOf({0.0, 0.0, 0.05}, world.now.time_s));
  EXPECT_NEAR(report().covered_area_m2, rows_m2 + kTop_m2, 1e-12);
}

TEST_F(JudgeTest, WhatWasCoveredStaysCoveredWhenTheBrickGoes) {
  hold(0.1);
  judge.judgeSurface(topOf({0.0, 0.0, 0.15}, 0.1));
  const double covered_m2 = report().covered_area_m2;
  take(2);
  EXPECT_EQ(report().covered_area_m2, covered_m2);
  EXPECT_NEAR(report().exposed_area_m2, 3.0 * kTop_m2 + 3.0 * kSides_m2, 1e-12);
}

TEST_F(JudgeTest, ASurfaceIsJudgedByTheTruthAtItsStamp) {
  hold(1.0);
  const double early_s = world.now.time_s;
  take(2);
  judge.judgeSurface(topOf({0.0, 0.0, 0.15}, early_s));  // brick 2's top, which is no longer there
  EXPECT_EQ(report().totals.precision, 1.0);
  EXPECT_NEAR(report().covered_area_m2, kTop_m2 + kSides_m2 / 5.0, 1e-12);
  judge.judgeSurface(topOf({0.0, 0.0, 0.15}, world.now.time_s));
  EXPECT_EQ(report().totals.precision, 0.0);
  EXPECT_NEAR(report().covered_area_m2, kTop_m2 + kSides_m2 / 5.0, 1e-12);
}

TEST_F(JudgeTest, WhatLiesOnAnObstacleIsNeitherRightNorWrongWhileItStands) {
  const auto precisionAt = [this](double stamp_s) {
    // The top of brick 2, and as much of the obstacle's.
    StrategySurface surface = topOf({0.0, 0.0, 0.15}, stamp_s);
    const StrategySurface other = topOf({-0.4, 0.0, kObstacleHeight_m - 0.05}, stamp_s);
    surface.points_map.insert(surface.points_map.end(), other.points_map.begin(), other.points_map.end());
    surface.triangles.push_back({4, 5, 6});
    surface.triangles.push_back({4, 6, 7});
    judge.judgeSurface(surface);
    return report().totals.precision.value();
  };
  hold(1.0);
  EXPECT_NEAR(precisionAt(world.now.time_s), 0.5, 1e-9);
  const double before_s = world.now.time_s;
  world.now.obstacles = {{0, {-0.4, 0.0}}};
  hold(1.0);
  EXPECT_NEAR(precisionAt(world.now.time_s), 1.0, 1e-9);
  EXPECT_NEAR(precisionAt(before_s), 0.5, 1e-9) << "it was not there yet";
  const double during_s = world.now.time_s;
  world.now.obstacles.clear();
  hold(1.0);
  EXPECT_NEAR(precisionAt(world.now.time_s), 0.5, 1e-9) << "a map that keeps who has gone is wrong";
  EXPECT_NEAR(precisionAt(during_s), 1.0, 1e-9);
  world.now.obstacles = {{0, {-0.4, 0.0}}};
  hold(1.0);
  judge.judgeSurface(topOf({-0.4, 0.0, kObstacleHeight_m - 0.15}, world.now.time_s));
  EXPECT_EQ(report().totals.precision, 0.0) << "10 cm inside of it there is no surface";
  world.now.obstacles = {{0, {std::nan(""), 0.0}}};
  world.now.time_s += 0.1;
  EXPECT_THROW(judge.observe(world.now), std::invalid_argument);
}

TEST(JudgeWalls, HideFacesAndAreNeitherRightNorWrong) {
  ObservedWorld world;
  world.add(1, {0.0, 0.0, 0.05});
  world.now.time_s = 0.1;
  Judge open{JudgeConfig()};
  open.observe(world.now);
  JudgeConfig config;
  PileWall wall;
  wall.T_map_wall.translation() = Eigen::Vector3d(0.25, 0.0, 1.0);  // its face touches the brick's, at x = 0.15
  wall.size_m = {0.2, 3.0, 2.0};
  config.pile.walls = {wall};
  Judge judge(config);
  judge.observe(world.now);
  EXPECT_NEAR(judge.report().exposed_area_m2, open.report().exposed_area_m2 - 0.15 * 0.1, 1e-12);
  EXPECT_NEAR(judge.report().coverable_area_m2, judge.report().exposed_area_m2, 1e-12);

  // The brick's top, and a piece of the wall's face, or of what is 10 cm before it.
  const auto precisionWith = [&](Judge& by, double x_m) {
    StrategySurface surface = topOf({0.0, 0.0, 0.05}, 0.1);
    for (const double y : {0.3, 0.4}) {
      for (const double z : {0.3, 0.4}) surface.points_map.emplace_back(x_m, y, z);
    }
    surface.triangles.push_back({4, 5, 6});
    surface.triangles.push_back({5, 7, 6});
    by.judgeSurface(surface);
    return by.report().totals.precision.value();
  };
  EXPECT_EQ(precisionWith(judge, 0.15), 1.0);
  EXPECT_EQ(precisionWith(judge, 0.15 - 0.04), 1.0) << "as far off as the map may have it";
  EXPECT_LT(precisionWith(judge, 0.05), 0.9);
  EXPECT_LT(precisionWith(open, 0.15), 0.9);
}

TEST_F(JudgeTest, TellsHowManyBricksCanBePicked) {
  world.brick(2).is_pickable = false;
  hold(0.1);
  EXPECT_EQ(report().bricks_total, 3);
  EXPECT_EQ(report().bricks_pickable, 2);
}

TEST(JudgeLookouts, CoverageCountsOnlyWhatCanBeSeen) {
  // As above: of the cleft between two rows a camera 3 m away sees the rim alone.
  ObservedWorld world;
  JudgeConfig config;
  config.lookouts.clearance_m = 3.0;
  config.lookouts.margin_m = 4.0;
  Judge judge(config);
  StrategySurface everything;  // a cloud
  for (int i = 0; i < 5; ++i) {
    for (const double y : {0.0, 0.17}) {
      world.add(2 * i + (y > 0.0 ? 1 : 0), {0.3 * i, y, 0.05});
      for (const FaceSample& sample : sampleFaces(kSize_m, 0.01)) {
        everything.points_map.emplace_back(sample.p_brick + Eigen::Vector3d(0.3 * i, y, 0.05));
      }
    }
  }
  world.now.time_s = 0.1;
  judge.observe(world.now);
  ASSERT_LT(judge.report().coverable_area_m2, judge.report().exposed_area_m2);
  everything.stamp_s = 0.1;
  judge.judgeSurface(everything);
  EXPECT_NEAR(judge.report().covered_area_m2, judge.report().coverable_area_m2, 1e-12);
  EXPECT_NEAR(judge.totals().coverage.value(), 1.0, 1e-12);
}

TEST_F(JudgeTest, OldSurfacesAreNotJudged) {
  hold(1.0);
  EXPECT_EQ(judge.judgeSurface(topOf({0.0, 0.0, 0.15}, 0.05)), SurfaceVerdict::kOutsideOfHistory);  // before the run
  hold(31.0);
  EXPECT_EQ(judge.judgeSurface(topOf({0.0, 0.0, 0.15}, 1.0)), SurfaceVerdict::kOutsideOfHistory);
  EXPECT_EQ(report().covered_area_m2, 0.0);
  EXPECT_FALSE(report().totals.precision.has_value());
  EXPECT_EQ(report().surfaces_refused, 2);
  EXPECT_EQ(judge.judgeSurface(topOf({0.0, 0.0, 0.15}, 3.0)), SurfaceVerdict::kJudged);
  EXPECT_EQ(report().surfaces_judged, 1);
}

TEST_F(JudgeTest, ABrickThatSomebodyHasIsNoPile) {
  hold(1.0);
  const double before_m2 = report().exposed_area_m2;
  for (const BrickStatus status :
       {BrickStatus::kHeld, BrickStatus::kReleased, BrickStatus::kStowed, BrickStatus::kMovedByHand}) {
    world.brick(2).status = status;  // where it was, on top of brick 1
    hold(1.0);
    EXPECT_NEAR(report().exposed_area_m2, before_m2 + kTop_m2, 1e-12);  // it hides nothing
    judge.judgeSurface(topOf({0.0, 0.0, 0.15}, world.now.time_s));
    EXPECT_EQ(report().totals.precision, 0.0);
  }
  world.brick(2).status = BrickStatus::kDropped;  // and belongs to the pile again
  hold(1.0);
  judge.judgeSurface(topOf({0.0, 0.0, 0.15}, world.now.time_s));
  EXPECT_EQ(report().totals.precision, 1.0);
}

TEST_F(JudgeTest, ATumblingBrickExposesNothingUntilItLies) {
  hold(1.0);
  const double before_m2 = report().exposed_area_m2;
  for (int i = 1; i <= 20; ++i) {
    world.turn(3, Eigen::Vector3d::UnitX(), 0.157 * i);  // on its back in the end
    world.brick(3).T_map_brick.translation().z() = 0.2;
    hold(0.1);
  }
  EXPECT_EQ(report().exposed_area_m2, before_m2);
  world.turn(3, Eigen::Vector3d::UnitX(), 180.0 * kDegree);
  world.brick(3).T_map_brick.translation().z() = 0.05;
  hold(2.0);
  EXPECT_NEAR(report().exposed_area_m2, before_m2 + kTop_m2, 1e-12);  // what was its underside
  EXPECT_EQ(report().totals.falls, 1);
}

TEST_F(JudgeTest, HistoryHasARowPerSecondAndPerEvent) {
  hold(10.0);
  EXPECT_NEAR(static_cast<double>(judge.history().size()), 10.0, 1.0);
  world.touch("forearm", brickBodyName(1), 33.0);
  hold(0.1);
  const JudgeRow& row = judge.history().back();
  EXPECT_EQ(row.time_s, world.now.time_s);
  EXPECT_EQ(row.collisions, 1);
  judge.finish();
  EXPECT_EQ(judge.events().back().kind, JudgeEventKind::kCollisionEnd);
  EXPECT_EQ(report().max_collision_force_N, 33.0);
  for (std::size_t i = 1; i < judge.history().size(); ++i) {
    EXPECT_GE(judge.history()[i].time_s, judge.history()[i - 1].time_s);
  }
}

TEST_F(JudgeTest, RefusesBrokenInputAndTakesNothingOver) {
  EXPECT_THROW(judge.judgeSurface(topOf({0.0, 0.0, 0.15}, 0.0)), std::invalid_argument);
  hold(0.5);
  const std::size_t num_rows = judge.history().size();
  const auto refuses = [this](const WorldObservation& observation) {
    EXPECT_THROW(judge.observe(observation), std::invalid_argument);
  };
  refuses(world.now);  // the same time again
  WorldObservation next = world.now;
  next.time_s += 5.0;
  WorldObservation bad = next;
  bad.bricks[0].T_map_brick.translation().x() = std::nan("");
  refuses(bad);
  bad = next;
  bad.bricks[0].id = 2;
  refuses(bad);
  bad = next;
  bad.bricks[0].size_m.y() = -0.1;
  refuses(bad);
  bad = next;
  bad.contacts = {{"forearm", "brick_1", -1.0}};
  refuses(bad);
  bad = next;
  bad.base_xy_m.y() = std::nan("");
  refuses(bad);
  EXPECT_EQ(judge.history().size(), num_rows);
  EXPECT_NO_THROW(judge.observe(next));
}

TEST_F(JudgeTest, AnEmptyWorldHasNoCoverage) {
  world.now.bricks.clear();
  hold(1.0);
  EXPECT_FALSE(report().totals.coverage.has_value());
  EXPECT_EQ(judge.judgeSurface(topOf({0.0, 0.0, 0.05}, 0.5)), SurfaceVerdict::kJudged);
  EXPECT_FALSE(report().totals.precision.has_value());  // and no region around a pile
}

TEST(JudgeConfig, ListsEveryProblemWithItsSection) {
  JudgeConfig config;
  EXPECT_TRUE(config.validate().empty());
  config.falls.fall_distance_m = -1.0;
  config.score.patch_size_m = 0.0;
  config.row_period_s = 0.0;
  const std::vector<std::string> problems = config.validate();
  ASSERT_EQ(problems.size(), 3U);
  EXPECT_EQ(problems[0], "falls/fall_distance_m = -1 m, must be in [0.001, 10] m");
  EXPECT_THROW(Judge{config}, std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
