// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/grid_fusion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>

#include "base_navigation/footprint_checker.h"
#include "support/grids.h"
#include "support/scan_world.h"

namespace base_navigation {
namespace {

const Polygon kBody = {{0.296, 0.296}, {-0.527, 0.296}, {-0.527, -0.296}, {0.296, -0.296}};
constexpr double kCell_m = 0.05;

SpaceState stateAt(const NavigationGrid& grid, const Eigen::Vector2d& p) {
  const Eigen::Vector2i cell = grid.cellOf(p);
  return grid.at(cell.x(), cell.y());
}

// From a cell's square to the line through two points: 0 if the line meets it.
double lineDistance(const NavigationGrid& grid, int column, int row, const ScanWorld::Wall& wall) {
  const Eigen::Vector2d along = (wall.to - wall.from).normalized();
  const Eigen::Vector2d normal(-along.y(), along.x());
  return std::max(0.0,
                  std::abs(normal.dot(grid.centerOf(column, row) - wall.from)) - 0.5 * kCell_m * normal.lpNorm<1>());
}

std::shared_ptr<const NavigationGrid> ground(SpaceState state, int cells = 200,
                                             const Eigen::Vector2d& origin = {-5, -5}) {
  return std::make_shared<const NavigationGrid>(makeGrid(cells, cells, state, kCell_m, origin));
}

TEST(GridFusion, ScannedHallIsFreeWithoutAGap) {
  ScanWorld hall;
  hall.walls = {{{6, -7}, {6, 7}}, {{6, 7}, {-6, 7}}, {{6, -7}, {-6, -7}}};
  const Pose2d pose{0.013, -0.021, 0.4};
  GridFusion fusion(GridFusionConfig(), kBody);
  fusion.addScan(hall.look(pose), pose, 1.0);
  const auto grid = fusion.build(pose, 1.0);
  const Pose2d T_map_scanner = compose(pose, {0.244, 0.0, 0.0});
  int num_free = 0, num_beyond = 0;
  for (int row = 0; row < grid->height; ++row) {
    for (int column = 0; column < grid->width; ++column) {
      const Eigen::Vector2d p = grid->centerOf(column, row);
      const Eigen::Vector2d seen = transform(inverse(T_map_scanner), p);
      const double bearing = std::atan2(seen.y(), seen.x());
      const double distance = seen.norm();
      // By half a diagonal, and a beam more at the edge of the field of view, a cell is all inside or all outside.
      const double margin = 0.0354;
      if (distance > 0.1 && distance < 4.0 - margin &&
          std::abs(bearing) < 95.0 * M_PI / 180.0 - 0.0088 - std::asin(margin / distance)) {
        ASSERT_EQ(grid->at(column, row), SpaceState::kFree) << p.transpose();
        ++num_free;
      }
      if (distance > 4.0 + margin) {
        ASSERT_NE(grid->at(column, row), SpaceState::kFree) << p.transpose();
        ++num_beyond;
      }
      if (std::abs(bearing) > 95.0 * M_PI / 180.0 && transform(inverse(pose), p).x() < -0.8) {
        ASSERT_EQ(grid->at(column, row), SpaceState::kUnknown) << p.transpose();
      }
    }
  }
  EXPECT_GT(num_free, 9000);  // half a disc of 4 m has 10000 cells
  EXPECT_GT(num_beyond, 1000);
  EXPECT_EQ(stateAt(*grid, {6.001, 2.0}), SpaceState::kOccupied);
}

// The rule against noise: on straight walls from square to grazing, at any offset from the lattice, no cell that the wall
// runs through is ever free, and no cell farther than one from the wall is occupied.
TEST(GridFusion, NoisyWallHasNoGapAndDoesNotThicken) {
  std::mt19937 engine(11);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  std::size_t num_wall = 0, num_occupied = 0, num_near_free = 0;
  int num_walls = 0;
  for (const double angle : {0.0, 0.0, 0.03, 0.03, 0.2, 0.2, 0.25 * M_PI, 1.0, 1.5, 0.5 * M_PI}) {
    const Eigen::Vector2d along(std::cos(angle), std::sin(angle));
    const Eigen::Vector2d normal(-along.y(), along.x());
    // 0.8 m off the first pose, to its left or right: beams that pass along the wall are the next by number or the last.
    const double side = ++num_walls % 2 == 0 ? 1.0 : -1.0;
    const Eigen::Vector2d foot = side * (0.8 + 0.05 * unit(engine)) * normal;
    const ScanWorld::Wall wall{foot - 12.0 * along, foot + 12.0 * along};
    ScanWorld world;
    world.walls = {wall};
    GridFusion fusion(GridFusionConfig(), kBody);
    Pose2d pose;
    for (int i = 0; i < 200; ++i) {
      // Stands for a while, then moves along the wall.
      if (i > 100) pose = {along.x() * 0.01 * (i - 100), along.y() * 0.01 * (i - 100), 0.003 * (i - 100)};
      fusion.addScan(world.look(pose, 0.01, &engine), pose, 0.08 * i);
      if (i % 10 != 9) continue;
      const auto grid = fusion.build(pose, 0.08 * i);
      for (int row = 0; row < grid->height; ++row) {
        for (int column = 0; column < grid->width; ++column) {
          const SpaceState state = grid->at(column, row);
          const double off = lineDistance(*grid, column, row, wall);
          if (off == 0.0) {
            ASSERT_NE(state, SpaceState::kFree) << angle << " " << i << " " << grid->centerOf(column, row).transpose();
            if (state == SpaceState::kOccupied) ++num_wall;
          }
          if (state == SpaceState::kOccupied) {
            ASSERT_LT(off, kCell_m) << angle << " " << i;
            ++num_occupied;
          }
          if (state == SpaceState::kFree && off < 2.0 * kCell_m) ++num_near_free;
        }
      }
    }
  }
  EXPECT_GT(num_wall, 10000U);
  EXPECT_GT(num_occupied, 10000U);
  EXPECT_GT(num_near_free, 5000U);  // free ground begins within two cells of the wall
}

TEST(GridFusion, WallAcrossStaysClosedAndIsNoThickerThanTheNoise) {
  std::mt19937 engine(12);
  for (const double x : {2.0, 2.001, 2.025, 2.049}) {  // on the lattice's line, off it, in the middle of a cell
    ScanWorld world;
    world.walls = {{{x, -6}, {x, 6}}};
    GridFusion fusion(GridFusionConfig(), kBody);
    for (int i = 0; i < 200; ++i) fusion.addScan(world.look({}, 0.01, &engine), {}, 0.08 * i);
    const auto grid = fusion.build({}, 16.0);
    for (double y = -2.0; y < 2.0; y += 0.01) {
      int num_occupied = 0;
      for (double at = 1.525; at < 2.5; at += 0.05) {
        if (stateAt(*grid, {at, y}) == SpaceState::kOccupied) ++num_occupied;
      }
      ASSERT_GE(num_occupied, 1) << x << " " << y;
      // In the middle of a cell 2.5 sigma reach over either side, elsewhere over one.
      ASSERT_LE(num_occupied, x == 2.025 ? 3 : 2) << x << " " << y;
      ASSERT_EQ(stateAt(*grid, {1.875, y}), SpaceState::kFree) << x << " " << y;
    }
  }
}

TEST(GridFusion, PersonThatWalksThroughLeavesNothing) {
  ScanWorld world;
  world.walls = {{{6, -7}, {6, 7}}};
  GridFusion fusion(GridFusionConfig(), kBody);
  std::mt19937 engine(13);
  double now_s = 0.0;
  for (double y = -3.0; y < 3.0; y += 0.08) {
    world.posts = {{{2.0 + 0.1 * y, y}, 0.15}};
    now_s += 0.08;
    fusion.addScan(world.look({}, 0.01, &engine), {}, now_s);
    const auto grid = fusion.build({}, now_s);
    if (std::abs(y) < 2.0) {
      // Its near side is in the grid while it stands there.
      const Eigen::Vector2d eye(0.244, 0.0);
      const Eigen::Vector2d middle = world.posts[0].middle;
      const Eigen::Vector2d face = middle - 0.15 * (middle - eye).normalized();
      bool is_seen = false;
      for (const double off : {-0.02, 0.0, 0.02}) {
        is_seen = is_seen || stateAt(*grid, face + off * (middle - eye).normalized()) == SpaceState::kOccupied;
      }
      EXPECT_TRUE(is_seen) << y;
    }
  }
  world.posts.clear();
  for (int i = 0; i < 3; ++i) fusion.addScan(world.look({}, 0.01, &engine), {}, now_s += 0.08);
  const auto grid = fusion.build({}, now_s);
  for (int row = 0; row < grid->height; ++row) {
    for (int column = 0; column < grid->width; ++column) {
      const Eigen::Vector2d p = grid->centerOf(column, row);
      if (p.x() > 5.8) continue;  // the wall
      ASSERT_NE(grid->at(column, row), SpaceState::kOccupied) << p.transpose();
    }
  }
  EXPECT_EQ(stateAt(*grid, {2.0, 0.0}), SpaceState::kFree);
}

TEST(GridFusion, EchoIsRememberedForAWhile) {
  GridFusionConfig config;
  config.obstacle_memory_s = 60.0;
  GridFusion fusion(config, kBody);
  ScanWorld world;
  world.posts = {{{2.0, 0.0}, 0.2}};
  fusion.addScan(world.look({}), {}, 100.0);
  const Pose2d away{0.0, 0.0, M_PI};
  fusion.addScan(ScanWorld().look(away), away, 101.0);  // looks the other way: nothing new there
  EXPECT_EQ(stateAt(*fusion.build({}, 159.9), {1.81, 0.0}), SpaceState::kOccupied);
  EXPECT_EQ(stateAt(*fusion.build({}, 160.1), {1.81, 0.0}), SpaceState::kUnknown);
  // On ground that the map knows to be free nothing but the echo was against it.
  fusion.setMap(ground(SpaceState::kFree));
  EXPECT_EQ(stateAt(*fusion.build({}, 159.9), {1.81, 0.0}), SpaceState::kOccupied);
  EXPECT_EQ(stateAt(*fusion.build({}, 160.1), {1.81, 0.0}), SpaceState::kFree);
  // A later look through takes it back at once.
  fusion.addScan(ScanWorld().look({}), {}, 102.0);
  EXPECT_EQ(stateAt(*fusion.build({}, 102.0), {1.81, 0.0}), SpaceState::kFree);
}

TEST(GridFusion, EchoFarAwayIsTakenBackWithoutFreeGround) {
  GridFusion fusion(GridFusionConfig(), kBody);
  ScanWorld world;
  world.posts = {{{6.2, 0.0}, 0.2}};
  fusion.addScan(world.look({}), {}, 0.0);
  EXPECT_EQ(stateAt(*fusion.build({}, 0.0), {6.01, 0.0}), SpaceState::kOccupied);
  fusion.addScan(ScanWorld().look({}), {}, 0.1);
  EXPECT_EQ(stateAt(*fusion.build({}, 0.1), {6.01, 0.0}), SpaceState::kUnknown);
  world.posts = {{{9.2, 0.0}, 0.2}};  // beyond scan_obstacle_range
  fusion.addScan(world.look({}), {}, 0.2);
  EXPECT_EQ(stateAt(*fusion.build({}, 0.2), {9.01, 0.0}), SpaceState::kUnknown);
}

TEST(GridFusion, MapAndScannerInTheirOrder) {
  for (const SpaceState map : {SpaceState::kUnknown, SpaceState::kFree, SpaceState::kOccupied}) {
    GridFusion fusion(GridFusionConfig(), kBody);
    fusion.setMap(ground(map));
    const Eigen::Vector2d echo(2.01, 0.01), passed(1.51, 0.01), unseen(-2.01, 0.01), standing(0.0, 0.0);
    EXPECT_EQ(stateAt(*fusion.build({}, 0.0), passed), map);
    ScanWorld world;
    world.walls = {{{2.01, -5}, {2.01, 5}}};
    fusion.addScan(world.look({}), {}, 0.0);
    const auto grid = fusion.build({}, 0.0);
    EXPECT_EQ(stateAt(*grid, standing), SpaceState::kFree);
    EXPECT_EQ(stateAt(*grid, echo), SpaceState::kOccupied);
    EXPECT_EQ(stateAt(*grid, unseen), map);
    // Looked through by the scanner: what the map saw may be higher or lower than the beam.
    EXPECT_EQ(stateAt(*grid, passed), map == SpaceState::kOccupied ? map : SpaceState::kFree);
    EXPECT_EQ(stateAt(*fusion.build({-3, 0, 0}, 0.0), standing), map);  // the robot has gone, and told of no track
  }
}

TEST(GridFusion, BeamsThatSayNothing) {
  const float inf = std::numeric_limits<float>::infinity();
  for (const float range : {0.0F, 0.005F, -1.0F, std::nanf(""), -inf}) {
    Scan scan = ScanWorld().look({});
    for (int i = 180; i <= 200; ++i) scan.ranges_m[i] = range;  // straight ahead, 10 degrees
    GridFusion fusion(GridFusionConfig(), kBody);
    fusion.addScan(scan, {}, 0.0);
    EXPECT_EQ(stateAt(*fusion.build({}, 0.0), {2.0, 0.0}), SpaceState::kUnknown) << range;
    EXPECT_EQ(stateAt(*fusion.build({}, 0.0), {2.0, 1.0}), SpaceState::kFree) << range;
    EXPECT_FALSE(scan.isEcho(190));
    EXPECT_FALSE(scan.isEmpty(190));
  }
  for (const float range : {29.01F, 30.0F, inf}) {
    Scan scan = ScanWorld().look({});
    scan.ranges_m.assign(381, range);
    GridFusion fusion(GridFusionConfig(), kBody);
    fusion.addScan(scan, {}, 0.0);
    EXPECT_EQ(stateAt(*fusion.build({}, 0.0), {2.0, 0.0}), SpaceState::kFree) << range;
    EXPECT_FALSE(scan.isEcho(190));
    EXPECT_TRUE(scan.isEmpty(190));
  }
}

TEST(GridFusion, UpsideDownScannerSeesLeftOnTheLeft) {
  ScanWorld world;
  world.posts = {{{1.5, 1.2}, 0.1}};
  Scan scan = world.look({});
  GridFusion fusion(GridFusionConfig(), kBody);
  fusion.addScan(scan, {}, 0.0);
  const auto grid = fusion.build({}, 0.0);
  const Eigen::Vector2d toward = (world.posts[0].middle - Eigen::Vector2d(0.244, 0.0)).normalized();
  const Eigen::Vector2d face = world.posts[0].middle - 0.0999 * toward;
  EXPECT_EQ(stateAt(*grid, face), SpaceState::kOccupied);
  EXPECT_EQ(stateAt(*grid, {1.5, -1.2}), SpaceState::kFree);
  // The same beams counted from the other end, by a scanner the right way up or one that counts down.
  for (const bool is_mirrored : {false, true}) {
    Scan other = scan;
    other.is_mirrored = is_mirrored;
    if (!is_mirrored) {
      std::reverse(other.ranges_m.begin(), other.ranges_m.end());
    } else {
      std::reverse(other.ranges_m.begin(), other.ranges_m.end());
      other.min_angle_rad = -other.min_angle_rad;
      other.increment_rad = -other.increment_rad;
    }
    GridFusion again(GridFusionConfig(), kBody);
    again.addScan(other, {}, 0.0);
    EXPECT_EQ(again.build({}, 0.0)->state, grid->state) << is_mirrored;
  }
}

TEST(GridFusion, EchoOfTheRobotItselfIsLeftOut) {
  Scan scan = ScanWorld().look({});
  for (int i = 0; i < 20; ++i) scan.ranges_m[i] = 0.1F;  // at the edge of the view: its own side
  ASSERT_LT(scan.echo(5).y(), 0.296);
  GridFusion fusion(GridFusionConfig(), kBody);
  fusion.addScan(scan, {}, 0.0);
  const auto grid = fusion.build({-3.0, 0.0, 0.0}, 0.0);
  EXPECT_THAT(grid->state, testing::Not(testing::Contains(SpaceState::kOccupied)));
}

TEST(GridFusion, TrackIsFreeWithItsPadding) {
  std::mt19937 engine(14);
  const double padding_m = GridFusionConfig().standing_padding_m;
  std::uniform_real_distribution<double> place(-2.0, 2.0), yaw(-M_PI, M_PI);
  for (int round = 0; round < 50; ++round) {
    const Pose2d pose{place(engine), place(engine), yaw(engine)};
    GridFusion fusion(GridFusionConfig(), kBody);
    fusion.addFootprint(pose);
    const Pose2d away{pose.x_m + 3.0, pose.y_m, 0.0};
    const auto grid = fusion.build(away, 0.0);
    EXPECT_TRUE(FootprintChecker(grid, kBody, padding_m).isFree(pose)) << "it may come back";
    EXPECT_EQ(FootprintChecker(grid, kBody, padding_m + 0.0708).check(pose).state, SpaceState::kUnknown)
        << "a cell's diagonal more";
    for (int row = 0; row < grid->height; ++row) {
      for (int column = 0; column < grid->width; ++column) {
        const Eigen::Vector2d p = grid->centerOf(column, row);
        if ((p - pose.position()).norm() > 1.0) continue;
        // A middle inside: surely touched; farther than half a diagonal outside, and from a corner: surely not.
        const Eigen::Vector2d q = transform(inverse(pose), p);
        const double outside_m = std::max({q.x() - 0.296, -0.527 - q.x(), std::abs(q.y()) - 0.296}) - padding_m;
        if (outside_m < 0.0) {
          ASSERT_EQ(grid->at(column, row), SpaceState::kFree) << p.transpose();
        } else if (outside_m > 0.0354) {
          ASSERT_EQ(grid->at(column, row), SpaceState::kUnknown) << p.transpose();
        }
      }
    }
  }
}

TEST(GridFusion, PlaceWhereTheRobotStandsIsFreeAndUnknownGroundABitAround) {
  std::mt19937 engine(15);
  std::uniform_real_distribution<double> place(-2.0, 2.0), yaw(-M_PI, M_PI);
  const double padding_m = GridFusionConfig().standing_padding_m;
  constexpr double kDiagonal_m = 0.0708;  // of a cell
  for (const SpaceState around : {SpaceState::kOccupied, SpaceState::kUnknown}) {
    GridFusion fusion(GridFusionConfig(), kBody);
    fusion.setMap(ground(around));
    const double free_m = around == SpaceState::kOccupied ? 0.0 : padding_m;  // a pile beside it stays where it is
    for (int round = 0; round < 50; ++round) {
      const Pose2d pose{place(engine), place(engine), yaw(engine)};
      const auto grid = fusion.build(pose, 0.0);
      EXPECT_TRUE(FootprintChecker(grid, kBody, free_m).isFree(pose));
      EXPECT_EQ(FootprintChecker(grid, kBody, free_m + kDiagonal_m).check(pose).state, around);
    }
  }
}

TEST(GridFusion, ForgetKeepsTheMap) {
  GridFusion fusion(GridFusionConfig(), kBody);
  NavigationGrid map = makeGrid(20, 20, SpaceState::kFree, kCell_m, {3.0, -0.5});
  map.state[0] = SpaceState::kOccupied;
  fusion.setMap(std::make_shared<NavigationGrid>(map));
  const auto before = fusion.build({}, 0.0);
  ScanWorld world;
  world.walls = {{{2, -5}, {2, 5}}};
  fusion.addScan(world.look({}), {}, 0.0);
  fusion.addFootprint({-1.0, 0.0, 0.0});
  EXPECT_NE(fusion.build({}, 0.0)->state, before->state);
  fusion.forget();
  EXPECT_EQ(fusion.build({}, 0.0)->state, before->state);
  fusion.setMap(nullptr);
  EXPECT_THAT(fusion.build({}, 0.0)->state, testing::Not(testing::Contains(SpaceState::kOccupied)));
}

// Overlaps by area, cell against cell, of lattices with any offset and size.
TEST(GridFusion, MapOfAnotherLatticeIsTakenOverConservatively) {
  std::mt19937 engine(16);
  std::uniform_real_distribution<double> offset(-2.0, -1.0);
  for (const double cell_m : {0.05, 0.02, 0.08, 0.1, 0.37}) {
    for (int round = 0; round < 4; ++round) {
      // The first by whole cells off: the same lattice, made of sums that round.
      const Eigen::Vector2d origin = round == 0 ? Eigen::Vector2d(-30 * 0.05 + 1e-7, 0.1 + 0.2 - 1.3)
                                                : Eigen::Vector2d(offset(engine), offset(engine));
      const int cells = static_cast<int>(3.0 / cell_m);
      const auto map =
          std::make_shared<const NavigationGrid>(randomGrid(engine, cells, cells - 1, 0.03, 0.03, cell_m, origin));
      GridFusion fusion(GridFusionConfig(), kBody);
      fusion.setMap(map);
      const auto grid = fusion.build({6.0, 0.0, 0.0}, 0.0);  // stands beside it
      int num_free = 0;
      for (int y = -50; y < 50; ++y) {
        for (int x = -50; x < 50; ++x) {
          const Eigen::Vector2d p = kCell_m * Eigen::Vector2d(x + 0.5, y + 0.5);
          SpaceState expected = SpaceState::kFree;
          const Eigen::Vector2i near = map->cellOf(p);
          for (int row = near.y() - 4; row <= near.y() + 4; ++row) {
            for (int column = near.x() - 4; column <= near.x() + 4; ++column) {
              const Eigen::Vector2d apart = (map->centerOf(column, row) - p).cwiseAbs();
              if (apart.maxCoeff() > 0.5 * (kCell_m + cell_m) - 1e-5) continue;
              const SpaceState state = map->at(column, row);
              if (state == SpaceState::kOccupied) expected = state;
              if (state == SpaceState::kUnknown && expected == SpaceState::kFree) expected = state;
            }
          }
          ASSERT_EQ(stateAt(*grid, p), expected) << cell_m << " " << p.transpose();
          if (expected == SpaceState::kFree) ++num_free;
        }
      }
      EXPECT_GT(num_free, 100) << cell_m;
    }
  }
}

TEST(GridFusion, LatticeStaysWhereverTheRobotGoes) {
  GridFusion fusion(GridFusionConfig(), kBody);
  for (const Pose2d& pose : {Pose2d{}, Pose2d{0.037, -12.3, 1.0}, Pose2d{-71.2, 3.3, 2.0}}) {
    const auto grid = fusion.build(pose, 0.0);
    for (const double corner : {grid->origin_m.x() / kCell_m, grid->origin_m.y() / kCell_m}) {
      EXPECT_NEAR(corner, std::round(corner), 1e-9);
    }
  }
}

TEST(GridFusion, KeepsNothingFarAway) {
  GridFusionConfig config;
  config.max_range_m = 5.0;
  GridFusion fusion(config, kBody);
  ScanWorld world;
  world.walls = {{{2, -5}, {2, 5}}};
  fusion.addScan(world.look({}), {}, 0.0);
  EXPECT_EQ(stateAt(*fusion.build({}, 0.0), {2.01, 0.0}), SpaceState::kOccupied);
  // 7.5 m away the wall is out of reach, and back again it is forgotten: the window has moved.
  for (double x = 0.0; x > -7.5; x -= 0.3) fusion.addFootprint({x, 0.0, 0.0});
  EXPECT_THAT(fusion.build({-7.2, 0.0, 0.0}, 0.0)->state, testing::Not(testing::Contains(SpaceState::kOccupied)));
  fusion.addFootprint({0.0, 0.0, 0.0});
  const auto grid = fusion.build({}, 0.0);
  EXPECT_EQ(stateAt(*grid, {2.01, 0.0}), SpaceState::kUnknown);
  EXPECT_EQ(stateAt(*grid, {1.0, 0.0}), SpaceState::kUnknown);
  EXPECT_EQ(stateAt(*grid, {-3.0, 0.0}), SpaceState::kFree);  // of its track, what stayed in reach
  fusion.addScan(world.look({}), {}, 0.0);
  for (double y = 0.0; y < 7.5; y += 0.3) fusion.addFootprint({0.0, y, 0.0});
  fusion.addFootprint({});
  EXPECT_EQ(stateAt(*fusion.build({}, 0.0), {2.01, 0.0}), SpaceState::kUnknown);
  fusion.setMap(ground(SpaceState::kFree, 2000, {-50, -50}));
  const auto all = fusion.build({0.2, 0.3, 0.0}, 0.0);
  EXPECT_LE(all->width, 2 * 100 + 1);
  EXPECT_LE(all->height, 2 * 100 + 1);
  EXPECT_GE(all->width, 2 * 100);
}

// Within what the small window never leaves, a window so large that nothing is ever forgotten or wrapped knows the same.
TEST(GridFusion, WindowForgetsNothingInReach) {
  GridFusionConfig small_config, large_config;
  small_config.max_range_m = 10.0;
  large_config.max_range_m = 50.0;
  GridFusion small(small_config, kBody), large(large_config, kBody);
  ScanWorld world;
  world.walls = {{{-3, -7}, {8, 4}}, {{-6, 5}, {5, 6}}};
  world.posts = {{{2.0, 2.0}, 0.3}, {{-2.0, 1.5}, 0.3}};
  std::mt19937 engine(17);
  std::uniform_real_distribution<double> place(-4.0, 4.0), yaw(-M_PI, M_PI);
  for (int i = 0; i < 40; ++i) {
    const Pose2d pose{place(engine), place(engine), yaw(engine)};
    for (GridFusion* fusion : {&small, &large}) {
      fusion->addScan(world.look(pose), pose, 0.1 * i);
      fusion->addFootprint(pose);
    }
  }
  const auto a = small.build({0.0, 0.0, 0.0}, 4.0);
  const auto b = large.build({0.0, 0.0, 0.0}, 4.0);
  std::array<int, 3> count{};
  for (double x = -5.975; x < 6.0; x += 0.05) {
    for (double y = -5.975; y < 6.0; y += 0.05) {
      ASSERT_EQ(stateAt(*a, {x, y}), stateAt(*b, {x, y})) << x << " " << y;
      ++count[static_cast<int>(stateAt(*a, {x, y}))];
    }
  }
  for (const int n : count) EXPECT_GT(n, 50);
}

TEST(GridFusion, RefusesWhatIsImpossible) {
  GridFusionConfig config;
  EXPECT_THAT(interactive_mapping::problemsOf(config), testing::IsEmpty());
  config.cell_size_m = 0.0;
  config.max_range_m = std::nan("");
  config.standing_padding_m = -0.1;
  config.obstacle_memory_s = -1.0;
  config.scan_free_range_m = -1.0;
  config.scan_obstacle_range_m = 1e9;
  EXPECT_THAT(interactive_mapping::problemsOf(config), testing::SizeIs(6));
  EXPECT_THROW(GridFusion(config, kBody), std::invalid_argument);
  EXPECT_THROW(GridFusion(GridFusionConfig(), {{0.0, 0.0}, {1.0, 0.0}}), std::invalid_argument);

  GridFusion fusion(GridFusionConfig(), kBody);
  const Scan scan = ScanWorld().look({});
  const double nan = std::nan("");
  EXPECT_THROW(fusion.addScan(scan, {nan, 0.0, 0.0}, 0.0), std::invalid_argument);
  EXPECT_THROW(fusion.addScan(scan, {}, nan), std::invalid_argument);
  EXPECT_THROW(fusion.addFootprint({1e9, 0.0, 0.0}), std::invalid_argument);
  EXPECT_THROW(fusion.build({0.0, 0.0, nan}, 0.0), std::invalid_argument);
  EXPECT_THROW(fusion.build({}, nan), std::invalid_argument);
  Scan bad = scan;
  bad.increment_rad = 0.0;
  EXPECT_THROW(fusion.addScan(bad, {}, 0.0), std::invalid_argument);
  bad.increment_rad = nan;
  EXPECT_THROW(fusion.addScan(bad, {}, 0.0), std::invalid_argument);
  NavigationGrid map = makeGrid(4, 4, SpaceState::kFree);
  map.state.pop_back();
  EXPECT_THROW(fusion.setMap(std::make_shared<NavigationGrid>(map)), std::invalid_argument);
  map = makeGrid(4, 4, SpaceState::kFree, -0.05);
  EXPECT_THROW(fusion.setMap(std::make_shared<NavigationGrid>(map)), std::invalid_argument);
  bad = scan;
  bad.ranges_m.clear();
  fusion.addScan(bad, {}, 0.0);  // no beams, no news
  EXPECT_EQ(stateAt(*fusion.build({}, 0.0), {1.0, 0.0}), SpaceState::kUnknown);
}

}  // namespace
}  // namespace base_navigation
