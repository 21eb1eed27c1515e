// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/fall_monitor.h"

#include <algorithm>
#include <cmath>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>

namespace simulated_world {
namespace {

bool isHandledStatus(BrickStatus status) {
  return status != BrickStatus::kInPile && status != BrickStatus::kDropped;
}

bool isLost(BrickStatus status) {
  return status == BrickStatus::kDropped || status == BrickStatus::kJammed;
}

/// The brick that the tool touches and may touch, or -1.
int touchedTarget(const WorldObservation& observation, const std::string& tool_body) {
  if (!observation.target_id) return -1;
  const std::string target = brickBodyName(*observation.target_id);
  const bool is_touched = std::any_of(
      observation.contacts.begin(), observation.contacts.end(),
      [&](const RobotContact& contact) { return contact.robot_body == tool_body && contact.other_body == target; });
  return is_touched ? *observation.target_id : -1;
}

}  // namespace

std::vector<std::string> FallConfig::validate() const {
  interactive_mapping::RangeCheck check;
  check("fall_distance_m", fall_distance_m, 0.001, 10.0, "m");
  check("fall_tilt_rad", fall_tilt_rad, 0.001, 3.15, "rad");
  check("rest_window_s", rest_window_s, 0.001, 60.0, "s");
  check("rest_speed_m_per_s", rest_speed_m_per_s, 1e-6, 1.0, "m/s");
  check("rest_rate_rad_per_s", rest_rate_rad_per_s, 1e-6, 10.0, "rad/s");
  std::vector<std::string> problems = check.problems();
  if (tool_body.empty()) problems.emplace_back("tool_body = \"\", must be a name");
  return problems;
}

double tiltBetween(const Eigen::Matrix3d& R_map_before, const Eigen::Matrix3d& R_map_now) {
  const Eigen::Vector3d up_now = R_map_now * (R_map_before.transpose() * Eigen::Vector3d::UnitZ());
  return std::atan2(up_now.head<2>().norm(), up_now.z());
}

FallMonitor::FallMonitor(const FallConfig& config) : config_(config) {
  interactive_mapping::refuseIfAny("FallConfig:", config.validate());
}

bool FallMonitor::isAtRest(int id) const {
  const auto found = bricks_.find(id);
  return found != bricks_.end() && found->second.is_resting && found->second.state != State::kHandled;
}

bool FallMonitor::isResting(const Brick& brick) const {
  const PoseAt& now = brick.recent.back();
  const double reach_m = config_.rest_speed_m_per_s * config_.rest_window_s;
  const double reach_rad = config_.rest_rate_rad_per_s * config_.rest_window_s;
  // All of the window, not its ends only: a rocking brick passes through the same pose again and again.
  return std::all_of(brick.recent.begin(), brick.recent.end(), [&](const PoseAt& pose) {
    const Eigen::Quaterniond rotation_then(pose.T_map_brick.linear());
    const Eigen::Quaterniond rotation_now(now.T_map_brick.linear());
    return (pose.T_map_brick.translation() - now.T_map_brick.translation()).norm() <= reach_m &&
           rotation_then.angularDistance(rotation_now) <= reach_rad;
  });
}

std::vector<JudgeEvent> FallMonitor::observe(const WorldObservation& observation) {
  std::vector<JudgeEvent> events;
  const int touched_id = touchedTarget(observation, config_.tool_body);
  std::map<int, Brick> seen;
  for (const BrickObservation& observed : observation.bricks) {
    const auto known = bricks_.find(observed.id);
    Brick brick = known == bricks_.end() ? Brick() : std::move(known->second);
    if (known == bricks_.end()) {
      brick.reference = observed.T_map_brick;
    }
    // Who was at rest and has not stirred since still is: the window only loses poses. Most bricks sleep, at most times.
    const bool stays_at_rest = brick.is_resting && !brick.recent.empty() &&
                               brick.recent.back().T_map_brick.matrix() == observed.T_map_brick.matrix();
    brick.recent.push_back({observation.time_s, observed.T_map_brick});
    // The oldest pose kept is the last one outside of the window, so that the whole window is covered.
    while (brick.recent.size() > 2 && brick.recent[1].time_s <= observation.time_s - config_.rest_window_s) {
      brick.recent.pop_front();
    }
    brick.is_resting = stays_at_rest || isResting(brick);

    JudgeEvent event;
    event.time_s = observation.time_s;
    event.brick_id = observed.id;
    const auto measureFall = [&] {
      event.distance_m = (observed.T_map_brick.translation() - brick.reference.translation()).norm();
      event.tilt_rad = tiltBetween(brick.reference.linear(), observed.T_map_brick.linear());
    };

    const bool is_new_drop = isLost(observed.status) && !isLost(brick.status);
    brick.status = observed.status;
    if (is_new_drop) {
      ++drops_;
      event.kind = JudgeEventKind::kDrop;
      events.push_back(event);
      brick.state = State::kSettling;
      // It was carried until now: what it did before says nothing about its coming to rest.
      brick.recent.assign(1, {observation.time_s, observed.T_map_brick});
      brick.is_resting = false;
    } else if (isHandledStatus(observed.status)) {
      brick.state = State::kHandled;
    } else if (observed.id == touched_id) {
      brick.state = State::kWatched;
      brick.reference = observed.T_map_brick;
    } else if (brick.state == State::kHandled) {
      brick.state = State::kSettling;
      brick.recent.assign(1, {observation.time_s, observed.T_map_brick});
      brick.is_resting = false;
    }

    const bool has_window = observation.time_s - brick.recent.front().time_s >= config_.rest_window_s;
    if (brick.state == State::kWatched) {
      measureFall();
      if (event.distance_m > config_.fall_distance_m || event.tilt_rad > config_.fall_tilt_rad) {
        ++falls_;
        event.kind = JudgeEventKind::kFall;
        events.push_back(event);
        brick.state = State::kFalling;
        brick.fall_time_s = observation.time_s;
      }
    } else if ((brick.state == State::kFalling || brick.state == State::kSettling) && brick.is_resting && has_window) {
      if (brick.state == State::kFalling) {
        measureFall();
        event.kind = JudgeEventKind::kFallEnd;
        event.duration_s = observation.time_s - brick.fall_time_s;
        events.push_back(event);
      }
      brick.state = State::kWatched;
      brick.reference = observed.T_map_brick;
    }
    seen.emplace(observed.id, std::move(brick));
  }
  bricks_ = std::move(seen);
  return events;
}

}  // namespace simulated_world
