// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission_ros/conversions.h"

#include <algorithm>
#include <cmath>
#include <map>

#include <interactive_mapping_common_ros/poses.h>
#include <motion_planning_ros/conversions.h>

namespace pick_mission_ros {

using interactive_mapping_msgs::MissionBrick;
using interactive_mapping_msgs::MissionState;
using pick_mission::SeenBrick;

namespace {

bool isInReach(const interactive_mapping_msgs::Brick& brick, const Reach& reach) {
  const Eigen::Isometry3d T_base_map = reach.T_map_base.inverse();
  for (const auto& face : brick.graspable_faces) {
    const auto T_map_face = interactive_mapping_ros::toIsometry(face.pose);
    if (!T_map_face) continue;
    const Eigen::Isometry3d T_base_face = T_base_map * *T_map_face;
    if (reach.sectors->admits(T_base_face.translation(), T_base_face.linear().col(2), reach.T_base_armbase))
      return true;
  }
  return false;
}

nlohmann::json finite(double value) {
  if (std::isfinite(value)) return value;
  return nullptr;
}

}  // namespace

std::vector<SeenBrick> toSeenBricks(const interactive_mapping_msgs::BrickArray& bricks,
                                    const std::vector<int>& seen_now, const std::string& map_frame, const Reach& reach,
                                    std::vector<std::string>* complaints) {
  if (interactive_mapping_ros::withoutSlash(bricks.header.frame_id) != map_frame) {
    throw std::invalid_argument("bricks come in frame '" + bricks.header.frame_id + "', must be '" + map_frame + "'");
  }
  std::vector<SeenBrick> seen;
  std::map<int, std::size_t> indices;  // by id
  for (const auto& brick : bricks.bricks) {
    const auto T_map_brick = interactive_mapping_ros::toIsometry(brick.pose.pose);
    if (!T_map_brick) {
      complaints->push_back("brick " + std::to_string(brick.id) + " has an invalid pose: left out");
      continue;
    }
    const auto [known, is_new] = indices.emplace(brick.id, seen.size());
    if (!is_new) {
      seen[known->second].has_duplicate = true;
      continue;
    }
    SeenBrick one;
    one.id = brick.id;
    one.type = brick.type;
    one.T_map_brick = *T_map_brick;
    one.size_m = Eigen::Vector3d(brick.size.x, brick.size.y, brick.size.z);
    for (const auto& face : brick.graspable_faces) one.graspable_faces.push_back(face.face);
    one.has_duplicate = brick.has_duplicate != 0;
    one.is_in_sector = isInReach(brick, reach);
    one.is_seen_now = std::find(seen_now.begin(), seen_now.end(), brick.id) != seen_now.end();
    seen.push_back(one);
  }
  return seen;
}

interactive_mapping_msgs::ArmGoal placeGoal(const std::string& frame) {
  interactive_mapping_msgs::ArmGoal place;
  place.kind = interactive_mapping_msgs::ArmGoal::PLACE;
  place.place_frame = frame;
  return place;
}

interactive_mapping_msgs::PlanPickGoal toGoal(const pick_mission::command::PlanPick& plan,
                                              const std::string& map_frame) {
  interactive_mapping_msgs::PlanPickGoal goal;
  goal.brick_id = plan.brick.id;
  goal.type = plan.brick.type;
  goal.brick.header.frame_id = map_frame;
  goal.brick.pose = interactive_mapping_ros::toPose(plan.brick.T_map_brick);
  goal.faces = plan.brick.graspable_faces;
  goal.stow = {placeGoal(plan.place)};
  goal.min_map_stamp.fromSec(std::max(plan.min_map_stamp_s, 0.0));
  return goal;
}

interactive_mapping_msgs::PickBrickGoal toGoal(const SeenBrick& brick, const std::string& map_frame,
                                               const interactive_mapping_msgs::PlanPickResult& plan) {
  interactive_mapping_msgs::PickBrickGoal goal;
  goal.brick_id = brick.id;
  goal.type = brick.type;
  goal.brick.header.frame_id = map_frame;
  goal.brick.pose = interactive_mapping_ros::toPose(brick.T_map_brick);
  goal.contact = plan.contact;
  goal.held = plan.held;
  goal.approach = plan.approach;
  goal.touch = plan.touch;
  goal.lift = plan.lift;
  goal.stow = plan.stow;
  goal.let_go = true;
  return goal;
}

std::optional<pick_mission::Pose2d> toPose2d(const geometry_msgs::Pose& pose) {
  const auto T = interactive_mapping_ros::toIsometry(pose);
  if (!T) return std::nullopt;
  return interactive_mapping_ros::toPlane(*T);
}

nlohmann::json toJson(const interactive_mapping_msgs::NbvSelection& selection, double time_s) {
  nlohmann::json segments = nlohmann::json::array();
  for (const auto& segment : selection.segments) {
    segments.push_back({{"midpoint", {finite(segment.midpoint.x), finite(segment.midpoint.y)}},
                        {"kind", segment.kind},
                        {"verdict", segment.verdict},
                        {"manipulability", finite(segment.manipulability)},
                        {"height", finite(segment.height)},
                        {"distance", finite(segment.distance)},
                        {"uncertainty", finite(segment.uncertainty)},
                        {"frontier", finite(segment.frontier)},
                        {"manipulability_factor", finite(segment.manipulability_factor)},
                        {"pick_order_factor", finite(segment.pick_order_factor)},
                        {"travel_factor", finite(segment.travel_factor)},
                        {"uncertainty_factor", finite(segment.uncertainty_factor)},
                        {"frontier_factor", finite(segment.frontier_factor)},
                        {"information", finite(segment.information)},
                        {"failure_penalty", finite(segment.failure_penalty)},
                        {"utility", finite(segment.utility)}});
  }
  return {{"time_s", time_s},
          {"strategy", selection.strategy},
          {"outcome", selection.outcome.status},
          {"message", selection.outcome.message},
          {"best", selection.best},
          {"segments", segments}};
}

MissionState toMessage(const pick_mission::MissionMachine& machine, std::optional<int> current) {
  MissionState state;
  state.state = static_cast<std::uint8_t>(machine.state());
  state.brick = current.value_or(-1);
  state.end_reason = static_cast<std::uint8_t>(machine.endReason());
  state.end_message = machine.endMessage();
  state.hand = static_cast<std::uint8_t>(machine.hand());
  state.is_pause_wanted = machine.isPauseWanted() ? 1 : 0;
  state.used_s = machine.usedTime();
  const pick_mission::MissionCounts counts = machine.counts();
  state.bricks_picked = static_cast<std::uint32_t>(counts.bricks_picked);
  state.places_used = static_cast<std::uint32_t>(machine.placesUsed());
  state.bricks_open = static_cast<std::uint32_t>(counts.bricks_open);
  state.bricks_exhausted = static_cast<std::uint32_t>(counts.bricks_exhausted);
  state.picks_begun = static_cast<std::uint32_t>(counts.picks_begun);
  state.views = static_cast<std::uint32_t>(counts.views);
  state.failures = static_cast<std::uint32_t>(counts.failures);
  const pick_mission::BrickLedger& ledger = machine.bricks();
  for (const auto& [id, record] : ledger.bricks()) {
    MissionBrick brick;
    brick.id = id;
    brick.type = record.seen.type;
    brick.pose = interactive_mapping_ros::toPose(record.seen.T_map_brick);
    if (current && *current == id && !record.is_picked) {
      brick.status = MissionBrick::CURRENT;
    } else if (record.is_picked) {
      brick.status = MissionBrick::PICKED;
    } else if (ledger.isExhausted(record)) {
      brick.status = MissionBrick::EXHAUSTED;
    } else {
      brick.status = record.is_there ? MissionBrick::OPEN : MissionBrick::AWAY;
    }
    brick.picks_begun = static_cast<std::uint16_t>(record.picks_begun);
    brick.picks_failed = static_cast<std::uint16_t>(record.picks_failed);
    brick.plans_failed = static_cast<std::uint16_t>(record.plans_failed);
    brick.last_failure = record.last_failure;
    state.bricks.push_back(brick);
  }
  return state;
}

}  // namespace pick_mission_ros
