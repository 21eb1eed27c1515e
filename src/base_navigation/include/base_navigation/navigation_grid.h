// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
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

}  // namespace base_navigation
