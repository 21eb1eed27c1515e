// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/brick_markers.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Eigenvalues>
#include <interactive_mapping_common_ros/markers.h>

#include "brick_detection_ros/conversions.h"

namespace brick_detection_ros {
namespace {

using interactive_mapping_ros::color;
using interactive_mapping_ros::makeMarker;
using interactive_mapping_ros::toPoint;
using visualization_msgs::Marker;
namespace description = mp700_ur5e_description;

constexpr double kTextHeight_m = 0.07;
constexpr double kEllipsoidSigmas = 10.0;  // radius of the uncertainty: one standard deviation is too small to see
constexpr double kArrow_m = 0.12;
constexpr float kBrickAlpha = 0.75F;  // what is inside shows through
constexpr double kTipGap_m = 0.01;    // between an arrow's tip and the face

}  // namespace

visualization_msgs::MarkerArray BrickMarkers::update(const interactive_mapping_msgs::BrickArray& bricks) {
  visualization_msgs::MarkerArray array;
  for (const interactive_mapping_msgs::Brick& brick : bricks.bricks) {
    const auto T_map_brick = interactive_mapping_ros::toIsometry(brick.pose.pose);
    if (!T_map_brick) continue;
    const int number =
        numbers_.emplace(std::make_pair(brick.id, static_cast<int>(brick.instance)), static_cast<int>(numbers_.size()))
            .first->second;

    Marker cube = makeMarker(bricks.header, "bricks", number, Marker::CUBE);
    cube.pose = brick.pose.pose;
    cube.scale = brick.size;
    const Eigen::Vector3d rgb = catalogue_.type(brick.type).color_rgb;
    cube.color = color(rgb.x(), rgb.y(), rgb.z(), kBrickAlpha);
    array.markers.push_back(cube);

    Marker text = makeMarker(bricks.header, "ids", number, Marker::TEXT_VIEW_FACING);
    const Eigen::Vector3d half(0.5 * brick.size.x, 0.5 * brick.size.y, 0.5 * brick.size.z);
    const double half_height_m = T_map_brick->linear().row(2).cwiseAbs().dot(half);
    // Over the arrow from above.
    text.pose.position = toPoint(T_map_brick->translation() +
                                 Eigen::Vector3d(0.0, 0.0, half_height_m + kTipGap_m + kArrow_m + 0.5 * kTextHeight_m));
    text.scale.z = kTextHeight_m;
    text.text = std::to_string(brick.id);
    if (brick.has_duplicate) text.text += " #" + std::to_string(brick.instance) + " (duplicate id)";
    text.color = brick.has_duplicate ? color(1.0, 0.6, 0.0, 1.0) : color(1.0, 1.0, 1.0, 1.0);
    array.markers.push_back(text);

    Eigen::Matrix3d covariance;
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        covariance(row, column) = brick.pose.covariance[static_cast<std::size_t>(6 * row + column)];
      }
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(covariance);
    Eigen::Isometry3d T_map_ellipsoid = Eigen::Isometry3d::Identity();
    T_map_ellipsoid.translation() = T_map_brick->translation();
    T_map_ellipsoid.linear() = axes.eigenvectors();
    if (T_map_ellipsoid.linear().determinant() < 0.0) T_map_ellipsoid.linear().col(0) *= -1.0;
    Marker ellipsoid = makeMarker(bricks.header, "uncertainty", number, Marker::SPHERE);
    ellipsoid.pose = toPose(T_map_ellipsoid);
    // Scales are diameters. rviz refuses a scale of 0.
    const auto diameter = [&](int axis) {
      return std::max(1e-4, 2.0 * kEllipsoidSigmas * std::sqrt(std::max(0.0, axes.eigenvalues()[axis])));
    };
    ellipsoid.scale.x = diameter(0);
    ellipsoid.scale.y = diameter(1);
    ellipsoid.scale.z = diameter(2);
    ellipsoid.color = color(0.1, 0.4, 1.0, 0.9);
    array.markers.push_back(ellipsoid);

    for (const interactive_mapping_msgs::BrickFace& face : brick.graspable_faces) {
      const auto T_map_plate = interactive_mapping_ros::toIsometry(face.pose);
      if (!T_map_plate) continue;
      Marker arrow =
          makeMarker(bricks.header, "faces", description::kNumBrickFaces * number + face.face, Marker::ARROW);
      arrow.points = {toPoint(*T_map_plate * Eigen::Vector3d(0.0, 0.0, kTipGap_m + kArrow_m)),
                      toPoint(*T_map_plate * Eigen::Vector3d(0.0, 0.0, kTipGap_m))};
      arrow.scale.x = 0.012;  // shaft's diameter, head's diameter, head's length
      arrow.scale.y = 0.030;
      arrow.scale.z = 0.035;
      const double ease = std::min(1.0, std::max(0.0, static_cast<double>(face.accessibility)));
      arrow.color = color(1.0 - ease, ease, 0.1, 1.0);
      array.markers.push_back(arrow);
    }
  }
  std::set<std::pair<std::string, int>> now;
  for (const Marker& marker : array.markers) now.emplace(marker.ns, marker.id);
  for (const auto& [ns, id] : shown_) {
    if (now.count({ns, id}) > 0) continue;
    Marker gone = makeMarker(bricks.header, ns, id, Marker::CUBE);
    gone.action = Marker::DELETE;
    array.markers.push_back(gone);
  }
  // Shown where it is, whatever tf's age: the frame is the map's.
  for (Marker& marker : array.markers) marker.header.stamp = ros::Time();
  shown_ = now;
  return array;
}

}  // namespace brick_detection_ros
