// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/footprint_checker.h"

#include <cmath>
#include <stdexcept>

#include <opencv2/imgproc.hpp>

#include "polygon_raster.h"

namespace base_navigation {

struct FootprintChecker::State {
  std::shared_ptr<const NavigationGrid> grid;
  Polygon footprint;
  double inscribed_m;
  double circumscribed_m;
  Eigen::Vector2d middle_base;  // of the footprint, from where a smaller circle holds all of it
  double middle_radius_m;
  std::vector<int> blocked;  // (width + 1) per row: cells of the row before the column that are not free
  cv::Mat1f corner_cells;    // from each corner of cells to the nearest cell that is not free [cells]

  // Lower bound of the distance from a point [cells, from the grid's origin] to the nearest cell that is not free, and
  // an upper one. Distances from a corner of the lattice to squares of the lattice are exact: the nearest point of such
  // a square is a corner too. From there to the point it is a Lipschitz bound.
  struct Bounds {
    double low;
    double high;
  };
  Bounds bounds(double x, double y) const {
    if (!(x >= 0.0 && y >= 0.0 && x <= grid->width && y <= grid->height)) return {0.0, 0.0};
    const int column = floorToInt(x + 0.5);
    const int row = floorToInt(y + 0.5);
    const double distance = corner_cells(row, column);
    const double off = std::sqrt((x - column) * (x - column) + (y - row) * (y - row));
    // OpenCV's distances are floats: their rounding, relative, is below 1e-6.
    return {distance * (1.0 - 1e-6) - off, distance * (1.0 + 1e-6) + off};
  }
};

FootprintChecker::FootprintChecker(std::shared_ptr<const NavigationGrid> grid, const Polygon& footprint,
                                   double padding_m) {
  if (!grid) throw std::invalid_argument("no grid");
  auto state = std::make_unique<State>();
  state->footprint = padPolygon(footprint, padding_m);
  state->inscribed_m = base_navigation::inscribedRadius(state->footprint);
  state->circumscribed_m = base_navigation::circumscribedRadius(state->footprint);
  Eigen::Vector2d low = state->footprint[0];
  Eigen::Vector2d high = low;
  for (const Eigen::Vector2d& corner : state->footprint) {
    low = low.cwiseMin(corner);
    high = high.cwiseMax(corner);
  }
  state->middle_base = 0.5 * (low + high);
  state->middle_radius_m = 0.0;
  for (const Eigen::Vector2d& corner : state->footprint) {
    state->middle_radius_m = std::max(state->middle_radius_m, (corner - state->middle_base).norm());
  }

  const int width = grid->width;
  const int height = grid->height;
  state->blocked.resize(static_cast<std::size_t>(width + 1) * height);
  cv::Mat1b corners(height + 1, width + 1, static_cast<std::uint8_t>(1));  // 0: of a cell that is not free
  corners.row(0).setTo(0);                                                 // what is outside is unknown
  corners.row(height).setTo(0);
  corners.col(0).setTo(0);
  corners.col(width).setTo(0);
  for (int row = 0; row < height; ++row) {
    int* sum = &state->blocked[static_cast<std::size_t>(width + 1) * row];
    std::uint8_t* below = corners[row];
    std::uint8_t* above = corners[row + 1];
    *sum = 0;
    for (int column = 0; column < width; ++column) {
      const bool is_blocked = grid->state[grid->index(column, row)] != SpaceState::kFree;
      sum[column + 1] = sum[column] + (is_blocked ? 1 : 0);
      if (is_blocked) below[column] = below[column + 1] = above[column] = above[column + 1] = 0;
    }
  }
  cv::distanceTransform(corners, state->corner_cells, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  state->grid = std::move(grid);
  state_ = std::move(state);
}

FootprintChecker::~FootprintChecker() = default;

FootprintVerdict FootprintChecker::check(const Pose2d& T_map_base) const {
  FootprintVerdict verdict;
  verdict.pose_map = T_map_base;
  const NavigationGrid& grid = *state_->grid;
  const PolygonRaster raster(grid, state_->footprint, T_map_base);
  if (!raster.isIndexable()) {
    verdict.state = SpaceState::kUnknown;
    verdict.where_map = T_map_base.position();
    return verdict;
  }
  for (int row = raster.firstRow(); row <= raster.lastRow(); ++row) {
    int first, last;
    raster.touched(row, &first, &last);
    if (row >= 0 && row < grid.height && first >= 0 && last < grid.width) {
      const int* sum = &state_->blocked[static_cast<std::size_t>(grid.width + 1) * row];
      if (sum[first] == sum[last + 1]) continue;
    }
    for (int column = first; column <= last; ++column) {
      const SpaceState cell = grid.at(column, row);
      if (cell == SpaceState::kFree || (cell == SpaceState::kUnknown && !verdict.isFree())) continue;
      verdict.state = cell;
      verdict.where_map = grid.centerOf(column, row);
      if (cell == SpaceState::kOccupied) return verdict;
    }
  }
  return verdict;
}

bool FootprintChecker::isFree(const Pose2d& T_map_base) const {
  const NavigationGrid& grid = *state_->grid;
  if (!std::isfinite(T_map_base.yaw_rad)) return false;
  const double scale = 1.0 / grid.cell_size_m;
  // All of it is free, or some of it is not, whichever way it is turned.
  const State::Bounds origin =
      state_->bounds(scale * (T_map_base.x_m - grid.origin_m.x()), scale * (T_map_base.y_m - grid.origin_m.y()));
  if (origin.low > scale * (state_->circumscribed_m + kTouch_m)) return true;
  if (origin.high < scale * state_->inscribed_m) return false;
  const Eigen::Vector2d middle = scale * (transform(T_map_base, state_->middle_base) - grid.origin_m);
  if (state_->bounds(middle.x(), middle.y()).low > scale * (state_->middle_radius_m + kTouch_m)) return true;

  const PolygonRaster raster(grid, state_->footprint, T_map_base);
  if (!raster.isIndexable() || raster.firstColumn() < 0 || raster.firstRow() < 0 || raster.lastColumn() >= grid.width ||
      raster.lastRow() >= grid.height) {
    return false;
  }
  const int last_row = raster.lastRow();
  for (int row = raster.firstRow(); row <= last_row; ++row) {
    int first, last;
    raster.touched(row, &first, &last);
    const int* sum = &state_->blocked[static_cast<std::size_t>(grid.width + 1) * row];
    if (sum[first] != sum[last + 1]) return false;
  }
  return true;
}

FootprintVerdict FootprintChecker::check(const BasePath& path, double from_m) const {
  for (const BasePath::Sample& sample : path.sample(0.5 * state_->grid->cell_size_m, state_->circumscribed_m)) {
    if (sample.at_m < from_m || isFree(sample.pose)) continue;
    FootprintVerdict verdict = check(sample.pose);
    verdict.at_m = sample.at_m;
    return verdict;
  }
  return {};
}

double FootprintChecker::clearance(const Eigen::Vector2d& p_map) const {
  const NavigationGrid& grid = *state_->grid;
  const Eigen::Vector2d p = (p_map - grid.origin_m) / grid.cell_size_m;
  return grid.cell_size_m * std::max(0.0, state_->bounds(p.x(), p.y()).low);
}

const NavigationGrid& FootprintChecker::grid() const {
  return *state_->grid;
}
const Polygon& FootprintChecker::footprint() const {
  return state_->footprint;
}
double FootprintChecker::inscribedRadius() const {
  return state_->inscribed_m;
}
double FootprintChecker::circumscribedRadius() const {
  return state_->circumscribed_m;
}

bool FootprintChecker::canTurnAt(const Pose2d& T_map_base) const {
  const NavigationGrid& cells = grid();
  const double radius_m = circumscribedRadius();
  const Eigen::Vector2d p_map = T_map_base.position();
  if (clearance(p_map) > radius_m) return true;
  // The clearance is a lower bound: the last word have the cells.
  const Eigen::Vector2i low = cells.cellOf(p_map - Eigen::Vector2d::Constant(radius_m));
  const Eigen::Vector2i high = cells.cellOf(p_map + Eigen::Vector2d::Constant(radius_m));
  for (int row = low.y(); row <= high.y(); ++row) {
    for (int column = low.x(); column <= high.x(); ++column) {
      if (cells.at(column, row) == SpaceState::kFree) continue;
      const Eigen::Vector2d beside = (p_map - cells.centerOf(column, row)).cwiseAbs();
      const Eigen::Vector2d gap = (beside.array() - 0.5 * cells.cell_size_m).max(0.0).matrix();
      if (gap.norm() <= radius_m) return false;
    }
  }
  return true;
}

}  // namespace base_navigation
