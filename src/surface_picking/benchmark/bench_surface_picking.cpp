// SPDX-License-Identifier: BSD-3-Clause
// One look at a pile of ten bricks, one leaning on others and one on top, mapped from all around, and its parts. The view is
// 3 x 3 m, as a camera's over a pile. Defaults throughout.
#include <benchmark/benchmark.h>
#include <mp700_ur5e_description/brick_types.h>

#include "support/mapped_scene.h"
#include "surface_picking/bodies.h"
#include "surface_picking/cuboids.h"
#include "surface_picking/patches.h"

namespace surface_picking {
namespace {

const Eigen::Vector3d kBrick_m(0.3, 0.2, 0.2);

const test_support::MappedScene& pile() {
  static const test_support::MappedScene kPile = [] {
    test_support::SceneOfSolids solids;
    for (int i = 0; i < 8; ++i) {
      solids.addBox(kBrick_m, test_support::pose(0.4 * (i % 4) - 0.6, 0.5 * (i / 4) - 0.25, 0.1, 0.7 * i));
    }
    solids.addBox(kBrick_m, test_support::pose(-0.2, 0.1, 0.25, 0.3, 0.0, 0.6));
    solids.addBox(kBrick_m, test_support::pose(0.4, -0.25, 0.3, 1.1));
    solids.lookAround(8);
    test_support::MappedScene mapped = test_support::mapScene(solids);
    mapped.mesh = cropMesh(mapped.mesh, {-1.5, -1.5, -1.0}, {1.5, 1.5, 2.0});
    return mapped;
  }();
  return kPile;
}

const std::vector<mp700_ur5e_description::BrickType>& types() {
  static const std::vector<mp700_ur5e_description::BrickType> kTypes = [] {
    mp700_ur5e_description::BrickType type;
    type.name = "brick";
    type.size_m = kBrick_m;
    return std::vector<mp700_ur5e_description::BrickType>{type};
  }();
  return kTypes;
}

std::vector<SpaceState> stateOf(const Eigen::Matrix3Xd& points_map) {
  gpis_mapping::QueryOptions options;
  options.variance = false;
  options.threads = 1;
  return pile().snapshot->query(points_map, options).state;
}

void patches(benchmark::State& state) {
  const TriangleMesh& mesh = pile().mesh;
  std::size_t found = 0;
  for (auto _ : state) found = findPatches(mesh, PatchConfig()).size();
  state.counters["vertices"] = static_cast<double>(mesh.vertices_map.size());
  state.counters["patches"] = static_cast<double>(found);
}
BENCHMARK(patches)->Unit(benchmark::kMillisecond);

void cuboids(benchmark::State& state) {
  const std::vector<Patch> patches = findPatches(pile().mesh, PatchConfig());
  CuboidStatistics statistics;
  std::size_t found = 0;
  for (auto _ : state) {
    statistics = {};
    found = findCuboids(pile().mesh, patches, types(), stateOf, CuboidConfig(), &statistics).size();
  }
  state.counters["hypotheses"] = statistics.num_hypotheses;
  state.counters["bodies"] = static_cast<double>(found);
}
BENCHMARK(cuboids)->Unit(benchmark::kMillisecond);

void look(benchmark::State& state) {
  BodyTracker tracker{BodyConfig()};
  double stamp_s = 0.0;
  for (auto _ : state) {
    const std::vector<Patch> patches = findPatches(pile().mesh, PatchConfig());
    tracker.update(stamp_s += 1.0, findCuboids(pile().mesh, patches, types(), stateOf, CuboidConfig()), stateOf);
  }
  state.counters["bodies"] = static_cast<double>(tracker.bodies().size());
}
BENCHMARK(look)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace surface_picking
