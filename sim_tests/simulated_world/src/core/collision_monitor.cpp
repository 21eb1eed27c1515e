// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/collision_monitor.h"

#include <algorithm>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>

namespace simulated_world {
namespace {

JudgeEvent eventOf(JudgeEventKind kind, const std::pair<std::string, std::string>& bodies, double time_s) {
  JudgeEvent event;
  event.kind = kind;
  event.time_s = time_s;
  event.robot_body = bodies.first;
  event.other_body = bodies.second;
  return event;
}

}  // namespace

std::vector<std::string> CollisionConfig::validate() const {
  interactive_mapping::RangeCheck check;
  check("end_gap_s", end_gap_s, 0.001, 60.0, "s");
  std::vector<std::string> problems = check.problems();
  const auto name = [&](const char* key, const std::string& body) {
    if (body.empty()) problems.push_back(std::string(key) + " = \"\", must be a name");
  };
  name("ground_body", ground_body);
  name("tool_body", tool_body);
  name("chute_body", chute_body);
  return problems;
}

CollisionMonitor::CollisionMonitor(const CollisionConfig& config) : config_(config) {
  interactive_mapping::refuseIfAny("CollisionConfig:", config.validate());
}

bool CollisionMonitor::isPermitted(const RobotContact& contact, const WorldObservation& observation) const {
  if (config_.wheel_bodies.count(contact.robot_body) > 0) {
    return contact.other_body == config_.ground_body;
  }
  const auto brick =
      std::find_if(observation.bricks.begin(), observation.bricks.end(),
                   [&contact](const BrickObservation& b) { return brickBodyName(b.id) == contact.other_body; });
  if (brick == observation.bricks.end()) {
    return false;
  }
  if (contact.robot_body == config_.tool_body) {
    return brick->id == observation.target_id || brick->status == BrickStatus::kHeld ||
           brick->status == BrickStatus::kReleased;
  }
  return contact.robot_body == config_.chute_body && brick->status != BrickStatus::kInPile &&
         brick->status != BrickStatus::kMovedByHand;
}

std::vector<JudgeEvent> CollisionMonitor::observe(const WorldObservation& observation) {
  std::vector<JudgeEvent> events;
  for (auto it = open_.begin(); it != open_.end();) {
    const Episode& episode = it->second;
    if (observation.time_s - episode.last_s > config_.end_gap_s) {
      JudgeEvent event = eventOf(JudgeEventKind::kCollisionEnd, it->first, observation.time_s);
      event.max_force_N = episode.max_force_N;
      event.duration_s = episode.last_s - episode.begin_s;
      events.push_back(event);
      it = open_.erase(it);
    } else {
      ++it;
    }
  }
  for (const RobotContact& contact : observation.contacts) {
    if (isPermitted(contact, observation)) {
      continue;
    }
    const Pair bodies(contact.robot_body, contact.other_body);
    const auto [it, is_new] = open_.emplace(bodies, Episode{observation.time_s, observation.time_s, contact.force_N});
    it->second.last_s = observation.time_s;
    it->second.max_force_N = std::max(it->second.max_force_N, contact.force_N);
    max_force_N_ = std::max(max_force_N_, contact.force_N);
    if (is_new) {
      ++collisions_;
      JudgeEvent event = eventOf(JudgeEventKind::kCollision, bodies, observation.time_s);
      event.max_force_N = contact.force_N;
      events.push_back(event);
    }
  }
  return events;
}

std::vector<JudgeEvent> CollisionMonitor::finish() {
  std::vector<JudgeEvent> events;
  for (const auto& [bodies, episode] : open_) {
    JudgeEvent event = eventOf(JudgeEventKind::kCollisionEnd, bodies, episode.last_s);
    event.max_force_N = episode.max_force_N;
    event.duration_s = episode.last_s - episode.begin_s;
    events.push_back(event);
  }
  open_.clear();
  return events;
}

}  // namespace simulated_world
