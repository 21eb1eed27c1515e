// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>
#include <gpis_mapping/ground_projection.h>
#include <interactive_mapping_common/config/schema.h>

#include "nbv_selection/scene_model.h"

namespace nbv_selection {

struct OutlineConfig {
  double cell_size_m{0.04};
  double min_height_m{0.04};
  double max_height_m{1.0};
  double closing_m{0.12};
  double min_area_m2{0.02};
  double tolerance_m{0.03};

  static void fields(OutlineConfig& c, interactive_mapping::Fields& f) {
    f("cell_size_m", c.cell_size_m, 0.005, 0.5, "m", "cell of the grid of the pile from above");
    f("min_height_m", c.min_height_m, 0.0, 1.0, "m", "lower surface is ground, not pile");
    // A bound that is impossible itself is reported alone.
    const double lowest_m = c.min_height_m >= 0.0 && c.min_height_m <= 1.0 ? c.min_height_m : 0.0;
    f("max_height_m", c.max_height_m, std::max(0.05, lowest_m), 20.0, "m",
      "where the surface reaches higher, or higher than half of it without a top, is a wall, a post or a person, and "
      "no pile from top to bottom");
    f("closing_m", c.closing_m, 0.0, 0.5, "m", "narrower gaps are closed");
    f("min_area_m2", c.min_area_m2, 0.0, 10.0, "m2", "smaller outlines are left out as specks");
    f("tolerance_m", c.tolerance_m, 0.0, 0.5, "m", "largest error of the polygon that replaces a contour");
  }
};

/// The pile from above, on a lattice of the map's x and y. Cell (column, row) covers x in origin + [column, column + 1)
/// cell sizes, y likewise.
struct PileGrid {
  double cell_size_m{0.0};
  Eigen::Vector2d origin_m{Eigen::Vector2d::Zero()};
  int width{0};
  int height{0};
  // Row by row.
  std::vector<std::uint8_t> is_occupied;  // before closing
  std::vector<std::uint8_t> is_pile;      // after closing, without specks: what the outlines go round
  std::vector<float> height_m;            // of the pile's highest sample over the ground plane; NaN where there is none
  std::vector<float> uncertainty;         // mean of the pile's samples; NaN where there is none

  bool contains(int column, int row) const { return column >= 0 && row >= 0 && column < width && row < height; }
  std::size_t index(int column, int row) const { return static_cast<std::size_t>(row) * width + column; }
  Eigen::Vector2i cellOf(const Eigen::Vector2d& p_map) const;
};

/// A closed polygon, counter-clockwise seen from above, the pile on its left [m, map x and y]. At least three corners,
/// none twice in a row.
using OutlinePolygon = std::vector<Eigen::Vector2d>;

struct PileOutline {
  gpis_mapping::GroundPlane ground;
  PileGrid grid;
  std::vector<OutlinePolygon> polygons;  // outer outlines, the one of largest area first; equal ones by first corner
  std::set<std::pair<int, int>> walls;   // columns and rows, by multiples of the cell size from the map's origin

  /// Whether the straight line between two points [m, map x and y] passes a wall.
  bool isWallBetween(const Eigen::Vector2d& a_map, const Eigen::Vector2d& b_map) const;
};

/// Projects the surface above the ground along z (method section 5): occupancy and uncertainty grids, closing, outer
/// contours, polygons. A polygon holds the middles of all its cells; a tolerance above 1.5 cells may cut some off, by
/// less than itself. Cells that reach above the largest height are walls. So are those that reach above half of it and
/// whose highest samples and those of their neighbours all face sidewards: the mast's camera sees the top of a
/// pile. Walls, and cells that touch them, hold no pile. Samples whose position is not finite are left out; one without an uncertainty
/// counts for all but the mean. The grid covers the pile and has an empty border wide enough for the closing. So a pile
/// at the border of the map has a whole outline. Without a pile the grid has no cells. Throws std::invalid_argument for
/// an impossible config or ground, or a surface whose arrays differ in length. Throws std::runtime_error if the pile
/// spans more than 4000 cells or is farther than 1e5 m from the origin.
PileOutline outlinePile(const MappedSurface& surface, const gpis_mapping::GroundPlane& ground,
                        const OutlineConfig& config);

}  // namespace nbv_selection
