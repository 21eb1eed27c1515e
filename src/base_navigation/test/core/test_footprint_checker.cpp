// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/footprint_checker.h"

#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>

#include <gmock/gmock.h>

#include "support/grids.h"

namespace base_navigation {
namespace {

const Polygon kBody = {{0.296, 0.296}, {-0.527, 0.296}, {-0.527, -0.296}, {0.296, -0.296}};

Polygon placed(const Polygon& polygon, const Pose2d& pose) {
  Polygon result;
  for (const Eigen::Vector2d& corner : polygon) result.push_back(transform(pose, corner));
  return result;
}

// Separating axes (Gottschalk et al. 1996): two convex shapes are apart if and only if the normal of an edge of one of
// them tells them apart. Nearer than 1 nm touches.
bool isTouched(const Polygon& polygon_map, const NavigationGrid& grid, int column, int row) {
  std::vector<Eigen::Vector2d> axes = {Eigen::Vector2d::UnitX(), Eigen::Vector2d::UnitY()};
  for (std::size_t i = 0; i < polygon_map.size(); ++i) {
    const Eigen::Vector2d edge = polygon_map[(i + 1) % polygon_map.size()] - polygon_map[i];
    axes.push_back(Eigen::Vector2d(edge.y(), -edge.x()).normalized());
  }
  for (const Eigen::Vector2d& axis : axes) {
    double lo = std::numeric_limits<double>::infinity();
    double hi = -lo;
    for (const Eigen::Vector2d& corner : polygon_map) {
      lo = std::min(lo, axis.dot(corner));
      hi = std::max(hi, axis.dot(corner));
    }
    const double middle = axis.dot(grid.centerOf(column, row));
    const double half = 0.5 * grid.cell_size_m * axis.lpNorm<1>();
    if (middle - half > hi + 1e-9 || middle + half < lo - 1e-9) return false;
  }
  return true;
}

// The worst of all cells that are touched, of the grid and far around it.
SpaceState oracle(const NavigationGrid& grid, const Polygon& footprint, const Pose2d& pose) {
  const Polygon polygon = placed(footprint, pose);
  const double radius_m = circumscribedRadius(footprint) + 2.0 * grid.cell_size_m;
  const Eigen::Vector2i lo = grid.cellOf(pose.position() - Eigen::Vector2d::Constant(radius_m));
  const Eigen::Vector2i hi = grid.cellOf(pose.position() + Eigen::Vector2d::Constant(radius_m));
  SpaceState worst = SpaceState::kFree;
  for (int row = lo.y(); row <= hi.y(); ++row) {
    for (int column = lo.x(); column <= hi.x(); ++column) {
      const SpaceState state = grid.at(column, row);
      if (state == SpaceState::kFree || !isTouched(polygon, grid, column, row)) continue;
      if (state == SpaceState::kOccupied) return state;
      worst = state;
    }
  }
  return worst;
}

void expectAsOracle(const FootprintChecker& checker, const Pose2d& pose) {
  const SpaceState expected = oracle(checker.grid(), checker.footprint(), pose);
  const FootprintVerdict verdict = checker.check(pose);
  const std::string where =
      std::to_string(pose.x_m) + " " + std::to_string(pose.y_m) + " " + std::to_string(pose.yaw_rad);
  ASSERT_EQ(verdict.state, expected) << where;
  ASSERT_EQ(checker.isFree(pose), expected == SpaceState::kFree) << where;
  EXPECT_EQ(verdict.pose_map.x_m, pose.x_m);
  if (verdict.isFree()) return;
  const Eigen::Vector2i cell = checker.grid().cellOf(verdict.where_map);
  ASSERT_EQ(checker.grid().at(cell.x(), cell.y()), expected) << where;
  ASSERT_TRUE(isTouched(placed(checker.footprint(), pose), checker.grid(), cell.x(), cell.y())) << where;
}

TEST(FootprintChecker, VerdictIsThatOfSeparatingAxes) {
  std::mt19937 engine(1);
  std::uniform_real_distribution<double> yaw(-4.0, 4.0);
  std::array<int, 3> count{};
  // From crowded, where the inscribed circle decides, to a few cells in the open; the last is tiny.
  struct Case {
    int width, height;
    double occupied, unknown, cell_m;
  };
  for (const Case& c :
       {Case{60, 50, 0.01, 0.01, 0.05}, Case{80, 70, 0.0005, 0.001, 0.05}, Case{70, 40, 0.0005, 0.0, 0.1},
        Case{150, 160, 0.0002, 0.0001, 0.02}, Case{17, 14, 0.0, 0.0, 0.05}, Case{3, 2, 0.2, 0.2, 0.5}}) {
    for (int round = 0; round < 20; ++round) {
      const auto grid = std::make_shared<const NavigationGrid>(
          randomGrid(engine, c.width, c.height, c.occupied, c.unknown, c.cell_m, {-1.23, 0.77}));
      const FootprintChecker checker(grid, kBody, 0.03 * (round % 2));
      // Partly and entirely outside too.
      std::uniform_real_distribution<double> x(-0.5, c.width * c.cell_m + 0.5), y(-0.5, c.height * c.cell_m + 0.5);
      for (int i = 0; i < 120; ++i) {
        const Pose2d pose{-1.23 + x(engine), 0.77 + y(engine), i % 10 == 0 ? 0.5 * M_PI * (i / 10) : yaw(engine)};
        expectAsOracle(checker, pose);
        ++count[static_cast<int>(checker.check(pose).state)];
        if (HasFatalFailure()) return;
      }
    }
  }
  for (const int n : count) EXPECT_GT(n, 1000);  // of 14400: no verdict was left untried
}

TEST(FootprintChecker, EmptyGridIsUnknown) {
  const auto grid = std::make_shared<const NavigationGrid>();
  const FootprintChecker checker(grid, kBody, 0.0);
  for (const Pose2d& pose : {Pose2d{}, Pose2d{3.0, -2.0, 1.0}}) {
    EXPECT_EQ(checker.check(pose).state, SpaceState::kUnknown);
    EXPECT_FALSE(checker.isFree(pose));
    EXPECT_EQ(checker.clearance(pose.position()), 0.0);
  }
}

// One cell of 5 cm in the open, and a footprint that ends exactly at its side, or 1 um before.
TEST(FootprintChecker, ToTouchIsToStandOn) {
  NavigationGrid grid = makeGrid(80, 80, SpaceState::kFree);
  grid.state[grid.index(40, 40)] = SpaceState::kOccupied;  // x and y 2.00 .. 2.05
  const FootprintChecker checker(std::make_shared<const NavigationGrid>(grid),
                                 {{0.3, 0.2}, {-0.5, 0.2}, {-0.5, -0.2}, {0.3, -0.2}}, 0.0);
  const double r = 1e-6;
  for (const double off : {0.0, -r, r}) {
    const SpaceState expected = off > 0.0 ? SpaceState::kFree : SpaceState::kOccupied;
    // Front, back, left, right; turned by quarters; corner to corner.
    for (const Pose2d& pose :
         {Pose2d{1.7 - off, 2.02, 0.0}, Pose2d{2.55 + off, 2.02, 0.0}, Pose2d{2.02, 1.8 - off, 0.0},
          Pose2d{2.02, 2.25 + off, 0.0}, Pose2d{2.02, 1.7 - off, 0.5 * M_PI}, Pose2d{2.35 + off, 2.02, M_PI},
          Pose2d{2.02, 2.35 + off, -0.5 * M_PI}, Pose2d{1.7 - off, 1.8 - off, 0.0},
          Pose2d{2.55 + off, 2.25 + off, 0.0}}) {
      EXPECT_EQ(checker.check(pose).state, expected) << off << " " << pose.x_m << " " << pose.y_m;
      EXPECT_EQ(checker.isFree(pose), off > 0.0) << off << " " << pose.x_m << " " << pose.y_m;
      expectAsOracle(checker, pose);
    }
  }
  // The grid's border likewise: beyond it is unknown.
  EXPECT_EQ(checker.check(Pose2d{0.5, 1.0, 0.0}).state, SpaceState::kUnknown);
  EXPECT_EQ(checker.check(Pose2d{0.5 + r, 1.0, 0.0}).state, SpaceState::kFree);
  EXPECT_EQ(checker.check(Pose2d{3.7, 1.0, 0.0}).state, SpaceState::kUnknown);
  EXPECT_EQ(checker.check(Pose2d{3.7 - r, 1.0, 0.0}).state, SpaceState::kFree);
}

TEST(FootprintChecker, OccupiedIsWorseThanUnknown) {
  NavigationGrid grid = makeGrid(60, 60, SpaceState::kUnknown);
  const Pose2d pose{1.5, 1.5, 0.3};
  EXPECT_EQ(FootprintChecker(std::make_shared<NavigationGrid>(grid), kBody, 0.0).check(pose).state,
            SpaceState::kUnknown);
  grid.state[grid.index(30, 33)] = SpaceState::kOccupied;  // neither the first nor the last of those it stands on
  const FootprintVerdict verdict = FootprintChecker(std::make_shared<NavigationGrid>(grid), kBody, 0.0).check(pose);
  EXPECT_EQ(verdict.state, SpaceState::kOccupied);
  EXPECT_EQ(verdict.where_map, grid.centerOf(30, 33));
}

// The polygon is checked, not its circles or its bounding box: five sides, not symmetric.
TEST(FootprintChecker, AnyConvexFootprintAgrees) {
  const Polygon five = {{0.5, -0.1}, {0.45, 0.15}, {-0.2, 0.3}, {-0.6, 0.05}, {-0.1, -0.25}};
  std::mt19937 engine(3);
  std::uniform_real_distribution<double> place(0.0, 3.0), yaw(-M_PI, M_PI);
  for (int round = 0; round < 10; ++round) {
    const FootprintChecker checker(std::make_shared<NavigationGrid>(randomGrid(engine, 60, 60, 0.003, 0.003)), five,
                                   0.02);
    for (int i = 0; i < 100; ++i) {
      expectAsOracle(checker, {place(engine), place(engine), yaw(engine)});
      if (HasFatalFailure()) return;
    }
  }
}

TEST(FootprintChecker, ClearanceIsALowerBoundAndNear) {
  std::mt19937 engine(4);
  std::uniform_real_distribution<double> place(-0.3, 2.6);
  int num_positive = 0;
  for (int round = 0; round < 20; ++round) {
    const auto grid = std::make_shared<const NavigationGrid>(randomGrid(engine, 47, 41, 0.004, 0.004));
    const FootprintChecker checker(grid, kBody, 0.0);
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector2d p(place(engine), place(engine));
      double exact = std::numeric_limits<double>::infinity();
      for (int row = -7; row < 55; ++row) {
        for (int column = -7; column < 60; ++column) {
          if (grid->at(column, row) == SpaceState::kFree) continue;
          const Eigen::Vector2d off = (p - grid->centerOf(column, row)).cwiseAbs();
          exact = std::min(exact, (off - Eigen::Vector2d::Constant(0.025)).cwiseMax(0.0).norm());
        }
      }
      const double bound = checker.clearance(p);
      ASSERT_LE(bound, exact + 1e-9);
      // It is exact at corners of cells and falls by what a point is off the nearest: twice half a diagonal of 5 cm.
      ASSERT_GE(bound, exact - 0.0708);
      if (bound > 0.0) ++num_positive;
    }
  }
  EXPECT_GT(num_positive, 1000);
}

TEST(FootprintChecker, FindsTheFirstBadPoseOfAPath) {
  NavigationGrid grid = makeGrid(200, 80, SpaceState::kFree);
  for (int row = 0; row < 80; ++row) {
    grid.state[grid.index(100, row)] = SpaceState::kOccupied;  // a wall from x = 5.00
    grid.state[grid.index(160, row)] = SpaceState::kUnknown;
  }
  const FootprintChecker checker(std::make_shared<NavigationGrid>(grid), kBody, 0.0);
  BasePath path;
  path.start = {1.0, 2.0, 0.0};
  path.motions = {{7.5, 0.0}};
  const FootprintVerdict first = checker.check(path);
  EXPECT_EQ(first.state, SpaceState::kOccupied);
  // The front touches the wall at 5.0 - 0.296 - 1.0 m; steps are half a cell.
  EXPECT_GE(first.at_m, 3.704);
  EXPECT_LE(first.at_m, 3.704 + 0.025);
  EXPECT_NEAR(first.pose_map.x_m, 1.0 + first.at_m, 1e-9);
  EXPECT_NEAR(first.where_map.x(), 5.025, 1e-9);
  // From behind the wall on, with the back clear of it at 5.05 + 0.527: the unknown is next.
  const FootprintVerdict second = checker.check(path, 4.6);
  EXPECT_EQ(second.state, SpaceState::kUnknown);
  EXPECT_GE(second.at_m, 6.704);
  EXPECT_LE(second.at_m, 6.704 + 0.025);
  path.motions = {{3.5, 0.0}};
  EXPECT_TRUE(checker.check(path).isFree());
  EXPECT_TRUE(checker.check(BasePath{{1.0, 2.0, 0.0}, {}}).isFree());
  EXPECT_FALSE(checker.check(BasePath{{5.0, 2.0, 0.0}, {}}).isFree());
}

TEST(FootprintChecker, TurnOnTheSpotSweepsTheCorners) {
  NavigationGrid grid = makeGrid(80, 80, SpaceState::kFree);
  grid.state[grid.index(40, 51)] =
      SpaceState::kOccupied;  // beside the body, 0.55 m north of base_link: in reach of its back
  const FootprintChecker checker(std::make_shared<NavigationGrid>(grid), kBody, 0.0);
  BasePath path;
  path.start = {2.0, 2.0, 0.0};
  path.motions = {{0.0, 0.3}};
  EXPECT_TRUE(checker.check(path).isFree());
  path.motions = {{0.0, -2.0 * M_PI}};
  const FootprintVerdict verdict = checker.check(path);
  ASSERT_EQ(verdict.state, SpaceState::kOccupied);
  EXPECT_EQ(verdict.at_m, 0.0);
  EXPECT_EQ(verdict.where_map, grid.centerOf(40, 51));
  EXPECT_NE(verdict.pose_map.yaw_rad, 0.0);
}

TEST(FootprintChecker, WhatIsFarAwayOrNoPoseIsUnknown) {
  const double inf = std::numeric_limits<double>::infinity();
  const FootprintChecker checker(std::make_shared<NavigationGrid>(makeGrid(40, 40, SpaceState::kFree)), kBody, 0.0);
  for (const Pose2d& pose : {Pose2d{1e12, 0.0, 0.0}, Pose2d{0.0, -1e300, 0.0}, Pose2d{inf, 0.0, 0.0},
                             Pose2d{1.0, std::nan(""), 0.0}, Pose2d{1.0, 1.0, std::nan("")}, Pose2d{1.0, 1.0, inf}}) {
    EXPECT_EQ(checker.check(pose).state, SpaceState::kUnknown);
    EXPECT_FALSE(checker.isFree(pose));
  }
  EXPECT_EQ(checker.clearance({std::nan(""), 0.0}), 0.0);
  EXPECT_EQ(checker.clearance({1e300, 0.0}), 0.0);
}

TEST(FootprintChecker, RefusesWhatIsNoFootprint) {
  const auto grid = std::make_shared<const NavigationGrid>(makeGrid(4, 4, SpaceState::kFree));
  EXPECT_THROW(FootprintChecker(grid, {{1.0, 0.0}, {0.0, 1.0}}, 0.0), std::invalid_argument);
  EXPECT_THROW(FootprintChecker(grid, kBody, -0.1), std::invalid_argument);
  EXPECT_THROW(FootprintChecker(nullptr, kBody, 0.0), std::invalid_argument);
  EXPECT_THROW(FootprintChecker(grid, {{3.0, 0.0}, {2.0, 1.0}, {2.0, -1.0}}, 0.0), std::invalid_argument);
}

}  // namespace
}  // namespace base_navigation
