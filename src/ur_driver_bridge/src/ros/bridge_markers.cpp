// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge_ros/bridge_markers.h"

#include <cmath>
#include <string>

#include <mp700_ur5e_description/robot_names.h>

namespace ur_driver_bridge_ros {
namespace {

using interactive_mapping_msgs::ArmBridgeState;
using visualization_msgs::Marker;

constexpr double kTextHeight_m = 0.06;
constexpr double kTextBack_m = -0.25;      // from the tip, above the wrist
constexpr double kLength_m_per_N = 0.004;  // of the arrow
constexpr double kLeastForce_N = 2.0;      // less is noise

std::string textOf(const ArmBridgeState& state) {
  std::string text = state.stage;
  if (text.empty()) text = state.may_move != 0 ? "ready" : "stands";
  if (state.phase == ArmBridgeState::MOVING) text += " " + std::to_string(std::lround(100.0F * state.progress)) + " %";
  if (state.phase == ArmBridgeState::STOPPING) text += ", stopping";
  if (state.is_holding != 0 && std::isfinite(state.load)) text += ", holds a brick";
  if (state.may_move == 0) text += "\n" + state.reason;
  return text;
}

}  // namespace

visualization_msgs::MarkerArray toMarkers(const ArmBridgeState& state) {
  visualization_msgs::MarkerArray array;
  Marker text;
  text.header.frame_id = mp700_ur5e_description::kMagnetTipFrame;  // stamp zero: shown where it is, whatever tf's age
  text.ns = "state";
  text.type = Marker::TEXT_VIEW_FACING;
  text.pose.position.z = kTextBack_m;
  text.pose.orientation.w = 1.0;
  text.scale.z = kTextHeight_m;
  text.color.a = 1.0F;
  text.color.r = 1.0F;
  text.color.g = text.color.b = state.may_move != 0 ? 1.0F : 0.3F;
  text.text = textOf(state);
  array.markers.push_back(text);

  Marker arrow;
  arrow.header = text.header;
  arrow.ns = "force";
  arrow.type = Marker::ARROW;
  arrow.pose.orientation.w = 1.0;
  const double force_N = state.force_along_tool;
  if (std::isfinite(force_N) && std::abs(force_N) >= kLeastForce_N) {
    geometry_msgs::Point tip;
    tip.z = kLength_m_per_N * force_N;
    arrow.points = {geometry_msgs::Point(), tip};
    arrow.scale.x = 0.012;  // shaft and head [m]
    arrow.scale.y = 0.03;
    arrow.color.r = 1.0F;
    arrow.color.g = 0.6F;
    arrow.color.a = 1.0F;
  } else {
    arrow.action = Marker::DELETE;
  }
  array.markers.push_back(arrow);
  return array;
}

}  // namespace ur_driver_bridge_ros
