// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/navigation_grid.h"

#include <algorithm>
#include <cmath>

namespace base_navigation {

Eigen::Vector2i NavigationGrid::cellOf(const Eigen::Vector2d& p_map) const {
  // What is far outside, or not finite, becomes a cell outside instead of an overflow.
  const auto index = [this](double coordinate_m, double origin_m_) {
    const double cell = std::floor((coordinate_m - origin_m_) / cell_size_m);
    return std::isfinite(cell) ? static_cast<int>(std::clamp(cell, -1e9, 1e9)) : -1;
  };
  return {index(p_map.x(), origin_m.x()), index(p_map.y(), origin_m.y())};
}

}  // namespace base_navigation
