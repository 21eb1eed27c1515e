// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/outline.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <stdexcept>
#include <utility>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>
#include <opencv2/imgproc.hpp>

namespace nbv_selection {
namespace {

constexpr int kMaxSide = 4000;            // cells
constexpr double kMaxCoordinate_m = 1e5;  // farther out the lattice of cells loses digits, and no robot drives there
constexpr double kMaxUnitError = 1e-6;    // of the normal's length: a caller's float is still a unit vector
constexpr double kMinUp = 0.5;            // of the normal's z: steeper than 60 degrees is no ground
constexpr double kSameCorner_m = 1e-9;    // well above rounding at kMaxCoordinate_m, well below a cell
constexpr std::uint8_t kSet = 255;        // of a pixel
// Of maps of a simulated corner with a pile up to 0.8 m (3 maps, 266 to 570 cells of walls): 96 % of the walls' cells and
// 3 to 8 of 850 of the pile's.
constexpr double kTop_m = 0.05;   // below the highest sample, belongs to the top
constexpr double kFacesUp = 0.5;  // of the normal's z: leans less than 60 degrees

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

/// Positive if counter-clockwise. Relative to the first corner: small piles far from the origin keep their digits.
double signedArea(const OutlinePolygon& polygon) {
  double area_m2 = 0.0;
  for (std::size_t i = 1; i + 1 < polygon.size(); ++i) {
    area_m2 += 0.5 * cross(polygon[i] - polygon.front(), polygon[i + 1] - polygon.front());
  }
  return area_m2;
}

bool isBefore(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y();
}

void requireGround(const gpis_mapping::GroundPlane& ground) {
  interactive_mapping::RangeCheck check("ground.");
  check("normal.norm", ground.normal_map.norm(), 1.0 - kMaxUnitError, 1.0 + kMaxUnitError, "");
  check("normal.z", ground.normal_map.z(), kMinUp, 1.0 + kMaxUnitError, "");
  check("offset", ground.offset_m, -kMaxCoordinate_m, kMaxCoordinate_m, "m");
  interactive_mapping::refuseIfAny("impossible ground:", check.problems());
}

/// By multiples of the cell size; the position must be finite.
std::pair<int, int> latticeCell(const Eigen::Vector2d& p_map, double cell_size_m) {
  const auto index = [&](double x_m) {
    return static_cast<int>(std::floor(std::clamp(x_m, -kMaxCoordinate_m, kMaxCoordinate_m) / cell_size_m));
  };
  return {index(p_map.x()), index(p_map.y())};
}

/// By how many cells the closing grows the pile and shrinks it again: gaps of up to twice as many are closed.
int closingRadius(const OutlineConfig& config) {
  return static_cast<int>(std::ceil(0.5 * config.closing_m / config.cell_size_m - 1e-9));
}

/// See outlinePile().
std::set<std::pair<int, int>> wallCells(const MappedSurface& surface, const gpis_mapping::GroundPlane& ground,
                                        const OutlineConfig& config) {
  struct Column {
    double top_m{0.0};
    double seen_top_m{0.0};  // of the samples that face up
  };
  std::map<std::pair<int, int>, Column> columns;
  const double low_m = 0.5 * config.max_height_m;
  for (std::size_t i = 0; i < surface.points_map.size(); ++i) {
    const Eigen::Vector3d& p = surface.points_map[i];
    const double height_m = ground.heightOf(p);
    if (!p.allFinite() || height_m < low_m - kTop_m) continue;
    Column& column = columns[latticeCell(p.head<2>(), config.cell_size_m)];
    column.top_m = std::max(column.top_m, height_m);
    if (surface.normals_map[i].cast<double>().dot(ground.normal_map) > kFacesUp) {
      column.seen_top_m = std::max(column.seen_top_m, height_m);
    }
  }
  std::set<std::pair<int, int>> walls;
  for (const auto& [cell, column] : columns) {
    if (column.top_m <= low_m) continue;
    double top_m = 0.0;
    double seen_top_m = 0.0;
    for (int i = 0; i < 9; ++i) {
      const auto near = columns.find({cell.first + i % 3 - 1, cell.second + i / 3 - 1});
      if (near == columns.end()) continue;
      top_m = std::max(top_m, near->second.top_m);
      seen_top_m = std::max(seen_top_m, near->second.seen_top_m);
    }
    if (column.top_m > config.max_height_m || seen_top_m < top_m - kTop_m) walls.insert(cell);
  }
  return walls;
}

PileGrid project(const MappedSurface& surface, const gpis_mapping::GroundPlane& ground, const OutlineConfig& config,
                 const std::set<std::pair<int, int>>& walls) {
  std::set<std::pair<int, int>> no_pile;  // and what touches them
  for (const auto& [column, row] : walls) {
    for (int i = 0; i < 9; ++i) no_pile.emplace(column + i % 3 - 1, row + i / 3 - 1);
  }
  std::vector<std::size_t> kept;
  Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Vector2d high = -low;
  for (std::size_t i = 0; i < surface.points_map.size(); ++i) {
    const Eigen::Vector3d& p = surface.points_map[i];
    const double height_m = ground.heightOf(p);
    // A position that is not finite has no finite height: false for it.
    if (!(height_m >= config.min_height_m && height_m <= config.max_height_m)) continue;
    if (no_pile.count(latticeCell(p.head<2>(), config.cell_size_m)) > 0) continue;
    kept.push_back(i);
    low = low.cwiseMin(p.head<2>());
    high = high.cwiseMax(p.head<2>());
  }
  PileGrid grid;
  grid.cell_size_m = config.cell_size_m;
  if (kept.empty()) return grid;

  const double farthest_m = std::max(low.cwiseAbs().maxCoeff(), high.cwiseAbs().maxCoeff());
  if (farthest_m > kMaxCoordinate_m) {
    throw std::runtime_error("the surface is " + std::to_string(farthest_m) + " m from the map's origin, at most " +
                             std::to_string(kMaxCoordinate_m) + " m are possible");
  }
  const Eigen::Vector2d span = (high - low) / config.cell_size_m;
  if (span.maxCoeff() > kMaxSide) {
    throw std::runtime_error("the surface above the ground spans " +
                             std::to_string(static_cast<long>(span.maxCoeff())) + " cells, at most " +
                             std::to_string(kMaxSide) + " are possible");
  }
  const int border = closingRadius(config) + 1;  // what the closing grows stays inside
  // On multiples of the cell size: the lattice stays where it is while the map grows.
  grid.origin_m = ((low / config.cell_size_m).array().floor() - border) * config.cell_size_m;
  const Eigen::Vector2i last = grid.cellOf(high);
  grid.width = last.x() + 1 + border;
  grid.height = last.y() + 1 + border;
  const std::size_t cells = static_cast<std::size_t>(grid.width) * grid.height;
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  grid.is_occupied.assign(cells, 0);
  grid.height_m.assign(cells, kNan);
  grid.uncertainty.assign(cells, kNan);

  std::vector<double> sum(cells, 0.0);
  std::vector<int> number(cells, 0);
  for (const std::size_t i : kept) {
    const Eigen::Vector3d& p = surface.points_map[i];
    const Eigen::Vector2i cell = grid.cellOf(p.head<2>());
    const std::size_t index = grid.index(cell.x(), cell.y());
    grid.is_occupied[index] = 1;
    // fmax: NaN, where there was none before, gives way.
    grid.height_m[index] = std::fmax(grid.height_m[index], static_cast<float>(ground.heightOf(p)));
    if (!std::isfinite(surface.uncertainty[i])) continue;
    sum[index] += surface.uncertainty[i];
    ++number[index];
  }
  for (std::size_t i = 0; i < cells; ++i) {
    if (number[i] > 0) grid.uncertainty[i] = static_cast<float>(sum[i] / number[i]);
  }
  return grid;
}

cv::Mat close(const PileGrid& grid, int radius) {
  cv::Mat pile(grid.height, grid.width, CV_8U);
  for (int row = 0; row < grid.height; ++row) {
    for (int column = 0; column < grid.width; ++column) {
      pile.at<std::uint8_t>(row, column) = grid.is_occupied[grid.index(column, row)] != 0 ? kSet : 0;
    }
  }
  if (radius > 0) {
    const cv::Mat kernel = cv::getStructuringElement(cv::MORPH_ELLIPSE, {2 * radius + 1, 2 * radius + 1});
    cv::morphologyEx(pile, pile, cv::MORPH_CLOSE, kernel);
  }
  return pile;
}

/// The lattice of half cells: pixel 2 i is the border between cells i - 1 and i, pixel 2 i + 1 the middle of cell i. A
/// contour runs through the middles of the outermost pixels: here those are the cells' outer edges.
cv::Mat toHalfCells(const cv::Mat& pile) {
  cv::Mat pixels = cv::Mat::zeros(2 * pile.rows + 1, 2 * pile.cols + 1, CV_8U);
  for (int row = 0; row < pile.rows; ++row) {
    for (int column = 0; column < pile.cols; ++column) {
      if (pile.at<std::uint8_t>(row, column) != 0) pixels(cv::Rect(2 * column, 2 * row, 3, 3)) = kSet;
    }
  }
  return pixels;
}

/// Douglas-Peucker; with a smaller tolerance where nothing would be left [pixels]. Gives indices of the contour's
/// points, in its order.
std::vector<std::size_t> corners(const std::vector<cv::Point>& contour, double tolerance_px) {
  std::vector<cv::Point> simple;
  for (cv::approxPolyDP(contour, simple, tolerance_px, true); simple.size() < 3;
       cv::approxPolyDP(contour, simple, tolerance_px, true)) {
    tolerance_px *= 0.5;
  }
  // OpenCV gives the points, not where they are. A contour may pass a point twice (two cells that touch at a corner):
  // the next time it comes by is taken.
  std::vector<std::size_t> indices;
  std::size_t i = 0;
  for (const cv::Point& point : simple) {
    for (std::size_t k = 0; k < contour.size() && contour[i % contour.size()] != point; ++k) ++i;
    indices.push_back(i % contour.size());
  }
  return indices;
}

/// The polygon through some of the contour's points, its edges moved outwards until no point that they replace is
/// outside, by at most `tolerance_m`: what is simplified away is space beside the pile, not the pile.
OutlinePolygon wrap(const std::vector<Eigen::Vector2d>& contour, const std::vector<std::size_t>& corner_indices,
                    double tolerance_m) {
  struct Edge {
    Eigen::Vector2d direction;
    Eigen::Vector2d shift;
  };
  const std::size_t n = corner_indices.size();
  std::vector<Edge> edges;
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t begin = corner_indices[i];
    const std::size_t end = corner_indices[(i + 1) % n];
    const Eigen::Vector2d direction = (contour[end] - contour[begin]).normalized();
    const Eigen::Vector2d outward(direction.y(), -direction.x());
    double shift_m = 0.0;
    for (std::size_t k = begin; k != end; k = (k + 1) % contour.size()) {
      shift_m = std::max(shift_m, outward.dot(contour[k] - contour[begin]));
    }
    edges.push_back({direction, std::min(shift_m, tolerance_m) * outward});
  }
  OutlinePolygon polygon;
  const auto add = [&polygon](const Eigen::Vector2d& p) {
    if (polygon.empty() || (p - polygon.back()).norm() > kSameCorner_m) polygon.push_back(p);
  };
  for (std::size_t i = 0; i < n; ++i) {
    const Edge& before = edges[(i + n - 1) % n];
    const Edge& after = edges[i];
    const Eigen::Vector2d& corner = contour[corner_indices[i]];
    // Where the two moved edges meet; where that is far off (they are nearly parallel), each ends beside the corner.
    const double turn = cross(before.direction, after.direction);
    const Eigen::Vector2d meet =
        before.shift + cross(after.shift - before.shift, after.direction) / turn * before.direction;
    const double limit_m = 2.0 * std::max(before.shift.norm(), after.shift.norm());
    if (turn != 0.0 && meet.norm() <= limit_m) {
      add(corner + meet);
    } else {
      add(corner + before.shift);
      add(corner + after.shift);
    }
  }
  while (polygon.size() > 1 && (polygon.back() - polygon.front()).norm() <= kSameCorner_m) polygon.pop_back();
  return polygon;
}

OutlinePolygon toPolygon(const std::vector<cv::Point>& contour_px, const PileGrid& grid, double tolerance_m) {
  const double pixel_m = 0.5 * grid.cell_size_m;
  std::vector<std::size_t> indices = corners(contour_px, tolerance_m / pixel_m);
  std::vector<Eigen::Vector2d> contour;
  for (const cv::Point& point : contour_px)
    contour.push_back(grid.origin_m + pixel_m * Eigen::Vector2d(point.x, point.y));
  if (signedArea(contour) < 0.0) {
    std::reverse(contour.begin(), contour.end());
    for (std::size_t& index : indices) index = contour.size() - 1 - index;
    std::reverse(indices.begin(), indices.end());
  }
  OutlinePolygon polygon = wrap(contour, indices, tolerance_m);
  std::rotate(polygon.begin(), std::min_element(polygon.begin(), polygon.end(), isBefore), polygon.end());
  return polygon;
}

}  // namespace

