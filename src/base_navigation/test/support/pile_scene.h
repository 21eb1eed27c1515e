// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <memory>
#include <vector>

#include "base_navigation/base_path.h"
#include "base_navigation/navigation_grid.h"
#include "base_navigation/planar.h"
#include "support/grids.h"

namespace base_navigation {

// The simulated base.
const Polygon kBaseFootprint = {{0.296, 0.296}, {-0.527, 0.296}, {-0.527, -0.296}, {0.296, -0.296}};
const MotionLimits kBaseLimits{0.8, 0.1, 0.6, 0.2, 0.6, 1.0};

inline void fillRectangle(NavigationGrid* grid, double x0_m, double y0_m, double x1_m, double y1_m, SpaceState state) {
  for (int row = 0; row < grid->height; ++row) {
    for (int column = 0; column < grid->width; ++column) {
      const Eigen::Vector2d p = grid->centerOf(column, row);
      if (p.x() > x0_m && p.x() < x1_m && p.y() > y0_m && p.y() < y1_m) grid->state[grid->index(column, row)] = state;
    }
  }
}

inline void fillDisc(NavigationGrid* grid, const Eigen::Vector2d& middle_map, double radius_m, SpaceState state) {
  for (int row = 0; row < grid->height; ++row) {
    for (int column = 0; column < grid->width; ++column) {
      if ((grid->centerOf(column, row) - middle_map).norm() < radius_m) {
        grid->state[grid->index(column, row)] = state;
      }
    }
  }
}

/// A square pile of 4 m2 amid 20 x 20 m of known ground, and poses that face it squarely all round, as the next best
/// view is one of them.
struct PileScene {
  std::shared_ptr<const NavigationGrid> grid;
  std::vector<Pose2d> standing_map;
};

inline PileScene pileScene(double stand_off_m = 0.06, int per_side = 4) {
  NavigationGrid grid = makeGrid(400, 400, SpaceState::kFree, 0.05, {-10.0, -10.0});
  fillRectangle(&grid, -1.0, -1.0, 1.0, 1.0, SpaceState::kOccupied);
  fillRectangle(&grid, -0.8, -0.8, 0.8, 0.8, SpaceState::kUnknown);  // nobody has looked into it
  PileScene scene;
  scene.grid = std::make_shared<NavigationGrid>(std::move(grid));
  for (int side = 0; side < 4; ++side) {
    for (int k = 0; k < per_side; ++k) {
      const double along_m = -0.75 + 1.5 * k / std::max(1, per_side - 1);
      const Pose2d side_map{0.0, 0.0, side * 0.5 * M_PI};
      scene.standing_map.push_back(compose(side_map, {-1.0 - 0.296 - stand_off_m, -along_m, 0.0}));
    }
  }
  return scene;
}

}  // namespace base_navigation
