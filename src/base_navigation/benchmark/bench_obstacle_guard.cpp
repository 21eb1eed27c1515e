// SPDX-License-Identifier: BSD-3-Clause
// One look of the guard at a scan of 400 beams, amid posts and walls. Of the three looks that the navigator takes in each
// step of driving, the one along the way ahead is the longest.
#include <cmath>
#include <random>

#include <benchmark/benchmark.h>

#include "base_navigation/obstacle_guard.h"
#include "support/plant.h"

namespace base_navigation {
namespace {

constexpr int kBeams = 400;

/// Every beam tells an echo within what is looked ahead to: none is left out early.
Scan crowdedScan() {
  PolygonWorld world = {box(0.0, 2.6, 9.0, 0.2), box(0.0, -2.6, 9.0, 0.2), box(3.2, 0.0, 0.2, 6.0),
                        box(-3.2, 0.0, 0.2, 6.0)};
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> place(-2.4, 2.4);
  while (world.size() < 16) {
    const Polygon post = box(place(random), place(random), 0.15, 0.15, place(random));
    if (gap(post, padPolygon(shippedFootprint(), 0.15)) > 0.0) world.push_back(post);
  }
  return PlantScanner{0.01, kBeams}.scan(world, {}, &random);
}

void check(benchmark::State& state, const Twist2d& wanted, const std::vector<BaseMotion>& ahead) {
  const ObstacleGuard guard({}, shippedLimits(), shippedFootprint());
  const Scan scan = crowdedScan();
  const Pose2d T_scan_base{0.02, 0.0, 0.01};
  for (auto _ : state) benchmark::DoNotOptimize(guard.check(wanted, ahead, scan, T_scan_base));
}

void BM_StraightAhead(benchmark::State& state) {
  check(state, {0.5, 0.0}, {{3.0, 0.0}});
}
BENCHMARK(BM_StraightAhead)->Unit(benchmark::kMicrosecond);

void BM_Arc(benchmark::State& state) {
  check(state, {0.3, 0.4}, {{1.2, 1.6}});
}
BENCHMARK(BM_Arc)->Unit(benchmark::kMicrosecond);

/// Eight pieces with changing curvature, as a path cut short has at most on 3 m.
void BM_WayOfEightPieces(benchmark::State& state) {
  std::vector<BaseMotion> ahead;
  for (int i = 0; i < 8; ++i) ahead.push_back({0.37, i % 2 == 0 ? 0.0 : i % 4 == 1 ? 0.5 : -0.5});
  check(state, {0.4, 0.0}, ahead);
}
BENCHMARK(BM_WayOfEightPieces)->Unit(benchmark::kMicrosecond);

void BM_TurnOnTheSpot(benchmark::State& state) {
  check(state, {0.0, 0.5}, {{0.0, 1.6}});
}
BENCHMARK(BM_TurnOnTheSpot)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace base_navigation