Eigen::Vector2i PileGrid::cellOf(const Eigen::Vector2d& p_map) const {
  // What is far outside, or not finite, becomes a cell outside instead of an overflow.
  const auto index = [this](double coordinate_m, double origin) {
    const double cell = std::floor((coordinate_m - origin) / cell_size_m);
    return std::isfinite(cell) ? static_cast<int>(std::clamp(cell, -1e9, 1e9)) : -1;
  };
  return {index(p_map.x(), origin_m.x()), index(p_map.y(), origin_m.y())};
}

bool PileOutline::isWallBetween(const Eigen::Vector2d& a_map, const Eigen::Vector2d& b_map) const {
  const Eigen::Vector2d way = b_map - a_map;
  // By half cells: a wall is a cell thick at least.
  const int steps = std::max(1, static_cast<int>(std::ceil(way.norm() / (0.5 * grid.cell_size_m))));
  for (int i = 0; i <= steps; ++i) {
    const Eigen::Vector2d at_map = a_map + way * (static_cast<double>(i) / steps);
    if (walls.count(latticeCell(at_map, grid.cell_size_m)) > 0) return true;
  }
  return false;
}

PileOutline outlinePile(const MappedSurface& surface, const gpis_mapping::GroundPlane& ground,
                        const OutlineConfig& config) {
  interactive_mapping::requireValid("impossible outline:", config);
  requireGround(ground);
  const std::size_t n = surface.points_map.size();
  if (surface.normals_map.size() != n || surface.uncertainty.size() != n) {
    throw std::invalid_argument("a surface of " + std::to_string(n) + " points has " +
                                std::to_string(surface.normals_map.size()) + " normals and " +
                                std::to_string(surface.uncertainty.size()) + " uncertainties, must be as many");
  }

  PileOutline outline;
  outline.ground = ground;
  outline.walls = wallCells(surface, ground, config);
  outline.grid = project(surface, ground, config, outline.walls);
  PileGrid& grid = outline.grid;
  if (grid.width == 0) return outline;

  cv::Mat pixels = toHalfCells(close(grid, closingRadius(config)));
  std::vector<std::vector<cv::Point>> contours;
  cv::findContours(pixels.clone(), contours, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_NONE);
  const double pixel_m2 = 0.25 * grid.cell_size_m * grid.cell_size_m;
  for (std::size_t i = 0; i < contours.size(); ++i) {
    if (cv::contourArea(contours[i]) * pixel_m2 < config.min_area_m2) {
      cv::drawContours(pixels, contours, static_cast<int>(i), 0, cv::FILLED);
    } else {
      outline.polygons.push_back(toPolygon(contours[i], grid, config.tolerance_m));
    }
  }
  std::sort(outline.polygons.begin(), outline.polygons.end(), [](const OutlinePolygon& a, const OutlinePolygon& b) {
    const double area_a_m2 = signedArea(a);
    const double area_b_m2 = signedArea(b);
    return area_a_m2 != area_b_m2 ? area_a_m2 > area_b_m2 : isBefore(a.front(), b.front());
  });

  grid.is_pile.assign(grid.is_occupied.size(), 0);
  for (int row = 0; row < grid.height; ++row) {
    for (int column = 0; column < grid.width; ++column) {
      if (pixels.at<std::uint8_t>(2 * row + 1, 2 * column + 1) != 0) grid.is_pile[grid.index(column, row)] = 1;
    }
  }
  return outline;
}

}  // namespace nbv_selection
