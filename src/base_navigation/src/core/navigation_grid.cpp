// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/navigation_grid.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>

namespace base_navigation {

Eigen::Vector2i NavigationGrid::cellOf(const Eigen::Vector2d& p_map) const {
  // What is far outside, or not finite, becomes a cell outside instead of an overflow.
  const auto index = [this](double coordinate_m, double origin_m_) {
    const double cell = std::floor((coordinate_m - origin_m_) / cell_size_m);
    return std::isfinite(cell) ? static_cast<int>(std::clamp(cell, -1e9, 1e9)) : -1;
  };
  return {index(p_map.x(), origin_m.x()), index(p_map.y(), origin_m.y())};
}

void requireValid(const NavigationGrid& grid) {
  interactive_mapping::RangeCheck check;
  check("cell_size", grid.cell_size_m, 0.01, 10.0, "m");
  check("origin.x", grid.origin_m.x(), -1e5, 1e5, "m");
  check("origin.y", grid.origin_m.y(), -1e5, 1e5, "m");
  check("width", grid.width, 0, 1e5, "cells");
  check("height", grid.height, 0, 1e5, "cells");
  interactive_mapping::refuseIfAny("impossible grid:", check.problems());
  if (grid.state.size() != static_cast<std::size_t>(grid.width) * grid.height) {
    throw std::invalid_argument("grid has " + std::to_string(grid.state.size()) + " states, must be " +
                                std::to_string(grid.width) + " * " + std::to_string(grid.height));
  }
}

std::optional<NavigationGrid> alongAxes(const NavigationGrid& grid, double yaw_rad, double max_cells) {
  const Eigen::Isometry2d T_frame_grid =
      Eigen::Translation2d(grid.origin_m) * Eigen::Rotation2Dd(yaw_rad) * Eigen::Translation2d(-grid.origin_m);
  Eigen::AlignedBox2d box;
  for (const int column : {0, grid.width}) {
    for (const int row : {0, grid.height}) {
      box.extend(T_frame_grid * (grid.origin_m + grid.cell_size_m * Eigen::Vector2d(column, row)));
    }
  }
  // Rounded: a cell of which the box covers less than half has its centre outside.
  const Eigen::Vector2d size = (box.sizes() / grid.cell_size_m).array().round();
  if (size.prod() > max_cells) return std::nullopt;
  NavigationGrid result;
  result.cell_size_m = grid.cell_size_m;
  result.origin_m = box.min();
  result.width = static_cast<int>(size.x());
  result.height = static_cast<int>(size.y());
  result.state.reserve(static_cast<std::size_t>(size.prod()));
  const Eigen::Isometry2d T_grid_frame = T_frame_grid.inverse();
  for (int row = 0; row < result.height; ++row) {
    for (int column = 0; column < result.width; ++column) {
      const Eigen::Vector2i cell = grid.cellOf(T_grid_frame * result.centerOf(column, row));
      result.state.push_back(grid.at(cell.x(), cell.y()));
    }
  }
  for (int row = 0; row < grid.height; ++row) {
    for (int column = 0; column < grid.width; ++column) {
      if (grid.at(column, row) != SpaceState::kOccupied) continue;
      const Eigen::Vector2i cell = result.cellOf(T_frame_grid * grid.centerOf(column, row));
      result.state[result.index(cell.x(), cell.y())] = SpaceState::kOccupied;
    }
  }
  return result;
}

}  // namespace base_navigation
