// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/motion_planner.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "tasks/tasks.h"

namespace motion_planning {
namespace {

/// The whole trajectory from the request's start, or why there is none.
ArmPlan armPlan(const TaskContext& task, const StartState& start, const Result<JointTrajectory>& trajectory) {
  if (!trajectory) return trajectory.failure();
  ArmPlan plan;
  plan.trajectory = start.withBackOff(task, *trajectory);
  return plan;
}

}  // namespace

MotionPlanner::MotionPlanner(std::shared_ptr<const ArmKinematics> arm, ManipulabilitySectors sectors,
                             const MotionPlannerConfig& config)
    : arm_(std::move(arm)), sectors_(std::move(sectors)), config_(config) {
  if (!arm_) throw std::invalid_argument("no arm");
  interactive_mapping::requireValid("impossible motion planner:", config);
}

PickPlan MotionPlanner::planPick(const PlanningContext& context, const PickTarget& target,
                                 const std::vector<ArmGoal>& stow_goals) const {
  const TaskContext task{arm_, sectors_, config_, context};
  const Result<StartState> start = findStart(task);
  if (!start) return start.failure();
  return motion_planning::planPick(task, *start, target, stow_goals);
}

ArmPlan MotionPlanner::planArm(const PlanningContext& context, const ArmGoal& goal) const {
  const TaskContext task{arm_, sectors_, config_, context};
  const Result<StartState> start = findStart(task);
  if (!start) return start.failure();
  return armPlan(task, *start, planMove(task, *start, goal));
}

ArmPlan MotionPlanner::planInspect(const PlanningContext& context, const ViewFrustum& view,
                                   const std::vector<ArmVector>& postures) const {
  const TaskContext task{arm_, sectors_, config_, context};
  const Result<StartState> start = findStart(task);
  if (!start) return start.failure();
  return armPlan(task, *start, planClearView(task, *start, view, postures));
}

}  // namespace motion_planning
