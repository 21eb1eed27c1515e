// SPDX-License-Identifier: BSD-3-Clause
#include "plain_rrt_connect.h"

#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/geometric/SimpleSetup.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

#include "planning_problems/problem_planner.h"

namespace experiments {

using motion_planning::ArmVector;
namespace ob = ompl::base;
namespace og = ompl::geometric;

PlainReach planPlainReach(const PlanningProblem& problem, const ArmVector& start,
                          std::shared_ptr<const motion_planning::ArmKinematics> arm,
                          std::shared_ptr<const motion_planning::CollisionScene> scene,
                          const motion_planning::MotionPlannerConfig& config) {
  ompl::msg::setLogLevel(ompl::msg::LOG_NONE);
  PlainReach result;
  const double begin_ms = threadTime_ms();
  const auto finish = [&](const char* reason) {
    result.reason = reason;
    result.plan_ms = threadTime_ms() - begin_ms;
    return result;
  };
  const Eigen::Isometry3d T_base_tip =
      problem.stand->T_map_base.inverse() * contactPose(problem, problem.target.faces.front(), 0.0);
  const std::vector<ArmVector> solutions = arm->inverse(T_base_tip, start);
  if (solutions.empty()) return finish("no_ik");
  const ArmVector goal = solutions.front();

  motion_planning::CollisionChecker checker(arm, scene, problem.stand->T_map_base, config.collision);
  checker.setTarget(motion_planning::OrientedBox{problem.target.T_map_brick, problem.target.type->size_m});
  checker.freeUnknownAt(start);
  if (!checker.isFree(start)) return finish("start_in_collision");
  if (!checker.isFree(goal)) return finish("goal_in_collision");

  const auto space = std::make_shared<ob::RealVectorStateSpace>(6);
  ob::RealVectorBounds bounds(6);
  for (int i = 0; i < 6; ++i) {
    bounds.setLow(static_cast<unsigned>(i), arm->limits().lower_rad[i]);
    bounds.setHigh(static_cast<unsigned>(i), arm->limits().upper_rad[i]);
  }
  space->setBounds(bounds);
  const auto toArm = [](const ob::State* state) {
    return ArmVector(Eigen::Map<const ArmVector>(state->as<ob::RealVectorStateSpace::StateType>()->values));
  };
  og::SimpleSetup setup(space);
  setup.setStateValidityChecker([&](const ob::State* state) { return checker.isFree(toArm(state)); });
  // OMPL's resolution is a share of the space's extent and Euclidean; the planner's step is in the largest joint.
  setup.getSpaceInformation()->setStateValidityCheckingResolution(config.planner.check_step_rad /
                                                                  space->getMaximumExtent());
  ob::ScopedState<ob::RealVectorStateSpace> from(space);
  ob::ScopedState<ob::RealVectorStateSpace> to(space);
  for (unsigned i = 0; i < 6; ++i) {
    from[i] = start[static_cast<Eigen::Index>(i)];
    to[i] = goal[static_cast<Eigen::Index>(i)];
  }
  setup.setStartAndGoalStates(from, to);
  const auto planner = std::make_shared<og::RRTConnect>(setup.getSpaceInformation());
  planner->setRange(config.planner.range_rad);
  setup.setPlanner(planner);
  // Asked once in each iteration.
  int iterations = 0;
  const ob::PlannerTerminationCondition done([&] { return ++iterations > config.planner.max_iterations; });
  if (setup.solve(done) != ob::PlannerStatus::EXACT_SOLUTION) return finish("iterations");
  for (const ob::State* state : setup.getSolutionPath().getStates()) result.path.push_back(toArm(state));
  result.is_solved = true;
  return finish("success");
}

}  // namespace experiments
