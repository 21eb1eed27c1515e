// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>

#include "base_navigation/base_path.h"
#include "base_navigation/navigation_grid.h"
#include "base_navigation/planar.h"

namespace base_navigation {

/// What a footprint stands on: the worst of its cells.
struct FootprintVerdict {
  SpaceState state{SpaceState::kFree};                 // occupied before unknown before free
  Eigen::Vector2d where_map{Eigen::Vector2d::Zero()};  // middle of such a cell, unless free
  Pose2d pose_map;                                     // of the base, there
  double at_m{0.0};                                    // along the path (turns count nothing), of paths

  bool isFree() const { return state == SpaceState::kFree; }
};

/// The oriented footprint against a grid. A cell that the footprint touches, however little, counts.
class FootprintChecker {
 public:
  /// Throws std::invalid_argument for an impossible footprint or padding (see padPolygon).
  FootprintChecker(std::shared_ptr<const NavigationGrid> grid, const Polygon& footprint, double padding_m);
  ~FootprintChecker();

  FootprintVerdict check(const Pose2d& T_map_base) const;
  bool isFree(const Pose2d& T_map_base) const;

  /// The first bad pose along the path from `from_m` on. Between checked poses no corner of the footprint moves farther
  /// than half a cell.
  FootprintVerdict check(const BasePath& path, double from_m = 0.0) const;

  /// Whether the circle that the padded footprint sweeps touches free cells only.
  bool canTurnAt(const Pose2d& T_map_base) const;

  /// Distance [m] from a point to the nearest cell that is not free, at least so much; 0 in such a cell.
  double clearance(const Eigen::Vector2d& p_map) const;

  const NavigationGrid& grid() const;
  const Polygon& footprint() const;  // padded
  double inscribedRadius() const;
  double circumscribedRadius() const;

 private:
  struct State;
  std::unique_ptr<const State> state_;
};

}  // namespace base_navigation
