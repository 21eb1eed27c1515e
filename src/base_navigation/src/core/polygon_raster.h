// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "base_navigation/navigation_grid.h"
#include "base_navigation/planar.h"

namespace base_navigation {

/// Polygon and cell are both closed: what comes nearer than this touches. Far above what doubles round in a grid, far
/// below what a map knows.
constexpr double kTouch_m = 1e-9;

/// Beyond so many cells from its origin nothing is looked up in a grid: indices stay far from the end of int.
constexpr double kMaxCells = 1e8;

/// std::floor without a library call, for numbers within int.
inline int floorToInt(double value) {
  const int truncated = static_cast<int>(value);
  return truncated - (value < truncated ? 1 : 0);
}

/// A convex polygon at a pose over the cells of a grid: which cells it touches, which it covers, row by row.
class PolygonRaster {
 public:
  PolygonRaster(const NavigationGrid& grid, const Polygon& polygon, const Pose2d& pose)
      : PolygonRaster(grid.origin_m, grid.cell_size_m, polygon, pose) {}

  PolygonRaster(const Eigen::Vector2d& origin_m, double cell_size_m, const Polygon& polygon, const Pose2d& pose)
      : edges_(buffer()), touch_(kTouch_m / cell_size_m) {
    const double scale = 1.0 / cell_size_m;
    const double c = scale * std::cos(pose.yaw_rad);
    const double s = scale * std::sin(pose.yaw_rad);
    const double x = scale * (pose.x_m - origin_m.x());
    const double y = scale * (pose.y_m - origin_m.y());
    edges_.clear();
    const auto corner = [&](const Eigen::Vector2d& p) {
      return Eigen::Vector2d(x + c * p.x() - s * p.y(), y + s * p.x() + c * p.y());
    };
    Eigen::Vector2d from = corner(polygon.back());
    bottom_ = top_ = from.y();
    left_ = right_ = from.x();
    for (const Eigen::Vector2d& p : polygon) {
      const Eigen::Vector2d to = corner(p);
      left_ = std::min(left_, to.x());
      right_ = std::max(right_, to.x());
      bottom_ = std::min(bottom_, to.y());
      top_ = std::max(top_, to.y());
      const bool is_up = to.y() > from.y();
      const Eigen::Vector2d& low = is_up ? from : to;
      const Eigen::Vector2d& high = is_up ? to : from;
      // The ends of a level edge belong to its neighbours too, which are not level.
      if (high.y() > low.y()) edges_.push_back({low, high, (high.x() - low.x()) / (high.y() - low.y())});
      from = to;
    }
  }
  PolygonRaster(const PolygonRaster&) = delete;
  PolygonRaster& operator=(const PolygonRaster&) = delete;

  /// False: too far away for indices, or not finite.
  bool isIndexable() const {
    return left_ > -kMaxCells && right_ < kMaxCells && bottom_ > -kMaxCells && top_ < kMaxCells;
  }
  int firstRow() const { return floorToInt(bottom_ - touch_); }
  int lastRow() const { return floorToInt(top_ + touch_); }
  int firstColumn() const { return floorToInt(left_ - touch_); }
  int lastColumn() const { return floorToInt(right_ + touch_); }

  /// Columns [first, last] of the cells of the row that the polygon touches; firstRow() <= row <= lastRow().
  void touched(int row, int* first, int* last) const {
    double left = right_;
    double right = left_;
    clip(row - touch_, row + 1.0 + touch_, &left, &right);
    *first = floorToInt(left - touch_);
    *last = floorToInt(right + touch_);
  }

  /// Columns [first, last] of the cells of the row that lie in the polygon with all four corners; none: last < first.
  void covered(int row, int* first, int* last) const {
    *first = 0;
    *last = -1;
    if (row < bottom_ || row + 1.0 > top_) return;
    double low_left = right_, low_right = left_, high_left = right_, high_right = left_;
    clip(row, row, &low_left, &low_right);
    clip(row + 1.0, row + 1.0, &high_left, &high_right);
    *first = -floorToInt(-std::max(low_left, high_left));
    *last = floorToInt(std::min(low_right, high_right)) - 1;
  }

 private:
  struct Edge {
    Eigen::Vector2d low;
    Eigen::Vector2d high;
    double slope;  // columns per row
  };

  // Used again by the next one on this thread: no allocation per pose. Two must not live at once on a thread.
  static std::vector<Edge>& buffer() {
    static thread_local std::vector<Edge> edges;
    return edges;
  }

  // Widens [left, right] by the part of the outline with low <= y <= high.
  void clip(double low, double high, double* left, double* right) const {
    for (const Edge& edge : edges_) {
      if (edge.high.y() < low || edge.low.y() > high) continue;
      const auto widen = [&](double y) {
        // A nearly level edge has a slope that rounding makes overshoot.
        const double x = edge.low.x() + edge.slope * (y - edge.low.y());
        const double lo = std::min(edge.low.x(), edge.high.x());
        const double hi = std::max(edge.low.x(), edge.high.x());
        const double inside = std::min(std::max(x, lo), hi);
        *left = std::min(*left, inside);
        *right = std::max(*right, inside);
      };
      widen(std::max(low, edge.low.y()));
      widen(std::min(high, edge.high.y()));
    }
  }

  std::vector<Edge>& edges_;
  double touch_;  // [cells]
  double left_, right_, bottom_, top_;
};

}  // namespace base_navigation
