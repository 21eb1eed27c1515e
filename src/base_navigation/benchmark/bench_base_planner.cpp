// SPDX-License-Identifier: BSD-3-Clause
// Paths about a pile of 4 m2, from one standing pose to another: next to it, round a corner, opposite. Beside them what
// OMPL gives alone: RRTConnect over Reeds-Shepp curves, uniform samples, PathSimplifier. One thread.
#include <algorithm>
#include <ctime>

#include <benchmark/benchmark.h>
#include <ompl/base/ScopedState.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/spaces/ReedsSheppStateSpace.h>
#include <ompl/geometric/SimpleSetup.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

#include "base_navigation/base_planner.h"
#include "support/pile_scene.h"

namespace base_navigation {
namespace {

namespace ob = ompl::base;

double processorMilliseconds() {
  return 1e3 * static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

double quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values.empty() ? 0.0 : values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

struct Result {
  bool is_solved{false};
  double duration_s{0.0};
};

/// Each standing pose with those `apart` further round the pile.
template <typename Plan>
void measure(benchmark::State& state, const Plan& plan) {
  const PileScene scene = pileScene();
  const std::size_t n = scene.standing_map.size();
  const auto apart = static_cast<std::size_t>(state.range(0));
  std::vector<double> times_ms;
  std::vector<double> durations_s;
  for (auto _ : state) {
    for (std::size_t i = 0; i < n; ++i) {
      const double begin_ms = processorMilliseconds();
      const Result result = plan(scene.grid, scene.standing_map[i], scene.standing_map[(i + apart) % n]);
      times_ms.push_back(processorMilliseconds() - begin_ms);
      if (result.is_solved) durations_s.push_back(result.duration_s);
    }
  }
  state.counters["median_ms"] = quantile(times_ms, 0.5);
  state.counters["p95_ms"] = quantile(times_ms, 0.95);
  state.counters["max_ms"] = quantile(times_ms, 1.0);
  state.counters["solved_percent"] =
      100.0 * static_cast<double>(durations_s.size()) / static_cast<double>(times_ms.size());
  state.counters["drive_s_median"] = quantile(durations_s, 0.5);
  state.counters["drive_s_p95"] = quantile(durations_s, 0.95);
}

void BM_BasePlanner(benchmark::State& state) {
  const BasePlanner planner({}, kBaseLimits, kBaseFootprint);
  measure(state, [&](const auto& grid, const Pose2d& start, const Pose2d& goal) {
    const BasePlan plan = planner.plan(grid, start, goal);
    return Result{plan.status == BasePlanStatus::kSolved, plan.duration_s};
  });
}

/// To the goal itself with the goal's padding all the way: easier than what the planner does.
void BM_OmplAlone(benchmark::State& state) {
  ompl::msg::noOutputHandler();
  ompl::RNG::setSeed(1);
  const BasePlannerConfig config;
  measure(state, [&](const auto& grid, const Pose2d& start, const Pose2d& goal) {
    const FootprintChecker checker(grid, kBaseFootprint, config.goal_padding_m);
    const auto space = std::make_shared<ob::ReedsSheppStateSpace>(config.turn_radius_m);
    ob::RealVectorBounds bounds(2);
    bounds.setLow(-10.0);
    bounds.setHigh(10.0);
    space->setBounds(bounds);
    ompl::geometric::SimpleSetup setup(space);
    setup.setStateValidityChecker([&checker](const ob::State* at) {
      const auto* se2 = at->as<ob::SE2StateSpace::StateType>();
      return checker.isFree({se2->getX(), se2->getY(), se2->getYaw()});
    });
    // Half a cell of the corner's way, of the longest distance that the space knows.
    setup.getSpaceInformation()->setStateValidityCheckingResolution(0.0125 / space->getMaximumExtent());
    setup.getSpaceInformation()->setMotionValidator(
        std::make_shared<ob::ReedsSheppMotionValidator>(setup.getSpaceInformation()));
    ob::ScopedState<ob::SE2StateSpace> from(space), to(space);
    from->setXY(start.x_m, start.y_m);
    from->setYaw(start.yaw_rad);
    to->setXY(goal.x_m, goal.y_m);
    to->setYaw(goal.yaw_rad);
    from.enforceBounds();
    to.enforceBounds();
    setup.setStartAndGoalStates(from, to);
    setup.setPlanner(std::make_shared<ompl::geometric::RRTConnect>(setup.getSpaceInformation()));
    Result result;
    if (setup.solve(2.0) != ob::PlannerStatus::EXACT_SOLUTION) return result;
    setup.simplifySolution(0.2);  // what the whole plan may take
    BasePath path{start, {}};
    const auto& states = setup.getSolutionPath().getStates();
    for (std::size_t i = 0; i + 1 < states.size(); ++i) {
      const auto curve = space->reedsShepp(states[i], states[i + 1]);
      for (int k = 0; k < 5; ++k) {
        const double turn_rad = curve.type_[k] == ob::ReedsSheppStateSpace::RS_LEFT    ? curve.length_[k]
                                : curve.type_[k] == ob::ReedsSheppStateSpace::RS_RIGHT ? -curve.length_[k]
                                                                                       : 0.0;
        if (curve.length_[k] != 0.0) path.motions.push_back({config.turn_radius_m * curve.length_[k], turn_rad});
      }
    }
    path.tidy();
    result.is_solved = true;
    result.duration_s = duration(path, kBaseLimits);
    return result;
  });
}

// 16 poses, 4 on a side: next one, round the corner, opposite.
BENCHMARK(BM_BasePlanner)->Arg(1)->Arg(4)->Arg(8)->Iterations(1)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_OmplAlone)->Arg(1)->Arg(4)->Arg(8)->Iterations(1)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace base_navigation
