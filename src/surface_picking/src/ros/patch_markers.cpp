// SPDX-License-Identifier: BSD-3-Clause
#include "surface_picking_ros/patch_markers.h"

#include <interactive_mapping_common_ros/markers.h>
#include <interactive_mapping_common_ros/poses.h>

namespace surface_picking_ros {

using interactive_mapping_ros::color;
using interactive_mapping_ros::makeMarker;
using interactive_mapping_ros::toPoint;
using surface_picking::BorderKind;
using surface_picking::Patch;
using visualization_msgs::Marker;

visualization_msgs::MarkerArray PatchMarkers::update(const std_msgs::Header& header,
                                                     const std::vector<Patch>& patches) {
  visualization_msgs::MarkerArray array;
  for (std::size_t i = 0; i < patches.size(); ++i) {
    const Patch& patch = patches[i];
    const int id = static_cast<int>(i);
    Marker border = makeMarker(header, "borders", id, Marker::POINTS);
    border.scale.x = border.scale.y = 0.006;
    for (const surface_picking::BorderPoint& point : patch.border) {
      border.points.push_back(toPoint(point.p_map));
      border.colors.push_back(point.kind == BorderKind::kConvex    ? color(0.1, 0.8, 0.2)
                              : point.kind == BorderKind::kConcave ? color(0.9, 0.2, 0.1)
                                                                   : color(0.6, 0.6, 0.6));
    }
    if (!border.points.empty()) array.markers.push_back(border);
    if (patch.is_large || patch.circle_radius_m <= 0.0) continue;

    constexpr double kDisc_m = 0.002;
    Eigen::Isometry3d T_map_disc = Eigen::Isometry3d::Identity();
    T_map_disc.linear() =
        Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), patch.normal_map).toRotationMatrix();
    T_map_disc.translation() = patch.circle_center_map + kDisc_m * patch.normal_map;
    Marker circle = makeMarker(header, "circles", id, Marker::CYLINDER);
    circle.pose = interactive_mapping_ros::toPose(T_map_disc);
    circle.scale.x = circle.scale.y = 2.0 * patch.circle_radius_m;
    circle.scale.z = kDisc_m;
    circle.color = color(0.2, 0.5, 1.0, 0.6);
    array.markers.push_back(circle);

    Marker normal = makeMarker(header, "normals", id, Marker::ARROW);
    normal.points = {toPoint(patch.circle_center_map), toPoint(patch.circle_center_map + 0.06 * patch.normal_map)};
    normal.scale.x = 0.005;  // shaft's diameter, head's diameter
    normal.scale.y = 0.012;
    normal.color = color(0.2, 0.5, 1.0);
    array.markers.push_back(normal);
  }
  std::set<std::pair<std::string, int>> now;
  for (const Marker& marker : array.markers) now.emplace(marker.ns, marker.id);
  for (const auto& [ns, id] : shown_) {
    if (now.count({ns, id}) > 0) continue;
    Marker gone = makeMarker(header, ns, id, Marker::CUBE);
    gone.action = Marker::DELETE;
    array.markers.push_back(gone);
  }
  // Shown where it is, whatever tf's age: the frame is the map's.
  for (Marker& marker : array.markers) marker.header.stamp = ros::Time();
  shown_ = now;
  return array;
}

}  // namespace surface_picking_ros
