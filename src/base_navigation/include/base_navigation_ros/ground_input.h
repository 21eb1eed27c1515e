// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include <map_msgs/OccupancyGridUpdate.h>
#include <nav_msgs/OccupancyGrid.h>

#include "base_navigation/navigation_grid.h"

namespace base_navigation_ros {

/// The ground as a map server, a costmap or the own map publishes it: whole grids, and updates of a part between them.
class GroundInput {
 public:
  using Grid = std::shared_ptr<const base_navigation::NavigationGrid>;

  /// `map_frame`: what the grids must be in, a leading slash in theirs apart; `occupied_from`: see toGrid().
  GroundInput(std::string map_frame, int occupied_from);

  /// Nothing, and why: another frame, numbers that do not fit together, or an update of what the grid does not have.
  Grid take(const nav_msgs::OccupancyGrid& message, std::string* why_not);
  Grid take(const map_msgs::OccupancyGridUpdate& message, std::string* why_not);

 private:
  bool isInMap(const std::string& frame, std::string* why_not) const;

  const std::string map_frame_;
  const int occupied_from_;
  std::optional<nav_msgs::OccupancyGrid> newest_;  // updates name its cells, also where it is turned
};

}  // namespace base_navigation_ros
