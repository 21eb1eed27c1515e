// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection_ros/conversions.h"

#include <interactive_mapping_common_ros/markers.h>

#include "nbv_selection/manipulability_score.h"

namespace nbv_selection_ros {
namespace {

using interactive_mapping_msgs::NbvSegment;
using interactive_mapping_msgs::SelectionOutcome;
using interactive_mapping_ros::toPoint;
using nbv_selection::Factor;
using nbv_selection::SelectionStatus;

geometry_msgs::Vector3 toVector(const Eigen::Vector3d& v) {
  geometry_msgs::Vector3 vector;
  vector.x = v.x();
  vector.y = v.y();
  vector.z = v.z();
  return vector;
}

NbvSegment toMessage(const nbv_selection::ScoredSegment& scored, const gpis_mapping::GroundPlane& ground) {
  const nbv_selection::Segment& segment = scored.segment;
  NbvSegment message;
  message.outline = static_cast<std::uint32_t>(segment.outline);
  message.midpoint = toPoint(segment.midpoint_map);
  message.direction = toVector(segment.direction_map);
  message.outward = toVector(segment.outward_map);
  message.length = segment.length_m;
  message.profile = segment.profile_m;
  message.standing = toPose(nbv_selection::standOn(ground, segment.standing_map));
  message.kind = static_cast<std::uint8_t>(scored.kind);
  message.verdict = static_cast<std::uint8_t>(scored.verdict);
  message.mean_uncertainty = scored.mean_uncertainty;
  message.manipulability = scored.attributes.manipulability;
  message.height = scored.attributes.height_m;
  message.distance = scored.attributes.distance_m;
  message.uncertainty = scored.attributes.uncertainty;
  message.frontier = scored.attributes.frontier;
  const auto factor = [&](Factor which) { return scored.utility.factor_values[static_cast<std::size_t>(which)]; };
  message.manipulability_factor = factor(Factor::kManipulability);
  message.pick_order_factor = factor(Factor::kPickOrder);
  message.travel_factor = factor(Factor::kTravel);
  message.uncertainty_factor = factor(Factor::kUncertainty);
  message.frontier_factor = factor(Factor::kFrontier);
  message.information = scored.utility.information;
  message.failure_penalty = scored.utility.failure_penalty;
  message.utility = scored.utility.utility;
  return message;
}

}  // namespace

std::uint8_t toStatus(SelectionStatus status) {
  switch (status) {
    case SelectionStatus::kSelected:
      return SelectionOutcome::SUCCESS;
    case SelectionStatus::kEmptyMap:
      return SelectionOutcome::EMPTY_MAP;
    case SelectionStatus::kNoGround:
      return SelectionOutcome::NO_GROUND;
    case SelectionStatus::kNoPile:
      return SelectionOutcome::NO_PILE;
    case SelectionStatus::kNoCandidate:
      return SelectionOutcome::NO_CANDIDATE;
    case SelectionStatus::kLowUtility:
      return SelectionOutcome::LOW_UTILITY;
    case SelectionStatus::kMapChanged:
      return SelectionOutcome::MAP_CHANGED;
    case SelectionStatus::kCancelled:
      return SelectionOutcome::CANCELLED;
  }
  return SelectionOutcome::NUM_STATUS;
}

interactive_mapping_msgs::NbvSelection toMessage(const nbv_selection::Selection& selection, const std::string& strategy,
                                                 const std_msgs::Header& header) {
  interactive_mapping_msgs::NbvSelection message;
  message.header = header;
  message.strategy = strategy;
  message.outcome.status = toStatus(selection.status);
  message.outcome.message = selection.message;
  message.unseen_area = selection.unseen_m2;
  message.best = selection.best ? static_cast<std::int32_t>(*selection.best) : -1;
  const gpis_mapping::GroundPlane& ground = selection.outline.ground;
  for (const nbv_selection::ScoredSegment& scored : selection.segments) {
    message.segments.push_back(toMessage(scored, ground));
  }
  for (const nbv_selection::OutlinePolygon& polygon : selection.outline.polygons) {
    for (const Eigen::Vector2d& corner : polygon) {
      message.outline.push_back(toPoint({corner.x(), corner.y(), ground.zAt(corner.x(), corner.y())}));
    }
    message.outline_sizes.push_back(static_cast<std::uint32_t>(polygon.size()));
  }
  message.map_update = selection.map_update;
  message.map_stamp = ros::Time(selection.map_stamp_s);
  return message;
}

}  // namespace nbv_selection_ros
