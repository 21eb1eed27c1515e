// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/motion_planner.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "tasks/tasks.h"

namespace motion_planning {
namespace {

/// The whole trajectory from the request's start, or why there is none.
Result<JointTrajectory> fromRequestedStart(const TaskContext& task, const StartState& start,
                                           const Result<JointTrajectory>& trajectory) {
  if (!trajectory) return trajectory;
  return start.withBackOff(task, *trajectory);
}

}  // namespace

MotionPlanner::MotionPlanner(std::shared_ptr<const ArmKinematics> arm, ManipulabilitySectors sectors,
                             const MotionPlannerConfig& config)
    : arm_(std::move(arm)), sectors_(std::move(sectors)), config_(config) {
  if (!arm_) throw std::invalid_argument("no arm");
  interactive_mapping::requireValid("impossible motion planner:", config);
}

PickResult MotionPlanner::planPick(const PlanningContext& context, const PickTarget& target,
                                   const std::vector<ArmGoal>& stow_goals) const {
  const TaskContext task{arm_, sectors_, config_, context};
  const Result<StartState> start = findStart(task);
  if (!start) return {start.failure(), {}};
  return motion_planning::planPick(task, *start, target, stow_goals);
}

Result<JointTrajectory> MotionPlanner::planArm(const PlanningContext& context, const ArmGoal& goal) const {
  const TaskContext task{arm_, sectors_, config_, context};
  const Result<StartState> start = findStart(task);
  if (!start) return start.failure();
  return fromRequestedStart(task, *start, planMove(task, *start, goal));
}

Result<JointTrajectory> MotionPlanner::planInspect(const PlanningContext& context, const ViewFrustum& view,
                                                   const std::vector<ArmVector>& postures) const {
  const TaskContext task{arm_, sectors_, config_, context};
  const Result<StartState> start = findStart(task);
  if (!start) return start.failure();
  return fromRequestedStart(task, *start, planClearView(task, *start, view, postures));
}

}  // namespace motion_planning
