// SPDX-License-Identifier: BSD-3-Clause
#include "planning_problems/problem_planner.h"

#include <ctime>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include <mp700_ur5e_description/robot_names.h>

#include "planning_problems/exact_checker.h"

namespace experiments {

using motion_planning::ArmVector;

double threadTime_ms() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

ProblemPlanner::ProblemPlanner(const ProblemMaker& maker, const std::string& sectors,
                               const motion_planning::CollisionSceneConfig& scene,
                               const motion_planning::MotionPlannerConfig& planner)
    : maker_(maker),
      arm_(std::make_shared<motion_planning::ArmKinematics>(maker.robot())),
      scene_config_(scene),
      planner_(std::make_unique<motion_planning::MotionPlanner>(
          arm_, motion_planning::ManipulabilitySectors::load(sectors, *maker.robot()), planner)) {}

std::shared_ptr<const motion_planning::CollisionScene> ProblemPlanner::scene(const PlanningProblem& problem) {
  if (stand_ != problem.stand) {
    motion_planning::CollisionSceneBuilder builder(scene_config_);
    update_ = builder.update(problem.stand->surface, motion_planning::SnapshotView(problem.stand->map),
                             problem.stand->T_map_base);
    scene_ = builder.scene();
    stand_ = problem.stand;
  }
  return scene_;
}

ProblemPlanner::Answer ProblemPlanner::plan(const PlanningProblem& problem, const std::function<bool()>& is_cancelled) {
  motion_planning::PlanningContext context;
  context.scene = scene(problem);
  context.T_map_base = problem.stand->T_map_base;
  context.start_rad = maker_.stowed();
  context.is_cancelled = is_cancelled;
  const auto begin = std::chrono::steady_clock::now();
  const double begin_ms = threadTime_ms();
  auto plan = planner_->planPick(context, problem.target, {maker_.containerGoal()}).plan;
  const double plan_ms = threadTime_ms() - begin_ms;
  const std::chrono::duration<double, std::milli> wall_ms = std::chrono::steady_clock::now() - begin;
  return {std::move(plan), plan_ms, wall_ms.count(), update_};
}

Eigen::Isometry3d contactPose(const PlanningProblem& problem, mp700_ur5e_description::BrickFace face, double yaw_rad) {
  const Eigen::Vector3d normal = mp700_ur5e_description::faceNormal(face);
  Eigen::Isometry3d T_brick_tip = Eigen::Isometry3d::Identity();
  T_brick_tip.translation() = 0.5 * problem.target.type->size_m.cwiseProduct(normal);
  T_brick_tip.linear() = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), -normal).toRotationMatrix();
  T_brick_tip.rotate(Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()));
  return problem.target.T_map_brick * T_brick_tip;
}

bool isTouchable(const ProblemMaker& maker, const motion_planning::ArmKinematics& arm, const PlanningProblem& problem) {
  constexpr int kTurns = 12;
  constexpr double kContact_m = 0.001;
  ExactChecker checker(maker.robot(), problem.stand->bricks, problem.stand->T_map_base);
  const Eigen::Isometry3d T_base_map = problem.stand->T_map_base.inverse();
  for (const auto face : problem.target.faces) {
    for (int turn = 0; turn < kTurns; ++turn) {
      const Eigen::Isometry3d T_base_tip = T_base_map * contactPose(problem, face, 2.0 * M_PI * turn / kTurns);
      for (const ArmVector& q : arm.inverse(T_base_tip, maker.stowed())) {
        const std::vector<Overlap> overlaps = checker.overlaps(q);
        if (std::all_of(overlaps.begin(), overlaps.end(), [&](const Overlap& overlap) {
              return overlap.first == mp700_ur5e_description::kMagnetLink &&
                     overlap.brick_id == problem.target.brick_id && overlap.depth_m < kContact_m;
            })) {
          return true;
        }
      }
    }
  }
  return false;
}

}  // namespace experiments
