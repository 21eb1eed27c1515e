// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/collision_monitor.h"

#include <algorithm>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>

namespace simulated_world {
std::vector<std::string> CollisionConfig::validate() const {
  interactive_mapping::RangeCheck check;
  check("end_gap_s", end_gap_s, 0.001, 60.0, "s");
  std::vector<std::string> problems = check.problems();
  const auto name = [&](const char* key, const std::string& body) {
    if (body.empty()) problems.push_back(std::string(key) + " = \"\", must be a name");
  };
  name("ground_body", ground_body);
  name("tool_body", tool_body);
  name("container_body", container_body);
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
  return contact.robot_body == config_.container_body && brick->status != BrickStatus::kInPile &&
         brick->status != BrickStatus::kMovedByHand;
}

JudgeEvent CollisionMonitor::eventOf(const std::pair<const Pair, Episode>& entry, bool has_ended, double time_s) {
  const auto& [bodies, episode] = entry;
  JudgeEvent event;
  event.kind = episode.is_of_load ? has_ended ? JudgeEventKind::kLoadContactEnd : JudgeEventKind::kLoadContact
               : has_ended        ? JudgeEventKind::kCollisionEnd
                                  : JudgeEventKind::kCollision;
  event.time_s = time_s;
  event.robot_body = bodies.first;
  event.other_body = bodies.second;
  event.max_force_N = episode.max_force_N;
  event.p_map = episode.p_map;
  if (has_ended) event.duration_s = episode.last_s - episode.begin_s;
  return event;
}

std::vector<JudgeEvent> CollisionMonitor::observe(const WorldObservation& observation) {
  std::vector<JudgeEvent> events;
  for (auto it = open_.begin(); it != open_.end();) {
    if (observation.time_s - it->second.last_s > config_.end_gap_s) {
      events.push_back(eventOf(*it, true, observation.time_s));
      it = open_.erase(it);
    } else {
      ++it;
    }
  }
  for (const RobotContact& contact : observation.contacts) {
    if (!contact.is_of_load && isPermitted(contact, observation)) {
      continue;
    }
    const auto [it, is_new] = open_.emplace(
        Pair(contact.robot_body, contact.other_body),
        Episode{observation.time_s, observation.time_s, contact.force_N, contact.is_of_load, contact.p_map});
    it->second.last_s = observation.time_s;
    it->second.max_force_N = std::max(it->second.max_force_N, contact.force_N);
    if (!contact.is_of_load) max_force_N_ = std::max(max_force_N_, contact.force_N);
    if (is_new) {
      ++(contact.is_of_load ? load_contacts_ : collisions_);
      events.push_back(eventOf(*it, false, observation.time_s));
    }
  }
  return events;
}

std::vector<JudgeEvent> CollisionMonitor::finish() {
  std::vector<JudgeEvent> events;
  for (const auto& entry : open_) events.push_back(eventOf(entry, true, entry.second.last_s));
  open_.clear();
  return events;
}

}  // namespace simulated_world
