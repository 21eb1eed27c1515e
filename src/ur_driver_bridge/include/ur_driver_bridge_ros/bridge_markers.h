// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <interactive_mapping_msgs/ArmBridgeState.h>
#include <visualization_msgs/MarkerArray.h>

namespace ur_driver_bridge_ros {

/// At the magnet's tip: what the bridge does, or why it would not move (red), and the force along the tool as an arrow.
visualization_msgs::MarkerArray toMarkers(const interactive_mapping_msgs::ArmBridgeState& state);

}  // namespace ur_driver_bridge_ros
