// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <vector>

#include "planning/stages.h"
#include "text.h"

namespace base_navigation {
namespace {

constexpr double kStep_m = 0.05;  // of back-off and approach

}  // namespace

std::optional<PlanFailure> blockedEnd(const PlanTask& task) {
  const FootprintVerdict at_start = task.tight.check(task.start_map);
  if (!at_start.isFree()) {
    return failureAt(at_start, BasePlanStatus::kStartOccupied, BasePlanStatus::kStartUnknown,
                     "the robot is at " + text(task.start_map.position()) + " on " + text(at_start));
  }
  const FootprintVerdict at_goal = task.tight.check(task.goal_map);
  if (at_goal.isFree()) return std::nullopt;
  return failureAt(at_goal, BasePlanStatus::kGoalOccupied, BasePlanStatus::kGoalUnknown,
                   "the footprint at the goal " + text(task.goal_map.position()) + " is on " + text(at_goal));
}

std::optional<double> tightLength(const PlanTask& task, int direction) {
  for (int i = 0; i * kStep_m <= task.config.max_back_off_m + kNothing; ++i) {
    const Pose2d pose = moveAlongArc(task.start_map, direction * i * kStep_m, 0.0);
    if (!task.tight.isFree(pose)) return std::nullopt;
    const BasePath step{moveAlongArc(pose, -direction * kStep_m, 0.0), {{direction * kStep_m, 0.0}}};
    if (i > 0 && !task.tight.check(step).isFree()) return std::nullopt;
    if (task.roomy.isFree(pose)) return i * kStep_m;
  }
  return std::nullopt;
}

ApproachRoom roomToApproach(const FootprintChecker& tight, const FootprintChecker& roomy, const Pose2d& goal_map,
                            const BasePlannerConfig& config) {
  ApproachRoom room;
  for (int i = 1; room.free_m < config.approach_m; ++i) {
    const double length_m = std::min(i * kStep_m, config.approach_m);
    const Pose2d begin = moveAlongArc(goal_map, -length_m, 0.0);
    room.blocked = tight.check(BasePath{begin, {{length_m, 0.0}}});
    if (!room.blocked.isFree()) break;
    room.free_m = length_m;
    if (length_m < config.min_approach_m - kNothing || !roomy.isFree(begin)) continue;
    room.longest_m = length_m;
    if (roomy.canTurnAt(begin)) room.turning_m = length_m;
  }
  return room;
}

Result<Approach> findApproach(const PlanTask& task) {
  const BasePlannerConfig& config = task.config;
  const ApproachRoom room = roomToApproach(task.tight, task.roomy, task.goal_map, config);
  if (room.longest_m) {
    const double length_m = room.turning_m.value_or(*room.longest_m);
    return Approach{length_m, moveAlongArc(task.goal_map, -length_m, 0.0)};
  }
  std::string message = "no straight approach to the goal " + text(task.goal_map.position()) + ": ";
  if (room.free_m < config.min_approach_m - kNothing) {
    message += "its last " + text(config.min_approach_m) + " m meet " + text(room.blocked);
  } else {
    const Pose2d begin = moveAlongArc(task.goal_map, -room.free_m, 0.0);
    message += text(room.free_m) + " m before it the footprint with its padding of " + text(config.padding_m) +
               " m meets " + text(task.roomy.check(begin));
  }
  return PlanFailure{BasePlanStatus::kNoApproach, std::move(message)};
}

Result<std::vector<Launch>> findLaunches(const PlanTask& task) {
  const double max_m = task.config.max_back_off_m;
  std::vector<Launch> launches;
  std::vector<Launch> standing;
  for (const int direction : {-1, 1}) {
    const std::optional<double> tight_m = tightLength(task, direction);
    if (!tight_m) continue;
    for (int i = static_cast<int>(std::lround(*tight_m / kStep_m)); i * kStep_m <= max_m + kNothing; ++i) {
      const double length_m = i * kStep_m;
      const Pose2d pose = moveAlongArc(task.start_map, direction * length_m, 0.0);
      const Pose2d before = moveAlongArc(task.start_map, direction * std::max(*tight_m, length_m - kStep_m), 0.0);
      if (!task.isFree(before, {{direction * away_m(before, pose), 0.0}})) break;
      if (length_m == *tight_m) standing.push_back({direction * length_m, *tight_m, pose});
      if (!task.roomy.canTurnAt(pose)) continue;
      launches.push_back({direction * length_m, *tight_m, pose});
      break;
    }
    if (!launches.empty() && launches.back().length_m == 0.0) return launches;  // no need to leave
  }
  if (launches.empty()) launches = standing;
  if (launches.size() == 2 && launches[0].length_m == 0.0 && launches[1].length_m == 0.0) launches.pop_back();
  if (!launches.empty()) return launches;
  const FootprintVerdict verdict = task.roomy.check(task.start_map);
  return failureAt(verdict, BasePlanStatus::kStartOccupied, BasePlanStatus::kStartUnknown,
                   "the robot is at " + text(task.start_map.position()) + " nearer than " +
                       text(task.config.padding_m) + " m to " + text(verdict) +
                       ", and cannot drive straight back or ahead within " + text(max_m) + " m");
}

}  // namespace base_navigation
