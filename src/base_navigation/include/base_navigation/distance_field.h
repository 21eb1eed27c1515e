// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "base_navigation/navigation_grid.h"

namespace base_navigation {

/// Driving distances (method.md section 6: d) from one place to all others over known-free ground. Dijkstra over the
/// grid's cells and their eight neighbours; a diagonal step costs sqrt 2 and cuts no corner. The way's disc of
/// `radius_m` touches no cell that is occupied or unknown. The result is at most 8.3 % longer than the shortest way of
/// the plane, plus what the cells round.
class DistanceField {
 public:
  /// From `from_map`, whose disc need not be free: the robot stands there. It leaves through cells that are themselves
  /// free. Throws std::invalid_argument for a negative radius or a place that is not finite.
  DistanceField(const NavigationGrid& grid, const Eigen::Vector2d& from_map, double radius_m);

  /// [m] to the middle of the cell of `p_map`; infinite: no way known.
  double distance(const Eigen::Vector2d& p_map) const;

  /// Middles of the cells of a shortest way, both ends included; empty: no way known.
  std::vector<Eigen::Vector2d> pathTo(const Eigen::Vector2d& p_map) const;

 private:
  NavigationGrid lattice_;  // without states
  std::vector<float> distance_m_;
  std::vector<int> from_;
};

}  // namespace base_navigation
