// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>

#include <motion_planning/collision_scene.h>
#include <motion_planning/motion_planner.h>

#include "planning_problems/planning_problems.h"

namespace experiments {

/// What one would write first: OMPL's RRTConnect from the start to one posture with the magnet on the first face (middle
/// of the plate, no turn of the tool chosen, the arm's branch that is nearest to the start), in the same scene with the
/// same collision test and as many iterations. No straight approach, no other faces, no shortening.
struct PlainReach {
  bool is_solved{false};
  const char* reason{""};
  motion_planning::JointPath path;
  double plan_ms{0.0};  // processor time
};

PlainReach planPlainReach(const PlanningProblem& problem, const motion_planning::ArmVector& start,
                          std::shared_ptr<const motion_planning::ArmKinematics> arm,
                          std::shared_ptr<const motion_planning::CollisionScene> scene,
                          const motion_planning::MotionPlannerConfig& config);

}  // namespace experiments
