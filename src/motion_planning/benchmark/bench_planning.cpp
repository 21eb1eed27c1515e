// SPDX-License-Identifier: BSD-3-Clause
// Picks from random piles of exact boxes: median and 95th percentile over all open bricks of twenty piles, and how many
// have a plan. One thread.
#include <algorithm>
#include <ctime>
#include <map>

#include <benchmark/benchmark.h>

#include "motion_planning/motion_planner.h"
#include "motion_planning/path_monitor.h"
#include "support/pick_world.h"

namespace motion_planning {
namespace {

/// Of this thread's work: planning uses one thread.
double processorMilliseconds() {
  return 1e3 * static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

double quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values.empty() ? 0.0 : values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

void BM_PlanPick(benchmark::State& state) {
  std::vector<PickWorld> piles;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) piles.push_back(randomPile(seed, 8));
  const MotionPlanner planner(shippedArm(), testSectors(), {});
  std::vector<double> all_ms;
  std::vector<double> solved_ms;
  std::map<PlanStatus, int> count;
  for (auto _ : state) {
    for (const PickWorld& pile : piles) {
      for (const std::size_t brick : pile.open) {
        const double start_ms = processorMilliseconds();
        const auto plan = planner.planPick(pile.context(), pile.target(brick), pile.container(*shippedArm())).plan;
        all_ms.push_back(processorMilliseconds() - start_ms);
        if (plan) solved_ms.push_back(all_ms.back());
        ++count[plan ? PlanStatus::kSuccess : plan.failure().status];
      }
    }
  }
  state.counters["median_ms"] = quantile(all_ms, 0.5);
  state.counters["p95_ms"] = quantile(all_ms, 0.95);
  state.counters["max_ms"] = quantile(all_ms, 1.0);
  state.counters["solved_median_ms"] = quantile(solved_ms, 0.5);
  state.counters["solved_p95_ms"] = quantile(solved_ms, 0.95);
  for (const auto& [status, times] : count) state.counters[toString(status)] = times;
}
BENCHMARK(BM_PlanPick)->Unit(benchmark::kMillisecond)->Iterations(1);

void BM_TimeParametrize(benchmark::State& state) {
  JointPath path(6, ArmVector::Zero());
  for (std::size_t i = 0; i < path.size(); ++i) {
    for (int joint = 0; joint < 6; ++joint) path[i][joint] = std::sin(2.0 * static_cast<double>(i) + joint);
  }
  for (auto _ : state) benchmark::DoNotOptimize(timeParametrize(path, {}).points.size());
}
BENCHMARK(BM_TimeParametrize)->Unit(benchmark::kMillisecond);

void BM_MonitorApproach(benchmark::State& state) {
  const PickWorld pile = randomPile(1, 8);
  const MotionPlanner planner(shippedArm(), testSectors(), {});
  JointTrajectory approach;
  for (std::size_t i = 0; i < pile.open.size() && approach.empty(); ++i) {
    const auto plan = planner.planPick(pile.context(), pile.target(pile.open[i]), pile.container(*shippedArm())).plan;
    if (plan) approach = plan->approach;
  }
  if (approach.empty()) return state.SkipWithError("no plan");
  CollisionChecker checker(shippedArm(), pile.scene, pile.T_map_base);
  PathMonitor monitor{PathMonitorConfig()};
  monitor.start(approach, shippedArm());
  for (auto _ : state) benchmark::DoNotOptimize(monitor.check(0.0, checker).clearance_m);
  state.counters["trajectory_s"] = approach.duration();
}
BENCHMARK(BM_MonitorApproach)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace motion_planning
