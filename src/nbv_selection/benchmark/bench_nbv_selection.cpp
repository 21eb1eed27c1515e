// SPDX-License-Identifier: BSD-3-Clause
// A selection on a GPIS map of a pile of 4 m2, about 50 segments, with a grid of 600 x 600 cells: all of it, and its parts.
// The map is in this process and answers with as many threads as it has. Defaults throughout.
#include <algorithm>
#include <array>
#include <memory>

#include <base_navigation/distance_field.h>
#include <base_navigation/footprint_checker.h>
#include <benchmark/benchmark.h>

#include "nbv_selection/gpis_scene.h"
#include "nbv_selection/view_selector.h"
#include "support/sampled_map.h"
#include "support/selection_setup.h"

namespace nbv_selection {
namespace {

constexpr int kColumns = 7;
constexpr int kRows = 10;
const Eigen::Vector3d kBrick(0.3, 0.2, 0.2);  // [m]
const Eigen::Vector2d kCorner(-1.05, -1.0);   // of the pile [m]

/// Bricks on one another at a place of the pile; 0 beside it.
int numBricks(int column, int row) {
  if (column < 0 || row < 0 || column >= kColumns || row >= kRows) return 0;
  return 1 + (3 * column + 5 * row + column * row) % 3;  // one to three, without a pattern to the eye
}

/// Faces that are seen from somewhere, and the ground up to 2.5 m from the pile's middle.
std::shared_ptr<const gpis_mapping::MapSnapshot> pileMap() {
  nbv_selection_test::MapSamples samples;
  const Eigen::Vector3d x = kBrick.x() * Eigen::Vector3d::UnitX(), y = kBrick.y() * Eigen::Vector3d::UnitY();
  for (int column = -1; column < kColumns; ++column) {
    for (int row = -1; row < kRows; ++row) {
      const double own_m = kBrick.z() * numBricks(column, row);
      const Eigen::Vector3d low(kCorner.x() + kBrick.x() * column, kCorner.y() + kBrick.y() * row, 0.0);
      if (own_m > 0.0) samples.addRectangle(low + own_m * Eigen::Vector3d::UnitZ(), x, y);
      const auto addStep = [&](double other_m, const Eigen::Vector3d& from, const Eigen::Vector3d& along) {
        if (own_m == other_m) return;
        const Eigen::Vector3d bottom = from + std::min(own_m, other_m) * Eigen::Vector3d::UnitZ();
        const Eigen::Vector3d up = std::abs(own_m - other_m) * Eigen::Vector3d::UnitZ();
        if (own_m > other_m) samples.addRectangle(bottom, along, up);  // looks to the right of `along`
        if (own_m < other_m) samples.addRectangle(bottom, up, along);  // to the left
      };
      addStep(kBrick.z() * numBricks(column + 1, row), low + x, y);
      addStep(kBrick.z() * numBricks(column, row + 1), low + x + y, -x);
    }
  }
  constexpr double kHalf_m = 2.5;
  const Eigen::Vector2d high = kCorner + Eigen::Vector2d(kBrick.x() * kColumns, kBrick.y() * kRows);
  const auto addGround = [&samples](double x0, double y0, double x1, double y1) {
    samples.addRectangle({x0, y0, 0.0}, {x1 - x0, 0.0, 0.0}, {0.0, y1 - y0, 0.0});
  };
  addGround(-kHalf_m, -kHalf_m, kHalf_m, kCorner.y());
  addGround(-kHalf_m, high.y(), kHalf_m, kHalf_m);
  addGround(-kHalf_m, kCorner.y(), kCorner.x(), high.y());
  addGround(high.x(), kCorner.y(), kHalf_m, high.y());
  return samples.snapshot();
}

/// Everything a part of the selection needs of those before it; made once.
struct Setup {
  std::shared_ptr<const gpis_mapping::MapSnapshot> snapshot{pileMap()};
  std::unique_ptr<GpisScene> scene{makeGpisScene(snapshot, GpisScene::Config())};
  MappedSurface surface{scene->surface()};
  RobotBody robot{pickingRobot()};
  ViewSelectorConfig config;
  SelectionRequest request;
  Selection selection;
  std::vector<Segment> segments;
  FailureMemory failures{0.1};

