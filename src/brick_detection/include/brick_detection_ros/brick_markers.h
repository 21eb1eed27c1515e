// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <set>
#include <string>
#include <utility>

#include <interactive_mapping_msgs/BrickArray.h>
#include <mp700_ur5e_description/brick_types.h>
#include <visualization_msgs/MarkerArray.h>

namespace brick_detection_ros {

/// Bricks for rviz: `bricks` (cubes in the type's colour), `ids` (text; duplicates with their instance) and
/// `uncertainty` (ellipsoids of the position). `faces` are arrows in the magnet's direction of approach, red: hardly,
/// green: easily accessible.
class BrickMarkers {
 public:
  explicit BrickMarkers(const mp700_ur5e_description::BrickCatalogue& catalogue) : catalogue_(catalogue) {}

  /// All that is to be seen now, and what is to be removed of what the last call showed.
  visualization_msgs::MarkerArray update(const interactive_mapping_msgs::BrickArray& bricks);

 private:
  mp700_ur5e_description::BrickCatalogue catalogue_;
  std::map<std::pair<int, int>, int> numbers_;   // of a brick's markers, by its id and instance; never given to another
  std::set<std::pair<std::string, int>> shown_;  // name space and id
};

}  // namespace brick_detection_ros
