// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "base_navigation/base_path.h"
#include "base_navigation/navigation_grid.h"

namespace base_navigation {

/// Looks at paths without any of the code that makes them: poses by integration, the footprint against each cell by
/// separating axes.
class PathOracle {
 public:
  PathOracle(const NavigationGrid& grid, Polygon footprint) : grid_(grid), footprint_(std::move(footprint)) {
    for (const Eigen::Vector2d& corner : footprint_) radius_m_ = std::max(radius_m_, corner.norm());
  }

  /// No cell that is not free overlaps the footprint with its edges moved out by `padding_m` (corners rounded off: never
  /// more than FootprintChecker asks for).
  bool isFree(double x_m, double y_m, double yaw_rad, double padding_m) const {
    const double c = std::cos(yaw_rad);
    const double s = std::sin(yaw_rad);
    const double half = 0.5 * grid_.cell_size_m;
    const double reach_m = radius_m_ + 2.0 * padding_m + half;
    const auto first = [&](double value, double origin) {
      return static_cast<int>(std::floor((value - reach_m - origin) / grid_.cell_size_m));
    };
    const int cells = static_cast<int>(std::ceil(2.0 * reach_m / grid_.cell_size_m)) + 1;
    const int column0 = first(x_m, grid_.origin_m.x());
    const int row0 = first(y_m, grid_.origin_m.y());
    for (int row = row0; row <= row0 + cells; ++row) {
      for (int column = column0; column <= column0 + cells; ++column) {
        if (grid_.at(column, row) == SpaceState::kFree) continue;
        const double dx = grid_.origin_m.x() + grid_.cell_size_m * (column + 0.5) - x_m;
        const double dy = grid_.origin_m.y() + grid_.cell_size_m * (row + 0.5) - y_m;
        if (overlaps(c * dx + s * dy, c * dy - s * dx, c, s, half, padding_m)) return false;
      }
    }
    return true;
  }

  bool isDiscFree(const Eigen::Vector2d& p_map, double radius_m) const {
    for (int row = -1; row <= grid_.height; ++row) {
      for (int column = -1; column <= grid_.width; ++column) {
        if (grid_.at(column, row) == SpaceState::kFree) continue;
        const Eigen::Vector2d low = grid_.origin_m + grid_.cell_size_m * Eigen::Vector2d(column, row);
        const Eigen::Vector2d high = low + Eigen::Vector2d::Constant(grid_.cell_size_m);
        if ((p_map.cwiseMax(low).cwiseMin(high) - p_map).norm() <= radius_m) return false;
      }
    }
    return true;
  }

  /// Empty, or what is wrong with the path: no point of the footprint moves farther than 5 mm between two looks.
  /// `padding_m` holds but on the first `tight_m` and the last `approach_m`.
  std::string complain(const BasePath& path, double padding_m, double tight_m, double approach_m) const {
    double x_m = path.start.x_m;
    double y_m = path.start.y_m;
    double yaw_rad = path.start.yaw_rad;
    double total_m = 0.0;
    for (const BaseMotion& motion : path.motions) total_m += std::abs(motion.length_m);
    double at_m = 0.0;
    for (std::size_t i = 0; i < path.motions.size(); ++i) {
      const BaseMotion& motion = path.motions[i];
      const double moved_m = std::abs(motion.length_m) + radius_m_ * std::abs(motion.turn_rad);
      const int steps = static_cast<int>(std::ceil(moved_m / 0.005));
      for (int k = 0; k < steps; ++k) {
        // Midpoint rule over 5 mm: it is off by 5e-9 m a step at the smallest radius planned with.
        const double middle_rad = yaw_rad + 0.5 * motion.turn_rad / steps;
        x_m += motion.length_m / steps * std::cos(middle_rad);
        y_m += motion.length_m / steps * std::sin(middle_rad);
        yaw_rad += motion.turn_rad / steps;
        at_m += std::abs(motion.length_m) / steps;
        const bool is_tight = at_m < tight_m + 1e-6 || at_m > total_m - approach_m - 1e-6;
        // Nothing is left of a padding of 0 but rounding: a micrometre.
        if (!isFree(x_m, y_m, yaw_rad, is_tight ? -1e-6 : padding_m)) {
          return "motion " + std::to_string(i) + " at " + std::to_string(at_m) + " of " + std::to_string(total_m) +
                 " m, pose (" + std::to_string(x_m) + ", " + std::to_string(y_m) + ", " + std::to_string(yaw_rad) + ")";
        }
      }
    }
    return "";
  }

 private:
  /// Of a cell whose middle in base_link is (x, y), by separating axes. A touch is no overlap.
  bool overlaps(double x, double y, double c, double s, double half, double padding_m) const {
    // Edges of the footprint: the cell lies outside if all of its corners do.
    const std::size_t n = footprint_.size();
    for (std::size_t i = 0; i < n; ++i) {
      const Eigen::Vector2d edge = footprint_[(i + 1) % n] - footprint_[i];
      const Eigen::Vector2d out = Eigen::Vector2d(edge.y(), -edge.x()).normalized();
      const double extent = half * (std::abs(c * out.x() - s * out.y()) + std::abs(s * out.x() + c * out.y()));
      if ((Eigen::Vector2d(x, y) - footprint_[i]).dot(out) - extent >= padding_m) return false;
    }
    // Sides of the cell, its axes in base_link: (c, -s) and (s, c).
    for (const Eigen::Vector2d& axis : {Eigen::Vector2d(c, -s), Eigen::Vector2d(s, c)}) {
      double low = std::numeric_limits<double>::infinity();
      double high = -low;
      for (const Eigen::Vector2d& corner : footprint_) {
        low = std::min(low, corner.dot(axis));
        high = std::max(high, corner.dot(axis));
      }
      const double middle = Eigen::Vector2d(x, y).dot(axis);
      if (middle - half >= high + padding_m || middle + half <= low - padding_m) return false;
    }
    return true;
  }

  const NavigationGrid& grid_;
  Polygon footprint_;
  double radius_m_{0.0};
};

}  // namespace base_navigation
