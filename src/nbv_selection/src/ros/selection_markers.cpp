// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection_ros/selection_markers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include <interactive_mapping_common_ros/markers.h>

#include "nbv_selection_ros/conversions.h"

namespace nbv_selection_ros {
namespace {

using interactive_mapping_ros::color;
using interactive_mapping_ros::makeMarker;
using interactive_mapping_ros::toPoint;
using nbv_selection::Factor;
using nbv_selection::ScoredSegment;
using nbv_selection::SegmentVerdict;
using nbv_selection::Selection;
using visualization_msgs::Marker;
using visualization_msgs::MarkerArray;

constexpr char kUtility[] = "utility";
constexpr double kBarHeight_m = 1.0;    // of a value of 1
constexpr double kGreyHeight_m = 0.25;  // of the uncertainty of what was never seen
constexpr double kBarWidth_m = 0.05;
constexpr double kLineWidth_m = 0.025;
constexpr double kAbove_m = 0.01;  // lines lie on the ground and must not vanish in it

std::vector<std::string> views() {
  std::vector<std::string> out{kUtility};
  for (std::size_t i = 0; i < nbv_selection::kNumFactors; ++i) out.emplace_back(toString(static_cast<Factor>(i)));
  return out;
}

/// The factor of that name; none for utility.
std::optional<Factor> factorOf(const std::string& view) {
  for (std::size_t i = 0; i < nbv_selection::kNumFactors; ++i) {
    if (view == toString(static_cast<Factor>(i))) return static_cast<Factor>(i);
  }
  return std::nullopt;
}

Marker outlineMarker(const Selection& selection, const std_msgs::Header& header) {
  Marker lines = makeMarker(header, "outline", 0, Marker::LINE_LIST);
  lines.scale.x = kLineWidth_m;
  lines.color = color(0.9F, 0.1F, 0.1F);
  const gpis_mapping::GroundPlane& ground = selection.outline.ground;
  for (const nbv_selection::OutlinePolygon& polygon : selection.outline.polygons) {
    for (std::size_t i = 0; i < polygon.size(); ++i) {
      for (const Eigen::Vector2d& corner : {polygon[i], polygon[(i + 1) % polygon.size()]}) {
        lines.points.push_back(toPoint({corner.x(), corner.y(), ground.zAt(corner.x(), corner.y()) + kAbove_m}));
      }
    }
  }
  return lines;
}

Marker workspaceMarker(const Selection& selection, const std_msgs::Header& header) {
  Marker line = makeMarker(header, "workspace", 0, Marker::LINE_STRIP);
  line.scale.x = kLineWidth_m;
  line.color = color(0.35F, 0.35F, 0.6F);
  for (std::size_t i = 0; i <= selection.workspace_map.size(); ++i) {
    const Eigen::Vector2d& corner = selection.workspace_map[i % selection.workspace_map.size()];
    line.points.push_back(
        toPoint({corner.x(), corner.y(), selection.outline.ground.zAt(corner.x(), corner.y()) + kAbove_m}));
  }
  return line;
}

/// The workspace's ground that was never seen.
Marker unseenMarker(const Selection& selection, const std_msgs::Header& header) {
  Marker cells = makeMarker(header, "unseen", 0, Marker::CUBE_LIST);
  cells.scale.x = cells.scale.y = 0.9 * nbv_selection::GroundFrontier::kCell_m;
  cells.scale.z = 0.005;
  cells.color = color(0.35F, 0.35F, 0.6F, 0.5F);
  for (const Eigen::Vector2d& cell : selection.unseen_map) {
    cells.points.push_back(toPoint({cell.x(), cell.y(), selection.outline.ground.zAt(cell.x(), cell.y())}));
  }
  return cells;
}

/// A bar on the ground plane at the segment.
void addBar(const ScoredSegment& scored, const gpis_mapping::GroundPlane& ground, double height_m,
            const std_msgs::ColorRGBA& tint, MarkerArray* array, Marker* bars, int* id) {
  if (!(height_m > 1e-3) || !std::isfinite(height_m)) return;
  Marker bar = *bars;
  bar.id = (*id)++;
  nbv_selection::Segment place = scored.segment;
  const Eigen::Vector3d middle = place.midpoint_map + 0.5 * height_m * ground.normal_map;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear().col(0) = place.direction_map;
  T.linear().col(1) = ground.normal_map.cross(place.direction_map);
  T.linear().col(2) = ground.normal_map;
  T.translation() = middle;
  bar.pose = toPose(T);
  bar.scale.x = bar.scale.y = kBarWidth_m;
  bar.scale.z = height_m;
  bar.color = tint;
  array->markers.push_back(bar);
}

/// The index of the largest value among candidates.
std::optional<std::size_t> largest(const Selection& selection, const std::optional<Factor>& factor) {
  if (!factor) return selection.best;
  const auto value = [&](std::size_t i) {
    return selection.segments[i].utility.factor_values[static_cast<std::size_t>(*factor)];
  };
  std::optional<std::size_t> best;
  for (std::size_t i = 0; i < selection.segments.size(); ++i) {
    if (selection.segments[i].verdict != SegmentVerdict::kCandidate) continue;
    if (!best || value(i) > value(*best)) best = i;
  }
  return best;
}

}  // namespace

SelectionMarkers::SelectionMarkers(const ros::NodeHandle& private_nh) {
  ros::NodeHandle nh(private_nh);
  for (const std::string& view : views()) {
    publishers_[view] = nh.advertise<MarkerArray>("markers/" + view, 1, true);
  }
}

void SelectionMarkers::show(const Selection& selection, const nbv_selection::RobotBody& robot,
                            const std_msgs::Header& header) {
  for (auto& [view, publisher] : publishers_) publisher.publish(toMarkers(selection, robot, view, header));
}

MarkerArray toMarkers(const Selection& selection, const nbv_selection::RobotBody& robot, const std::string& view,
                      const std_msgs::Header& header) {
  MarkerArray array;
  Marker clear = makeMarker(header, "", 0, Marker::CUBE);
  clear.action = Marker::DELETEALL;
  array.markers.push_back(clear);
  if (!selection.workspace_map.empty() && (view == kUtility || factorOf(view) == Factor::kFrontier)) {
    array.markers.push_back(workspaceMarker(selection, header));
    if (!selection.unseen_map.empty()) array.markers.push_back(unseenMarker(selection, header));
  }
  if (selection.segments.empty()) return array;
  array.markers.push_back(outlineMarker(selection, header));

  const gpis_mapping::GroundPlane& ground = selection.outline.ground;
  const std::optional<Factor> factor = factorOf(view);
  const bool is_order = factor == Factor::kPickOrder;
  const std::optional<std::size_t> best = largest(selection, factor);
  Marker bars = makeMarker(header, "bars", 0, Marker::CUBE);
  int id = 0;
  for (std::size_t i = 0; i < selection.segments.size(); ++i) {
    const ScoredSegment& scored = selection.segments[i];
    if (scored.verdict == SegmentVerdict::kIsImaginary) {
      const double share =
          selection.prior_uncertainty > 0.0 ? scored.mean_uncertainty / selection.prior_uncertainty : 0.0;
      addBar(scored, ground, kGreyHeight_m * share, color(0.55F, 0.55F, 0.55F), &array, &bars, &id);
      continue;
    }
    // It stands where another segment's bar is.
    if (scored.kind == nbv_selection::SegmentKind::kHere && best != i) continue;
    double value = scored.utility.utility;
    if (is_order) {
      value = scored.attributes.height_m;
    } else if (factor) {
      value = scored.utility.factor_values[static_cast<std::size_t>(*factor)];
    }
    // What cannot be gone to is faint.
    const float alpha = scored.verdict == SegmentVerdict::kCandidate ? 1.0F : 0.25F;
    std_msgs::ColorRGBA tint = is_order ? color(1.0F, 0.6F, 0.0F, alpha) : color(0.1F, 0.75F, 0.2F, alpha);
    if (best == i) tint = color(0.9F, 0.1F, 0.1F);
    addBar(scored, ground, kBarHeight_m * value, tint, &array, &bars, &id);
  }
  if (!best) return array;

  const nbv_selection::Segment& place = selection.segments[*best].segment;
  const Eigen::Isometry3d T_map_base = nbv_selection::standOn(ground, place.standing_map);
  Marker arrow = makeMarker(header, "arrow", 0, Marker::ARROW);
  arrow.points = {toPoint(T_map_base * Eigen::Vector3d(0.0, 0.0, 0.05)),
                  toPoint(place.midpoint_map + 0.05 * ground.normal_map)};
  arrow.scale.x = 0.04;
  arrow.scale.y = 0.1;
  arrow.scale.z = 0.12;
  arrow.color = color(0.9F, 0.1F, 0.1F);
  array.markers.push_back(arrow);

  Marker footprint = makeMarker(header, "standing", 0, Marker::LINE_STRIP);
  footprint.scale.x = kLineWidth_m;
  footprint.color = color(0.9F, 0.1F, 0.1F);
  for (std::size_t i = 0; i <= robot.footprint.size(); ++i) {
    const Eigen::Vector2d& corner = robot.footprint[i % robot.footprint.size()];
    footprint.points.push_back(toPoint(T_map_base * Eigen::Vector3d(corner.x(), corner.y(), kAbove_m)));
  }
  array.markers.push_back(footprint);

  if (factor == Factor::kManipulability && !selection.reach_samples.empty()) {
    Marker samples = makeMarker(header, "samples", 0, Marker::SPHERE_LIST);
    samples.scale.x = samples.scale.y = samples.scale.z = 0.035;
    samples.color = color(0.1F, 0.3F, 1.0F);
    for (const nbv_selection::ManipulabilitySample& sample : selection.reach_samples) {
      samples.points.push_back(toPoint(sample.p_map));
      samples.colors.push_back(color(0.1F, 0.3F, 1.0F, 0.4F + 0.6F * std::min(1.0F, sample.share)));
    }
    array.markers.push_back(samples);
  }
  return array;
}

MarkerArray toMarkers(const nbv_selection::FailureMemory& failures, const std_msgs::Header& header) {
  MarkerArray array;
  Marker clear = makeMarker(header, "", 0, Marker::CUBE);
  clear.action = Marker::DELETEALL;
  array.markers.push_back(clear);
  int id = 0;
  for (const nbv_selection::FailureMemory::Cell& cell : failures.cells()) {
    Marker square = makeMarker(header, "failures", id++, Marker::CUBE);
    square.pose.position.x = cell.center_map.x();
    square.pose.position.y = cell.center_map.y();
    square.scale.x = square.scale.y = 0.95 * cell.size_m;
    square.scale.z = 0.005;
    square.color = color(0.8F, 0.0F, 0.5F, 0.5F);
    array.markers.push_back(square);
  }
  return array;
}

}  // namespace nbv_selection_ros
