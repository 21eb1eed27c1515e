// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/motion_planner.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include <gpis_mapping/range_check.h>

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

const char* toString(PlanStatus status) {
  switch (status) {
    case PlanStatus::kSuccess:
      return "success";
    case PlanStatus::kBadRequest:
      return "bad request";
    case PlanStatus::kNoMap:
      return "no map";
    case PlanStatus::kOutsideSector:
      return "outside sector";
    case PlanStatus::kNoIk:
      return "no inverse kinematics";
    case PlanStatus::kStartInCollision:
      return "start in collision";
    case PlanStatus::kGoalInCollision:
      return "goal in collision";
    case PlanStatus::kGoalUnknown:
      return "goal in unknown space";
    case PlanStatus::kApproachBlocked:
      return "approach blocked";
    case PlanStatus::kIterations:
      return "no path found";
    case PlanStatus::kConstraint:
      return "constraint";
    case PlanStatus::kCancelled:
      return "cancelled";
    case PlanStatus::kNoRobotState:
      return "no robot state";
    case PlanStatus::kOutsideLimits:
      return "outside limits";
  }
  return "unknown";
}

std::vector<std::string> MotionPlannerConfig::validate() const {
  // Sections as in config_fields.h.
  std::vector<std::string> problems;
  const auto append = [&problems](const char* section, const std::vector<std::string>& more) {
    for (const std::string& problem : more) problems.push_back(std::string(section) + problem);
  };
  append("collision/", collision.validate());
  append("search/", planner.validate());
  gpis_mapping::RangeCheck search("search/");
  search("verify_step_m", verify_step_m, 0.001, 0.1, "m");
  append("", search.problems());
  append("motion/", timing.validate());
  gpis_mapping::RangeCheck motion("motion/");
  motion("velocity_scale", velocity_scale, 0.01, 1.0, "");
  motion("acceleration_rad_s2", acceleration_rad_s2, 0.05, 40.0, "rad/s^2");
  motion("contact_speed_m_s", contact_speed_m_s, 0.001, 0.25, "m/s");
  motion("lift_speed_m_s", lift_speed_m_s, 0.001, 1.0, "m/s");
  append("", motion.problems());
  gpis_mapping::RangeCheck pick("pick/");
  pick("approach_m", approach_m, 0.01, 0.5, "m");
  pick("lift_m", lift_m, 0.01, 0.5, "m");
  pick("min_lift_m", min_lift_m, 0.005, std::max(0.005, lift_m), "m");
  pick("lift_room_m", lift_room_m, 0.0, 0.2, "m");
  pick("overtravel_m", overtravel_m, 0.0, 0.03, "m");
  pick("cartesian_step_m", cartesian_step_m, 5e-4, 0.02, "m");
  pick("max_joint_jump_rad", max_joint_jump_rad, 0.01, 1.0, "rad");
  pick("plate_margin_m", plate_margin_m, 0.0, 0.2, "m");
  pick("magnet_radius_m", magnet_radius_m, 0.001, 0.2, "m");
  pick("yaw_samples", yaw_samples, 1, 360, "");
  pick("contact_grid_m", contact_grid_m, 0.005, 1.0, "m");
  pick("max_goals", max_goals, 1, 1000, "");
  pick("max_tilt_rad", max_tilt_rad, 0.05, 3.2, "rad");
  append("", pick.problems());
  gpis_mapping::RangeCheck view("view/");
  view("clear_m", inspect_clear_m, 0.0, 1.0, "m");
  view("samples", inspect_samples, 0, 1e6, "");
  append("", view.problems());
  return problems;
}

MotionPlanner::MotionPlanner(std::shared_ptr<const ArmKinematics> arm, ManipulabilitySectors sectors,
                             const MotionPlannerConfig& config)
    : arm_(std::move(arm)), sectors_(std::move(sectors)), config_(config) {
  if (!arm_) throw std::invalid_argument("no arm");
  gpis_mapping::throwIfAny(config.validate());
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
