// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <string>

#include <motion_planning/collision_scene.h>
#include <motion_planning/motion_planner.h>

#include "planning_problems/planning_problems.h"

namespace experiments {

/// Puts problems to the planner: scene from the stand's map, start at rest with the arm stowed, brick to the container.
class ProblemPlanner {
 public:
  struct Answer {
    motion_planning::Result<motion_planning::PickPlan> plan;
    double plan_ms;                      // processor time of this thread
    double plan_wall_ms;                 // and by the clock
    motion_planning::SceneUpdate scene;  // of the stand; made once for all problems there

    std::string status() const {
      return toString(plan ? motion_planning::PlanStatus::kSuccess : plan.failure().status);
    }
  };

  /// `sectors`: path of the manipulability sectors. Throws std::invalid_argument for bad configs or a bad file.
  ProblemPlanner(const ProblemMaker& maker, const std::string& sectors,
                 const motion_planning::CollisionSceneConfig& scene = {},
                 const motion_planning::MotionPlannerConfig& planner = {});

  Answer plan(const PlanningProblem& problem, const std::function<bool()>& is_cancelled = {});

  /// The scene of a problem's stand.
  std::shared_ptr<const motion_planning::CollisionScene> scene(const PlanningProblem& problem);

  std::shared_ptr<const motion_planning::ArmKinematics> arm() const { return arm_; }
  const motion_planning::MotionPlanner& planner() const { return *planner_; }

 private:
  const ProblemMaker& maker_;
  std::shared_ptr<const motion_planning::ArmKinematics> arm_;
  motion_planning::CollisionSceneConfig scene_config_;
  std::unique_ptr<motion_planning::MotionPlanner> planner_;
  std::shared_ptr<const Stand> stand_;  // whose scene is at hand
  std::shared_ptr<const motion_planning::CollisionScene> scene_;
  motion_planning::SceneUpdate update_;
};

/// Processor time that this thread has taken [ms]: what a busy machine does not change much.
double threadTime_ms();

/// Whether the magnet can be on one of the target's faces with nothing in the way but the target itself, by the exact
/// scene: tried with the tip in the middle of each face at 12 turns and all branches of the arm. Planning cannot do
/// better where it says no, but for contact beside the middle.
bool isTouchable(const ProblemMaker& maker, const motion_planning::ArmKinematics& arm, const PlanningProblem& problem);

/// T_map_tip with the tip in the middle of a face, turned by `yaw_rad` about its normal.
Eigen::Isometry3d contactPose(const PlanningProblem& problem, mp700_ur5e_description::BrickFace face, double yaw_rad);

}  // namespace experiments
