// SPDX-License-Identifier: BSD-3-Clause
// Ground about the robot, 20 m x 20 m of 5 cm cells: a pile of 4 m2, walls and posts. One thread but for OpenCV's.
#include <cmath>
#include <random>

#include <benchmark/benchmark.h>

#include "base_navigation/distance_field.h"
#include "base_navigation/footprint_checker.h"
#include "base_navigation/grid_fusion.h"
#include "support/grids.h"
#include "support/scan_world.h"

namespace base_navigation {
namespace {

const Polygon kBody = {{0.296, 0.296}, {-0.527, 0.296}, {-0.527, -0.296}, {0.296, -0.296}};
const Pose2d kStart{-4.0, -3.0, 0.6};

ScanWorld makeWorld() {
  ScanWorld world;
  world.walls = {{{-10, -10}, {10, -10}}, {{10, -10}, {10, 10}}, {{10, 10}, {-10, 10}}, {{-10, 10}, {-10, -10}},
                 {{-1, -1}, {1, -1}},     {{1, -1}, {1, 1}},     {{1, 1}, {-1, 1}},     {{-1, 1}, {-1, -1}}};
  std::mt19937 engine(1);
  std::uniform_real_distribution<double> place(-9.0, 9.0);
  for (int i = 0; i < 15; ++i) {
    const Eigen::Vector2d middle(place(engine), place(engine));
    if ((middle - kStart.position()).norm() > 1.5) world.posts.push_back({middle, 0.15});
  }
  return world;
}

/// As the camera's map knows it: all free but the pile, the posts and what is beyond the walls.
std::shared_ptr<const NavigationGrid> makeMap(double offset_m) {
  const ScanWorld world = makeWorld();
  NavigationGrid map = makeGrid(400, 400, SpaceState::kFree, 0.05, {-10.0 + offset_m, -10.0 + offset_m});
  for (int row = 0; row < map.height; ++row) {
    for (int column = 0; column < map.width; ++column) {
      const Eigen::Vector2d p = map.centerOf(column, row);
      bool is_occupied = p.lpNorm<Eigen::Infinity>() < 1.0;
      for (const ScanWorld::Post& post : world.posts) {
        is_occupied = is_occupied || (p - post.middle).norm() < post.radius_m + 0.03;
      }
      if (is_occupied) map.state[map.index(column, row)] = SpaceState::kOccupied;
    }
  }
  return std::make_shared<const NavigationGrid>(map);
}

void fill(GridFusion* fusion, double offset_m) {
  const ScanWorld world = makeWorld();
  fusion->setMap(makeMap(offset_m));
  for (int i = 0; i < 30; ++i) fusion->addScan(world.look({-4.0, -3.0, 0.2 * i}), {-4.0, -3.0, 0.2 * i}, 0.08 * i);
}

std::shared_ptr<const NavigationGrid> makeFusedGrid() {
  GridFusion fusion(GridFusionConfig(), kBody);
  fill(&fusion, 0.0);
  return fusion.build(kStart, 3.0);
}

void BM_AddScan(benchmark::State& state) {
  GridFusion fusion(GridFusionConfig(), kBody);
  std::mt19937 engine(2);
  std::vector<Scan> scans;
  for (int i = 0; i < 50; ++i) scans.push_back(makeWorld().look(kStart, 0.01, &engine));
  std::size_t i = 0;
  for (auto _ : state) {
    fusion.addScan(scans[i % scans.size()], kStart, 0.08 * static_cast<double>(i));
    ++i;
  }
}
BENCHMARK(BM_AddScan)->Unit(benchmark::kMicrosecond);

/// Nothing known before: every cell in view is looked at.
void BM_AddFirstScan(benchmark::State& state) {
  GridFusion fusion(GridFusionConfig(), kBody);
  const Scan scan = makeWorld().look(kStart);
  for (auto _ : state) {
    fusion.forget();
    fusion.addScan(scan, kStart, 0.0);
  }
}
BENCHMARK(BM_AddFirstScan)->Unit(benchmark::kMicrosecond);

void BM_Build(benchmark::State& state) {
  GridFusion fusion(GridFusionConfig(), kBody);
  fill(&fusion, 1e-3 * static_cast<double>(state.range(0)));
  for (auto _ : state) benchmark::DoNotOptimize(fusion.build(kStart, 3.0));
}
BENCHMARK(BM_Build)->ArgName("map_offset_mm")->Arg(0)->Arg(13)->Unit(benchmark::kMillisecond);

void BM_Dijkstra(benchmark::State& state) {
  const auto grid = makeFusedGrid();
  double distance_m = 0.0;
  for (auto _ : state) distance_m = DistanceField(*grid, kStart.position(), 0.296).distance({4.0, 4.0});
  state.counters["distance_m"] = distance_m;
  state.counters["width"] = grid->width;
}
BENCHMARK(BM_Dijkstra)->Unit(benchmark::kMillisecond);

void BM_GridAndDijkstra(benchmark::State& state) {
  GridFusion fusion(GridFusionConfig(), kBody);
  fill(&fusion, 0.0);
  for (auto _ : state) {
    const auto grid = fusion.build(kStart, 3.0);
    benchmark::DoNotOptimize(DistanceField(*grid, kStart.position(), 0.296).distance({4.0, 4.0}));
  }
}
BENCHMARK(BM_GridAndDijkstra)->Unit(benchmark::kMillisecond);

void BM_MakeFootprintChecker(benchmark::State& state) {
  const auto grid = makeFusedGrid();
  for (auto _ : state) benchmark::DoNotOptimize(FootprintChecker(grid, kBody, 0.03).inscribedRadius());
}
BENCHMARK(BM_MakeFootprintChecker)->Unit(benchmark::kMillisecond);

/// Poses whose base_link is between two distances from what is not free.
void checkBetween(benchmark::State& state, double min_m, double max_m, bool is_full) {
  const FootprintChecker checker(makeFusedGrid(), kBody, 0.03);
  std::mt19937 engine(3);
  std::uniform_real_distribution<double> place(-9.9, 9.9), yaw(-M_PI, M_PI);
  std::vector<Pose2d> poses;
  int num_free = 0;
  while (poses.size() < 2000) {
    const Pose2d pose{place(engine), place(engine), yaw(engine)};
    const double clearance_m = checker.clearance(pose.position());
    if (clearance_m < min_m || clearance_m > max_m) continue;
    poses.push_back(pose);
    if (checker.isFree(pose)) ++num_free;
  }
  std::size_t i = 0;
  for (auto _ : state) {
    const Pose2d& pose = poses[i++ % poses.size()];
    if (is_full) {
      benchmark::DoNotOptimize(checker.check(pose).state);
    } else {
      benchmark::DoNotOptimize(checker.isFree(pose));
    }
  }
  state.counters["free"] = num_free / 2000.0;
}
void BM_IsFreeFar(benchmark::State& state) {
  checkBetween(state, 0.8, 10.0, false);
}
BENCHMARK(BM_IsFreeFar)->Unit(benchmark::kNanosecond);
void BM_IsFreeNear(benchmark::State& state) {
  checkBetween(state, 0.33, 0.65, false);
}
BENCHMARK(BM_IsFreeNear)->Unit(benchmark::kNanosecond);
void BM_IsFreeAnywhere(benchmark::State& state) {
  checkBetween(state, 0.0, 10.0, false);
}
BENCHMARK(BM_IsFreeAnywhere)->Unit(benchmark::kNanosecond);
void BM_VerdictNear(benchmark::State& state) {
  checkBetween(state, 0.33, 0.65, true);
}
BENCHMARK(BM_VerdictNear)->Unit(benchmark::kNanosecond);

}  // namespace
}  // namespace base_navigation
