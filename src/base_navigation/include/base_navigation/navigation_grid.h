// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "gpis_mapping/types.h"

namespace base_navigation {

using gpis_mapping::SpaceState;

/// The ground from above, in the map frame. Cell (column, row) covers x in origin + [column, column + 1) cell sizes, y
/// likewise. Outside the grid everything is unknown.
struct NavigationGrid {
  double cell_size_m{0.05};
  Eigen::Vector2d origin_m{Eigen::Vector2d::Zero()};
  int width{0};
  int height{0};
  std::vector<SpaceState> state;  // row by row

  bool contains(int column, int row) const { return column >= 0 && row >= 0 && column < width && row < height; }
  std::size_t index(int column, int row) const { return static_cast<std::size_t>(row) * width + column; }
  SpaceState at(int column, int row) const {
    return contains(column, row) ? state[index(column, row)] : SpaceState::kUnknown;
  }
  Eigen::Vector2i cellOf(const Eigen::Vector2d& p_map) const;
  Eigen::Vector2d centerOf(int column, int row) const {
    return origin_m + cell_size_m * Eigen::Vector2d(column + 0.5, row + 0.5);
  }
};

/// Cells of 0.01 to 10 m, at most 1e5 a side, the origin within 1e5 m of the frame's, a state for each cell; else throws
/// std::invalid_argument.
void requireValid(const NavigationGrid& grid);

/// `grid`, whose axes are turned by `yaw_rad` about its origin, as a grid of the same cells along the axes of the frame. A
/// cell has the state that `grid` has at its centre; a cell that holds the centre of an occupied one is occupied, so that
/// none is lost. Nothing: more than `max_cells` would be needed.
std::optional<NavigationGrid> alongAxes(const NavigationGrid& grid, double yaw_rad, double max_cells);

}  // namespace base_navigation
