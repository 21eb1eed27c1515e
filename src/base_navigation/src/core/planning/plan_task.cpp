// SPDX-License-Identifier: BSD-3-Clause
#include "planning/plan_task.h"

#include <utility>

#include "text.h"

namespace base_navigation {

PlanTask::PlanTask(const BasePlannerConfig& config_, const MotionLimits& limits_, const Polygon& footprint_,
                   const std::shared_ptr<const NavigationGrid>& grid_, const Pose2d& start_map_,
                   const Pose2d& goal_map_, const std::function<bool()>& is_cancelled)
    : config(config_),
      limits(limits_),
      footprint(footprint_),
      grid(*grid_),
      start_map(start_map_),
      goal_map(goal_map_),
      tight(grid_, footprint_, config_.goal_padding_m),
      roomy(grid_, footprint_, config_.padding_m),
      asked_(is_cancelled) {}

bool PlanTask::isCancelled() const {
  if (!is_cancelled_ && asked_ && asked_()) is_cancelled_ = true;
  return is_cancelled_;
}

bool PlanTask::isFree(const Pose2d& pose_map) const {
  return !isCancelled() && roomy.isFree(pose_map);
}

bool PlanTask::isFree(const Pose2d& from_map, const Motions& motions) const {
  return !isCancelled() && roomy.check(BasePath{from_map, motions}).isFree();
}

std::string text(const FootprintVerdict& verdict) {
  return std::string(verdict.state == SpaceState::kOccupied ? "occupied" : "unknown") + " ground at " +
         text(verdict.where_map);
}

PlanFailure failureAt(const FootprintVerdict& verdict, BasePlanStatus occupied, BasePlanStatus unknown,
                      std::string message) {
  return {verdict.state == SpaceState::kOccupied ? occupied : unknown, std::move(message)};
}

}  // namespace base_navigation
