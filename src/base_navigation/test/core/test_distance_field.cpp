// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/distance_field.h"

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>

#include "support/grids.h"

namespace base_navigation {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
const double kRoot2 = std::sqrt(2.0);

// From a point to a closed square of the lattice.
double squareDistance(const NavigationGrid& grid, const Eigen::Vector2d& p, int column, int row) {
  const Eigen::Vector2d off = (p - grid.centerOf(column, row)).cwiseAbs();
  return (off - Eigen::Vector2d::Constant(0.5 * grid.cell_size_m)).cwiseMax(0.0).norm();
}

// To the nearest square that is not free, of the grid and outside it.
double clearance(const NavigationGrid& grid, const Eigen::Vector2d& p, double radius_m) {
  const int reach = static_cast<int>(radius_m / grid.cell_size_m) + 2;
  const Eigen::Vector2i cell = grid.cellOf(p);
  double nearest = kInf;
  for (int row = cell.y() - reach; row <= cell.y() + reach; ++row) {
    for (int column = cell.x() - reach; column <= cell.x() + reach; ++column) {
      if (grid.at(column, row) == SpaceState::kFree) continue;
      nearest = std::min(nearest, squareDistance(grid, p, column, row));
    }
  }
  return nearest;
}

// Bellman and Ford: over and over until no cell's distance falls any more.
std::vector<double> oracle(const NavigationGrid& grid, const Eigen::Vector2i& start, double radius_m) {
  std::vector<bool> is_passed(grid.state.size(), false);
  const double at_start = clearance(grid, grid.centerOf(start.x(), start.y()), radius_m);
  for (int row = 0; row < grid.height; ++row) {
    for (int column = 0; column < grid.width; ++column) {
      const Eigen::Vector2d p = grid.centerOf(column, row);
      const double at = clearance(grid, p, radius_m);
      const double away = (p - grid.centerOf(start.x(), start.y())).norm();
      is_passed[grid.index(column, row)] =
          at > radius_m + 1e-9 || (at_start <= radius_m + 1e-9 && grid.at(column, row) == SpaceState::kFree &&
                                   at >= at_start + 0.5 * away - 1e-9);
    }
  }
  is_passed[grid.index(start.x(), start.y())] = true;
  const auto passed = [&](int column, int row) {
    return grid.contains(column, row) && is_passed[grid.index(column, row)];
  };
  std::vector<double> distance(grid.state.size(), kInf);
  distance[grid.index(start.x(), start.y())] = 0.0;
  for (bool is_changed = true; is_changed;) {
    is_changed = false;
    for (int row = 0; row < grid.height; ++row) {
      for (int column = 0; column < grid.width; ++column) {
        if (!passed(column, row)) continue;
        for (int dy = -1; dy <= 1; ++dy) {
          for (int dx = -1; dx <= 1; ++dx) {
            if (!passed(column + dx, row + dy) || !passed(column + dx, row) || !passed(column, row + dy)) continue;
            const double over = distance[grid.index(column + dx, row + dy)] + grid.cell_size_m * std::hypot(dx, dy);
            double& own = distance[grid.index(column, row)];
            if (over < own - 1e-9) {
              own = over;
              is_changed = true;
            }
          }
        }
      }
    }
  }
  return distance;
}

double lengthOf(const std::vector<Eigen::Vector2d>& path) {
  double length = 0.0;
  for (std::size_t i = 1; i < path.size(); ++i) length += (path[i] - path[i - 1]).norm();
  return length;
}

// Distances are floats, added up over at most some hundred steps of half a unit in the last place each.
double tolerance(double distance_m) {
  return 2e-5 * distance_m + 1e-6;
}

TEST(DistanceField, IsThatOfBellmanAndFord) {
  std::mt19937 engine(5);
  std::size_t num_reached = 0, num_left = 0;
  for (int round = 0; round < 400; ++round) {
    const double radius_m = std::vector<double>{0.0, 0.025, 0.06, 0.11, 0.075 * kRoot2}[round % 5];
    const double density = radius_m < 0.05 ? 0.3 : 0.04;
    const NavigationGrid grid = randomGrid(engine, 24 + round % 7, 20 + round % 5, 0.5 * density, 0.5 * density, 0.05,
                                           {0.35 * (round % 3), -1.0});
    std::uniform_int_distribution<int> x(0, grid.width - 1), y(0, grid.height - 1);
    const Eigen::Vector2i start(x(engine), y(engine));
    const DistanceField field(grid, grid.centerOf(start.x(), start.y()), radius_m);
    const std::vector<double> expected = oracle(grid, start, radius_m);
    const bool is_free = clearance(grid, grid.centerOf(start.x(), start.y()), radius_m) > radius_m;
    for (int row = 0; row < grid.height; ++row) {
      for (int column = 0; column < grid.width; ++column) {
        const double right = expected[grid.index(column, row)];
        const double got = field.distance(grid.centerOf(column, row));
        ASSERT_EQ(std::isfinite(got), std::isfinite(right)) << round << " " << column << " " << row;
        if (!std::isfinite(right)) continue;
        ASSERT_NEAR(got, right, tolerance(right)) << round << " " << column << " " << row;
        ++num_reached;
        if (!is_free && right > 0.0) ++num_left;
      }
    }
  }
  EXPECT_GT(num_reached, 10000U);
  EXPECT_GT(num_left, 1000U);  // from places whose disc touches something
}

// The disc moved along each step, not only at its ends.
TEST(DistanceField, DiscOfTheWayTouchesNothingOnTheWay) {
  std::mt19937 engine(6);
  std::size_t num_steps = 0;
  for (int round = 0; round < 60; ++round) {
    const double radius_m = std::vector<double>{0.0, 0.03, 0.1, 0.15}[round % 4];
    NavigationGrid grid = randomGrid(engine, 40, 40, round % 4 == 0 ? 0.3 : 0.02, 0.01);
    const Eigen::Vector2d start = grid.centerOf(20, 20);
    for (int row = 15; row <= 25; ++row) {
      for (int column = 15; column <= 25; ++column) grid.state[grid.index(column, row)] = SpaceState::kFree;
    }
    const DistanceField field(grid, start, radius_m);
    std::uniform_real_distribution<double> place(0.0, 2.0);
    for (int i = 0; i < 20; ++i) {
      const Eigen::Vector2d goal(place(engine), place(engine));
      const std::vector<Eigen::Vector2d> path = field.pathTo(goal);
      ASSERT_EQ(path.empty(), !std::isfinite(field.distance(goal)));
      if (path.empty()) continue;
      EXPECT_EQ(path.front(), start);
      const Eigen::Vector2i last = grid.cellOf(goal);
      EXPECT_EQ(path.back(), grid.centerOf(last.x(), last.y()));
      ASSERT_NEAR(lengthOf(path), field.distance(goal), tolerance(field.distance(goal)));
      for (std::size_t k = 1; k < path.size(); ++k) {
        ++num_steps;
        ASSERT_LE((path[k] - path[k - 1]).lpNorm<Eigen::Infinity>(), 0.05 + 1e-9);
        for (int part = 0; part <= 8; ++part) {
          // The point between cells is in several; those that are free do not count, the others at no distance do.
          const Eigen::Vector2d p = path[k - 1] + part / 8.0 * (path[k] - path[k - 1]);
          ASSERT_GT(clearance(grid, p, radius_m), radius_m - 1e-9);
        }
      }
    }
  }
  EXPECT_GT(num_steps, 5000U);
}

TEST(DistanceField, CorridorIsAsLongAsCounted) {
  const NavigationGrid grid = drawnGrid({"#######",  //
                                         "#.....#",  //
                                         "#####.#",  //
                                         "#.....#",  //
                                         "#######"},
                                        0.1);
  const DistanceField field(grid, grid.centerOf(1, 1), 0.0);
  // Four east, two north, four west: no diagonal is free of corners.
  EXPECT_NEAR(field.distance(grid.centerOf(1, 3)), 1.0, 1e-6);
  EXPECT_EQ(field.pathTo(grid.centerOf(1, 3)).size(), 11U);
  EXPECT_EQ(field.distance(grid.centerOf(1, 2)), kInf);
  EXPECT_THAT(field.pathTo(grid.centerOf(1, 2)), testing::IsEmpty());
}

TEST(DistanceField, UTurnGoesRoundTheWall) {
  // A wall from the south up to row 3; from one side of its foot to the other.
  const NavigationGrid grid = drawnGrid({".......",  //
                                         ".......",  //
                                         "...#...",  //
                                         "...#...",  //
                                         "...#..."});
  const DistanceField field(grid, grid.centerOf(2, 0), 0.0);
  // North 3, east 2, south 3: a diagonal over the wall's end would cut its corner.
  EXPECT_NEAR(field.distance(grid.centerOf(4, 0)), 8 * 0.05, 1e-6);
  // From two farther west a diagonal is worth it on either side.
  const DistanceField farther(grid, grid.centerOf(0, 0), 0.0);
  EXPECT_NEAR(farther.distance(grid.centerOf(6, 0)), 0.05 * (4 * kRoot2 + 2 + 2), 1e-6);
}

TEST(DistanceField, SpiralIsAsLongAsCounted) {
  const NavigationGrid grid = drawnGrid({"#########",  //
                                         "#.......#",  //
                                         "#.#####.#",  //
                                         "#.#...#.#",  //
                                         "#.#.###.#",  //
                                         "#.#.....#",  //
                                         "#.#######",  //
                                         "#.......#",  //
                                         "#########"},
                                        1.0);
  // From (5, 5) west 2, south 2, east 4, north 4, west 6, south 6, east 6.
  const DistanceField field(grid, grid.centerOf(5, 5), 0.4);
  EXPECT_NEAR(field.distance(grid.centerOf(7, 1)), 2 + 2 + 4 + 4 + 6 + 6 + 6, 1e-5);
  // A corridor of one cell is closed, to touch counts.
  EXPECT_EQ(DistanceField(grid, grid.centerOf(5, 5), 0.5).distance(grid.centerOf(7, 1)), kInf);
}

TEST(DistanceField, GapIsPassedOnlyByADiscThatFits) {
  NavigationGrid grid = makeGrid(40, 40, SpaceState::kFree);
  for (int row = 0; row < 40; ++row) {
    if (row < 15 || row > 27)
      grid.state[grid.index(20, row)] = row % 2 == 0 ? SpaceState::kOccupied : SpaceState::kUnknown;
  }
  // The gap is 13 cells of 5 cm wide; through the middle of its middle cell, 0.325 m from either side.
  EXPECT_TRUE(std::isfinite(DistanceField(grid, {0.5, 1.0}, 0.324).distance({1.5, 1.0})));
  EXPECT_FALSE(std::isfinite(DistanceField(grid, {0.5, 1.0}, 0.326).distance({1.5, 1.0})));
  EXPECT_FALSE(std::isfinite(DistanceField(grid, {0.5, 1.0}, 0.325).distance({1.5, 1.0})));
}

TEST(DistanceField, IsAtMostATwelfthLongerThanThePlane) {
  const NavigationGrid grid = makeGrid(120, 120, SpaceState::kFree);
  const DistanceField field(grid, grid.centerOf(60, 60), 0.1);
  double worst = 0.0;
  for (int row = 2; row < 118; ++row) {
    for (int column = 2; column < 118; ++column) {
      const Eigen::Vector2d p = grid.centerOf(column, row);
      const double straight = (p - grid.centerOf(60, 60)).norm();
      const double distance = field.distance(p);
      ASSERT_GE(distance, straight - tolerance(straight));
      if (straight > 0.0) worst = std::max(worst, distance / straight);
    }
  }
  EXPECT_LE(worst, 1.083);
  EXPECT_GE(worst, 1.08);  // and it comes near: 22.5 degrees off the axes
}

// The shortest way round a square block, in the plane: a disc's middle goes along the block's outline moved out by the
// radius, straight to the rounded corners and round them.
TEST(DistanceField, IsNearTheShortestWayOfThePlaneRoundABlock) {
  NavigationGrid grid = makeGrid(200, 120, SpaceState::kFree);
  for (int row = 40; row < 80; ++row) {
    for (int column = 80; column < 120; ++column) grid.state[grid.index(column, row)] = SpaceState::kOccupied;
  }
  const double radius_m = 0.296;
  const Eigen::Vector2d from(1.525, 3.025), to(8.475, 3.025);
  // Block: x 4 .. 6, y 2 .. 4. To the corner's circle: tangent from a point at distance d, angle to the corner and back.
  const Eigen::Vector2d corner = Eigen::Vector2d(4.0, 4.0) - from;
  const double tangent = std::sqrt(corner.squaredNorm() - radius_m * radius_m);
  const double heading = std::atan2(corner.y(), corner.x()) + std::asin(radius_m / corner.norm());
  const double plane = 2.0 * (tangent + radius_m * heading) + 2.0;
  const double distance = DistanceField(grid, from, radius_m).distance(to);
  EXPECT_GE(distance, plane - 1e-4);
  // 8.3 % and, at the two corners and the sides, a cell each that the disc's place is rounded by.
  EXPECT_LE(distance, 1.083 * plane + 4 * 0.05);
}

TEST(DistanceField, IsTheSameThereAndBack) {
  std::mt19937 engine(8);
  int num_compared = 0;
  for (int round = 0; round < 40; ++round) {
    const NavigationGrid grid = randomGrid(engine, 50, 40, 0.01, 0.01);
    std::uniform_int_distribution<int> x(0, 49), y(0, 39);
    const Eigen::Vector2d a = grid.centerOf(x(engine), y(engine));
    const Eigen::Vector2d b = grid.centerOf(x(engine), y(engine));
    if (clearance(grid, a, 0.1) <= 0.1 || clearance(grid, b, 0.1) <= 0.1) continue;
    const double there = DistanceField(grid, a, 0.1).distance(b);
    const double back = DistanceField(grid, b, 0.1).distance(a);
    ASSERT_EQ(std::isfinite(there), std::isfinite(back));
    if (!std::isfinite(there)) continue;
    EXPECT_NEAR(there, back, tolerance(there));
    ++num_compared;
  }
  EXPECT_GE(num_compared, 5);
}

TEST(DistanceField, LeavesAPileAndDoesNotRunAlongIt) {
  // A pile to the east; the robot's disc of 0.3 m reaches two cells into it.
  NavigationGrid grid = makeGrid(80, 80, SpaceState::kFree);
  for (int row = 10; row < 70; ++row) {
    for (int column = 50; column < 60; ++column) grid.state[grid.index(column, row)] = SpaceState::kOccupied;
  }
  const double radius_m = 0.296;
  const Eigen::Vector2d start = grid.centerOf(45, 40);  // 0.225 m from the pile
  const DistanceField field(grid, start, radius_m);
  EXPECT_NEAR(field.distance(grid.centerOf(20, 40)), 25 * 0.05, 1e-5);
  // As near to the pile as the robot stands, farther along it: no way, and none that begins there.
  for (int row = 12; row < 68; ++row) {
    if (row == 40) continue;
    EXPECT_EQ(field.distance(grid.centerOf(45, row)), kInf) << row;
  }
  // To a place beside the pile the way keeps clear of it once it has left.
  const Eigen::Vector2d goal = grid.centerOf(43, 60);
  const std::vector<Eigen::Vector2d> path = field.pathTo(goal);
  ASSERT_THAT(path, testing::Not(testing::IsEmpty()));
  double before = clearance(grid, start, radius_m);
  bool has_left = false;
  for (const Eigen::Vector2d& p : path) {
    const double at = clearance(grid, p, radius_m);
    EXPECT_TRUE(at > radius_m || (!has_left && at >= before));
    has_left = has_left || at > radius_m;
    before = at;
  }
}

TEST(DistanceField, LeavesAnUnknownCellOnlyToFreeOnes) {
  NavigationGrid grid = makeGrid(30, 30, SpaceState::kFree);
  grid.state[grid.index(15, 15)] = SpaceState::kUnknown;
  EXPECT_TRUE(std::isfinite(DistanceField(grid, grid.centerOf(15, 15), 0.12).distance(grid.centerOf(5, 15))));
  for (int row = 13; row <= 17; ++row) {
    for (int column = 13; column <= 17; ++column) grid.state[grid.index(column, row)] = SpaceState::kUnknown;
  }
  const DistanceField field(grid, grid.centerOf(15, 15), 0.12);
  EXPECT_EQ(field.distance(grid.centerOf(15, 15)), 0.0);
  EXPECT_EQ(field.distance(grid.centerOf(5, 15)), kInf);
}

TEST(DistanceField, OutsideThereIsNoWay) {
  const NavigationGrid grid = makeGrid(10, 10, SpaceState::kFree);
  const DistanceField inside(grid, {0.25, 0.25}, 0.0);
  EXPECT_EQ(inside.distance({0.55, 0.25}), kInf);
  EXPECT_EQ(inside.distance({kInf, 0.25}), kInf);
  EXPECT_EQ(inside.distance({std::nan(""), 0.25}), kInf);
  EXPECT_THAT(inside.pathTo({-0.1, 0.25}), testing::IsEmpty());
  EXPECT_EQ(DistanceField(grid, {-0.1, 0.2}, 0.0).distance({0.2, 0.2}), kInf);
  EXPECT_EQ(DistanceField(NavigationGrid(), {0.0, 0.0}, 0.3).distance({0.0, 0.0}), kInf);
  // The disc must not leave the grid either.
  EXPECT_EQ(DistanceField(grid, {0.25, 0.25}, 0.1).distance({0.07, 0.25}), kInf);
  EXPECT_EQ(DistanceField(grid, {0.25, 0.25}, 1e9).distance({0.4, 0.25}), kInf);
}

TEST(DistanceField, RefusesWhatIsNoDiscOrPlace) {
  const NavigationGrid grid = makeGrid(10, 10, SpaceState::kFree);
  EXPECT_THROW(DistanceField(grid, {0.1, 0.1}, -0.1), std::invalid_argument);
  EXPECT_THROW(DistanceField(grid, {0.1, 0.1}, std::nan("")), std::invalid_argument);
  EXPECT_THROW(DistanceField(grid, {0.1, 0.1}, kInf), std::invalid_argument);
  EXPECT_THROW(DistanceField(grid, {0.1, std::nan("")}, 0.1), std::invalid_argument);
}

}  // namespace
}  // namespace base_navigation
