// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation_ros/navigation_markers.h"

#include <utility>

#include <interactive_mapping_common_ros/markers.h>
#include <visualization_msgs/MarkerArray.h>

#include "base_navigation_ros/conversions.h"

namespace base_navigation_ros {
namespace {

using base_navigation::NavigationPhase;
using base_navigation::Pose2d;
using interactive_mapping_ros::color;
using visualization_msgs::Marker;

geometry_msgs::Point point(const Eigen::Vector2d& p, double z_m) {
  return interactive_mapping_ros::toPoint({p.x(), p.y(), z_m});
}

}  // namespace

NavigationMarkers::NavigationMarkers(const ros::NodeHandle& private_nh, std::string map_frame,
                                     base_navigation::Polygon footprint)
    : map_frame_(std::move(map_frame)), footprint_(std::move(footprint)) {
  ros::NodeHandle handle(private_nh);
  publisher_ = handle.advertise<visualization_msgs::MarkerArray>("markers", 2, true);
}

void NavigationMarkers::show(const base_navigation::NavigationOutput& output, const Pose2d& T_map_base,
                             const std::optional<Pose2d>& goal_map, const ros::Time& stamp) {
  visualization_msgs::MarkerArray markers;
  const auto make = [&](const char* name, int type) {
    std_msgs::Header header;
    header.frame_id = map_frame_;
    header.stamp = stamp;
    return interactive_mapping_ros::makeMarker(header, name, 0, type);
  };
  const auto outline = [&](const char* name, const Pose2d& pose, const std_msgs::ColorRGBA& line_color) {
    Marker marker = make(name, Marker::LINE_STRIP);
    marker.scale.x = 0.015;
    marker.color = line_color;
    for (std::size_t i = 0; i <= footprint_.size(); ++i) {
      marker.points.push_back(point(base_navigation::transform(pose, footprint_[i % footprint_.size()]), 0.03));
    }
    // The front, so that the heading is seen.
    marker.points.push_back(point(base_navigation::transform(pose, {0.15, 0.0}), 0.03));
    marker.points.push_back(point(base_navigation::transform(pose, footprint_.back()), 0.03));
    return marker;
  };
  const bool stands = output.phase == NavigationPhase::kBlocked || output.phase == NavigationPhase::kWaitingForData;
  markers.markers.push_back(
      outline("footprint", T_map_base, stands ? color(0.9F, 0.1F, 0.1F, 1.0F) : color(0.1F, 0.6F, 0.2F, 1.0F)));

  if (goal_map) {
    markers.markers.push_back(outline("goal", *goal_map, color(0.1F, 0.3F, 0.9F, 1.0F)));
  } else {
    Marker gone = make("goal", Marker::LINE_STRIP);
    gone.action = Marker::DELETE;
    markers.markers.push_back(gone);
  }

  Marker obstacle = make("obstacle", Marker::CYLINDER);
  if (output.guard.obstacle_base && output.guard.speed_factor < 1.0) {
    obstacle.pose.position = point(base_navigation::transform(T_map_base, *output.guard.obstacle_base), 0.25);
    obstacle.scale.x = obstacle.scale.y = 0.06;
    obstacle.scale.z = 0.5;
    obstacle.color = color(0.9F, 0.3F, 0.0F, 0.9F);
  } else {
    obstacle.action = Marker::DELETE;
  }
  markers.markers.push_back(obstacle);

  Marker text = make("reason", Marker::TEXT_VIEW_FACING);
  if (!output.reason.empty()) {
    text.text = output.reason;
    text.pose.position = point(T_map_base.position(), 1.6);
    text.scale.z = 0.12;
    text.color = color(0.1F, 0.1F, 0.1F, 1.0F);
  } else {
    text.action = Marker::DELETE;
  }
  markers.markers.push_back(text);
  publisher_.publish(markers);
}

}  // namespace base_navigation_ros
