// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <random>
#include <string>
#include <vector>

#include "base_navigation/navigation_grid.h"

namespace base_navigation {

inline NavigationGrid makeGrid(int width, int height, SpaceState state, double cell_size_m = 0.05,
                               const Eigen::Vector2d& origin_m = Eigen::Vector2d::Zero()) {
  NavigationGrid grid;
  grid.cell_size_m = cell_size_m;
  grid.origin_m = origin_m;
  grid.width = width;
  grid.height = height;
  grid.state.assign(static_cast<std::size_t>(width) * height, state);
  return grid;
}

/// Free, but for single cells with the given probabilities.
inline NavigationGrid randomGrid(std::mt19937& engine, int width, int height, double occupied, double unknown,
                                 double cell_size_m = 0.05, const Eigen::Vector2d& origin_m = Eigen::Vector2d::Zero()) {
  NavigationGrid grid = makeGrid(width, height, SpaceState::kFree, cell_size_m, origin_m);
  std::uniform_real_distribution<double> dice(0.0, 1.0);
  for (SpaceState& state : grid.state) {
    const double value = dice(engine);
    if (value < occupied + unknown) state = value < occupied ? SpaceState::kOccupied : SpaceState::kUnknown;
  }
  return grid;
}

/// From a drawing, north (the highest row) first: '.' free, '#' occupied, anything else unknown.
inline NavigationGrid drawnGrid(const std::vector<std::string>& rows, double cell_size_m = 0.05) {
  NavigationGrid grid =
      makeGrid(static_cast<int>(rows.at(0).size()), static_cast<int>(rows.size()), SpaceState::kUnknown, cell_size_m);
  for (int row = 0; row < grid.height; ++row) {
    const std::string& text = rows.at(grid.height - 1 - row);
    for (int column = 0; column < grid.width; ++column) {
      const char c = text.at(column);
      if (c == '.') grid.state[grid.index(column, row)] = SpaceState::kFree;
      if (c == '#') grid.state[grid.index(column, row)] = SpaceState::kOccupied;
    }
  }
  return grid;
}

}  // namespace base_navigation
