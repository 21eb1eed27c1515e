// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <set>
#include <string>
#include <utility>
#include <vector>

#include <std_msgs/Header.h>
#include <visualization_msgs/MarkerArray.h>

#include "surface_picking/patches.h"

namespace surface_picking_ros {

/// Patches for rviz: `borders` (points), `circles` (the largest circle in each) and `normals` (arrows). Borders are
/// green where a face ends, red where something is before it, grey where the surface was not seen on. Large patches
/// have borders alone.
class PatchMarkers {
 public:
  /// All that is to be seen now, and what is to be removed of what the last call showed.
  visualization_msgs::MarkerArray update(const std_msgs::Header& header,
                                         const std::vector<surface_picking::Patch>& patches);

 private:
  std::set<std::pair<std::string, int>> shown_;  // name space and id
};

}  // namespace surface_picking_ros