  Setup() {
    BoxPile pile;
    pile.add(kCorner + 0.5 * Eigen::Vector2d(kBrick.x() * kColumns, kBrick.y() * kRows),
             {kBrick.x() * kColumns, kBrick.y() * kRows, 0.6});
    request = requestOn(gridAround(pile, 15.0, 0.05), {-2.5, -2.0, 0.5}, 100.0);
    failures.add({-1.5, 0.0}, 0.3, 60.0);
    selection = ViewSelector(config, robot).select(*scene, failures, request);
    for (const ScoredSegment& scored : selection.segments) segments.push_back(scored.segment);
  }
};

const Setup& setup() {
  static const Setup once;
  return once;
}

void tellSize(benchmark::State& state) {
  state.counters["segments"] = static_cast<double>(setup().segments.size());
  state.counters["vertices"] = static_cast<double>(setup().surface.points_map.size());
}

/// Of a map that nobody keeps a mesh of (select_view): all of it is meshed first.
void BM_SceneAndSelect(benchmark::State& state) {
  const ViewSelector selector(setup().config, setup().robot);
  for (auto _ : state) {
    const auto scene = makeGpisScene(setup().snapshot, GpisScene::Config());
    const Selection selection = selector.select(*scene, setup().failures, setup().request);
    if (selection.status != SelectionStatus::kSelected) state.SkipWithError(selection.message.c_str());
  }
  tellSize(state);
}

/// With the mesh that the map's node keeps and publishes. That it answers another process by service is not in here.
void BM_Select(benchmark::State& state) {
  const ViewSelector selector(setup().config, setup().robot);
  for (auto _ : state) {
    const Selection selection = selector.select(*setup().scene, setup().failures, setup().request);
    if (selection.status != SelectionStatus::kSelected) state.SkipWithError(selection.message.c_str());
  }
  tellSize(state);
}

void BM_Mesh(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(makeGpisScene(setup().snapshot, GpisScene::Config()));
}

void BM_CopySurface(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(setup().scene->surface());
}

/// Among as many samples as a selection looks at.
void BM_GroundPlane(benchmark::State& state) {
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3f> normals;
  for (std::size_t i = 0; i < setup().surface.points_map.size(); i += setup().surface.points_map.size() / 20000 + 1) {
    points.push_back(setup().surface.points_map[i]);
    normals.push_back(setup().surface.normals_map[i]);
  }
  for (auto _ : state) {
    benchmark::DoNotOptimize(gpis_mapping::estimateGround(points, normals, setup().config.ground));
  }
}

void BM_OutlineAndSegments(benchmark::State& state) {
  for (auto _ : state) {
    const PileOutline outline = outlinePile(setup().surface, setup().selection.outline.ground, setup().config.outline);
    benchmark::DoNotOptimize(cutSegments(outline, setup().robot.footprint, setup().config.segments));
  }
}

void BM_Uncertainty(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(segmentUncertainty(*setup().scene, setup().segments));
}

ManipulabilityScore score() {
  return {*setup().scene,
          setup().surface,
          setup().selection.outline.ground,
          setup().config.outline.min_height_m,
          *setup().robot.sectors,
          setup().robot.T_base_armbase,
          setup().config.manipulability};
}

/// What is done once for all places.
void BM_ManipulabilitySamples(benchmark::State& state) {
  std::size_t num_asked = 0;
  for (auto _ : state) num_asked = score().numAsked();
  state.counters["samples"] = static_cast<double>(num_asked);
}

void BM_ManipulabilityOfAllPlaces(benchmark::State& state) {
  const ManipulabilityScore manipulability = score();
  for (auto _ : state) {
    for (const Segment& segment : setup().segments) {
      benchmark::DoNotOptimize(manipulability.at(segment.standing_map));
    }
  }
}

void BM_Travel(benchmark::State& state) {
  const base_navigation::Polygon& footprint = setup().robot.footprint;
  for (auto _ : state) {
    const base_navigation::DistanceField distances(*setup().request.ground, setup().request.T_map_base.position(),
                                                   base_navigation::inscribedRadius(footprint));
    const base_navigation::FootprintChecker standing(setup().request.ground, footprint,
                                                     setup().config.standing_padding_m);
    for (const Segment& segment : setup().segments) {
      benchmark::DoNotOptimize(distances.distance(segment.standing_map.position()));
      benchmark::DoNotOptimize(standing.check(segment.standing_map).state);
    }
  }
}

// Real time: the map's threads count, too.
BENCHMARK(BM_SceneAndSelect)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_Select)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_Mesh)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_CopySurface)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_GroundPlane)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_OutlineAndSegments)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_Uncertainty)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_ManipulabilitySamples)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_ManipulabilityOfAllPlaces)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_Travel)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace nbv_selection
