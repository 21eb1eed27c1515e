// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <utility>
#include <vector>

#include <ompl/base/MotionValidator.h>
#include <ompl/base/PlannerTerminationCondition.h>
#include <ompl/base/ProblemDefinition.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/StateSampler.h>
#include <ompl/base/goals/GoalStates.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>

/// OMPL's RRTConnect, made deterministic: iterations end it, never a clock. The caller draws every sample, for the
/// whole process shares the seed of OMPL's generators. Who includes this links OMPL.
namespace interactive_mapping {

struct TreeSearch {
  std::function<bool(const ompl::base::State*)> is_valid;
  std::function<bool(const ompl::base::State* from, const ompl::base::State* to)> is_motion_valid;  // `from` is valid
  std::function<void(const ompl::base::StateSpace*, ompl::base::State*)> sample;
  std::function<bool()> is_cancelled;
  double range{0.0};  // of one growth of a tree
  int max_iterations{0};
};

struct FoundPath {
  std::shared_ptr<ompl::geometric::PathGeometric> path;  // null: none
  int iterations{0};
};

namespace rrt_connect {

namespace ob = ompl::base;

class StateValidity : public ob::StateValidityChecker {
 public:
  StateValidity(const ob::SpaceInformationPtr& information, const TreeSearch& search)
      : ob::StateValidityChecker(information), search_(search) {}
  bool isValid(const ob::State* state) const override { return search_.is_valid(state); }

 private:
  const TreeSearch& search_;
};

class MotionValidity : public ob::MotionValidator {
 public:
  MotionValidity(const ob::SpaceInformationPtr& information, const TreeSearch& search)
      : ob::MotionValidator(information), search_(search) {}
  bool checkMotion(const ob::State* from, const ob::State* to) const override {
    return search_.is_motion_valid(from, to);
  }
  bool checkMotion(const ob::State*, const ob::State*, std::pair<ob::State*, double>&) const override {
    throw std::logic_error("RRTConnect does not ask how far a motion is valid");
  }

 private:
  const TreeSearch& search_;
};

/// Counts the samples: RRTConnect draws one in each iteration.
class Sampler : public ob::StateSampler {
 public:
  Sampler(const ob::StateSpace* space, const TreeSearch& search, int* drawn)
      : ob::StateSampler(space), search_(search), drawn_(drawn) {}
  void sampleUniform(ob::State* state) override {
    ++*drawn_;
    search_.sample(space_, state);
  }
  void sampleUniformNear(ob::State*, const ob::State*, double) override {
    throw std::logic_error("RRTConnect does not sample near a state");
  }
  void sampleGaussian(ob::State*, const ob::State*, double) override {
    throw std::logic_error("RRTConnect does not sample near a state");
  }

 private:
  const TreeSearch& search_;
  int* drawn_;
};

}  // namespace rrt_connect

/// `start` and `goals` must be valid: for goals that are not, RRTConnect would wait for ever. `Nearest` as
/// ompl::NearestNeighborsLinear; OMPL's default draws pivots from its own generator.
template <template <typename> class Nearest>
FoundPath connectByTrees(const ompl::base::StateSpacePtr& space, const ompl::base::State* start,
                         const std::vector<const ompl::base::State*>& goals, const TreeSearch& search) {
  namespace ob = ompl::base;
  // OMPL's messages go to one handler of the whole process; nothing here is to be printed.
  static std::once_flag silence;
  std::call_once(silence, [] { ompl::msg::noOutputHandler(); });

  const auto information = std::make_shared<ob::SpaceInformation>(space);
  information->setStateValidityChecker(std::make_shared<rrt_connect::StateValidity>(information, search));
  information->setMotionValidator(std::make_shared<rrt_connect::MotionValidity>(information, search));
  information->setup();
  FoundPath found;
  // After setup, which draws samples of its own to scale projections that nobody here uses.
  space->setStateSamplerAllocator([&](const ob::StateSpace* allocated_for) {
    return std::make_shared<rrt_connect::Sampler>(allocated_for, search, &found.iterations);
  });
  const auto problem = std::make_shared<ob::ProblemDefinition>(information);
  problem->addStartState(start);
  const auto goal_states = std::make_shared<ob::GoalStates>(information);
  for (const ob::State* goal : goals) goal_states->addState(goal);
  problem->setGoal(goal_states);

  ompl::geometric::RRTConnect planner(information);
  planner.setRange(search.range);
  planner.setNearestNeighbors<Nearest>();
  planner.setProblemDefinition(problem);
  planner.setup();
  const ob::PlannerTerminationCondition ends(
      [&] { return found.iterations >= search.max_iterations || search.is_cancelled(); });
  if (planner.solve(ends) == ob::PlannerStatus::EXACT_SOLUTION) {
    found.path = std::static_pointer_cast<ompl::geometric::PathGeometric>(problem->getSolutionPath());
  }
  return found;
}

}  // namespace interactive_mapping
