// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/footprint_checker.h"

#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <stdexcept>

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

}  // namespace
}  // namespace base_navigation
