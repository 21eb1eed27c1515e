// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <interactive_mapping_msgs/MissionState.h>
#include <mp700_ur5e_description/brick_types.h>
#include <visualization_msgs/MarkerArray.h>

namespace pick_mission_ros {

/// The mission for rviz, the whole of it each time: the first marker deletes the old ones. `bricks` are translucent
/// boxes in the colour of their status. `old_places` are outlines where bricks were picked or went away. `ids` are
/// texts, `current` is a frame about the brick in work. `view` is a flat arrow at the standing pose, its tail at
/// base_link. `decision` is state and decision as text, above the view; without one above the bricks.
///
/// A brick whose pose is not known (no rotation in it, or not finite) is left out. One whose type the catalogue does
/// not know is a ball with the type's name.
visualization_msgs::MarkerArray toMarkers(const interactive_mapping_msgs::MissionState& state,
                                          const mp700_ur5e_description::BrickCatalogue& catalogue);

}  // namespace pick_mission_ros
