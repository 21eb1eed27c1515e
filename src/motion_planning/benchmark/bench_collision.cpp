// SPDX-License-Identifier: BSD-3-Clause
// Collision world and collision test before a pile of twelve bricks meshed at 1 cm. One thread but for the scene's update.
#include <cmath>
#include <random>

#include <benchmark/benchmark.h>
#include <mp700_ur5e_description/robot_names.h>

#include "motion_planning/collision_checker.h"
#include "support/box_world.h"

namespace motion_planning {
namespace {

std::shared_ptr<const ArmKinematics> makeArm() {
  static const auto kArm = std::make_shared<const ArmKinematics>(
      mp700_ur5e_description::RobotModel::load(DESCRIPTION_DIR "/urdf/mp700_ur5e.urdf"));
  return kArm;
}

/// Bricks on the ground before the robot, base_link at the map's origin; what is behind each of them has not been seen.
BoxWorld makePile() {
  BoxWorld world;
  world.ground_z_m = 0.0;
  world.ground_half_edge_m = 1.2;
  std::mt19937 engine(1);
  std::uniform_real_distribution<double> jitter(-0.03, 0.03);
  for (int i = 0; i < 12; ++i) {
    OrientedBox brick = uprightBox(
        {0.75 + 0.33 * (i / 6) + jitter(engine), -0.45 + 0.36 * (i % 3) + jitter(engine), 0.1 + 0.2 * (i / 3 % 2)},
        {0.3, 0.2, 0.2});
    brick.T_map_box.rotate(Eigen::AngleAxisd(10.0 * jitter(engine), Eigen::Vector3d::UnitZ()));
    world.boxes.push_back(brick);
  }
  world.is_unknown = [](const Eigen::Vector3d& p) { return p.x() > 1.25 && p.z() < 0.35; };
  return world;
}

/// Random postures whose tip is before the robot, in the band of heights asked for.
std::vector<ArmVector> postures(const CollisionChecker& checker, double min_height_m, double max_height_m) {
  std::mt19937 engine(2);
  std::uniform_real_distribution<double> angle(-M_PI, M_PI);
  std::vector<ArmVector> result;
  while (result.size() < 1000) {
    const ArmVector joints = ArmVector::NullaryExpr([&] { return angle(engine); });
    const Eigen::Vector3d tip = checker.arm().tipPose(joints).translation();
    if (tip.x() < 0.6 || std::abs(tip.y()) > 0.6 || tip.z() < min_height_m || tip.z() > max_height_m) continue;
    if (checker.isFree(joints)) result.push_back(joints);
  }
  return result;
}

void checkBetween(benchmark::State& state, double min_height_m, double max_height_m, bool is_held) {
  const BoxWorld world = makePile();
  CollisionSceneBuilder builder{CollisionSceneConfig()};
  builder.update(world.surface(0.01), world, Eigen::Isometry3d::Identity());
  CollisionChecker checker(makeArm(), builder.scene(), Eigen::Isometry3d::Identity());
  if (is_held) checker.setHeld(HeldBrick{Eigen::Isometry3d(Eigen::Translation3d(0.0, 0.0, 0.1)), {0.3, 0.2, 0.2}});
  const std::vector<ArmVector> joints = postures(checker, min_height_m, max_height_m);
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(checker.check(joints[i++ % joints.size()]).kind);
}

void BM_CheckInFreeSpace(benchmark::State& state) {
  checkBetween(state, 0.9, 1.6, false);
}
BENCHMARK(BM_CheckInFreeSpace)->Unit(benchmark::kMicrosecond);

void BM_CheckNearThePile(benchmark::State& state) {
  checkBetween(state, 0.3, 0.55, false);
}
BENCHMARK(BM_CheckNearThePile)->Unit(benchmark::kMicrosecond);

void BM_CheckWithBrickNearThePile(benchmark::State& state) {
  checkBetween(state, 0.5, 0.75, true);
}
BENCHMARK(BM_CheckWithBrickNearThePile)->Unit(benchmark::kMicrosecond);

/// As a planner meets them: any posture, free or not.
void BM_CheckAnywhere(benchmark::State& state) {
  const BoxWorld world = makePile();
  CollisionSceneBuilder builder{CollisionSceneConfig()};
  builder.update(world.surface(0.01), world, Eigen::Isometry3d::Identity());
  const CollisionChecker checker(makeArm(), builder.scene(), Eigen::Isometry3d::Identity());
  std::mt19937 engine(3);
  std::uniform_real_distribution<double> angle(-M_PI, M_PI);
  std::vector<ArmVector> joints(1000);
  for (ArmVector& q : joints) q = ArmVector::NullaryExpr([&] { return angle(engine); });
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(checker.check(joints[i++ % joints.size()]).kind);
}
BENCHMARK(BM_CheckAnywhere)->Unit(benchmark::kMicrosecond);

void BM_Clearance(benchmark::State& state) {
  const BoxWorld world = makePile();
  CollisionSceneBuilder builder{CollisionSceneConfig()};
  builder.update(world.surface(0.01), world, Eigen::Isometry3d::Identity());
  const CollisionChecker checker(makeArm(), builder.scene(), Eigen::Isometry3d::Identity());
  const std::vector<ArmVector> joints = postures(checker, 0.3, 0.55);
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(checker.clearance(joints[i++ % joints.size()], 0.5));
}
BENCHMARK(BM_Clearance)->Unit(benchmark::kMicrosecond);

void BM_SetTarget(benchmark::State& state) {
  const BoxWorld world = makePile();
  CollisionSceneBuilder builder{CollisionSceneConfig()};
  builder.update(world.surface(0.01), world, Eigen::Isometry3d::Identity());
  CollisionChecker checker(makeArm(), builder.scene(), Eigen::Isometry3d::Identity());
  for (auto _ : state) {
    checker.setTarget({});
    checker.setTarget(world.boxes[4]);
  }
}
BENCHMARK(BM_SetTarget)->Unit(benchmark::kMillisecond);

void BM_FirstScene(benchmark::State& state) {
  const BoxWorld world = makePile();
  const Surface surface = world.surface(1e-3 * static_cast<double>(state.range(0)));
  SceneUpdate update;
  for (auto _ : state) {
    CollisionSceneBuilder builder{CollisionSceneConfig()};
    update = builder.update(surface, world, Eigen::Isometry3d::Identity());
  }
  state.counters["triangles"] = static_cast<double>(update.triangles);
  state.counters["chunks"] = static_cast<double>(update.chunks);
  state.counters["blocks"] = static_cast<double>(update.blocks_asked);
  state.counters["mesh_ms"] = update.mesh_ms;
  state.counters["lattice_ms"] = update.lattice_ms;
}
BENCHMARK(BM_FirstScene)->ArgName("edge_mm")->Arg(10)->Arg(16)->Unit(benchmark::kMillisecond);

/// One brick comes and goes.
void BM_SceneAfterOneBrick(benchmark::State& state) {
  BoxWorld world = makePile();
  const BoxWorld all = world;
  world.boxes.pop_back();
  const std::vector<Surface> surfaces = {all.surface(1e-3 * static_cast<double>(state.range(0))),
                                         world.surface(1e-3 * static_cast<double>(state.range(0)))};
  CollisionSceneBuilder builder{CollisionSceneConfig()};
  builder.update(surfaces[0], all, Eigen::Isometry3d::Identity());
  SceneUpdate update;
  std::size_t i = 0;
  for (auto _ : state) {
    ++i;
    update = builder.update(surfaces[i % 2], i % 2 == 0 ? all : world, Eigen::Isometry3d::Identity());
  }
  state.counters["rebuilt"] = static_cast<double>(update.chunks_rebuilt);
  state.counters["blocks"] = static_cast<double>(update.blocks_asked);
  state.counters["mesh_ms"] = update.mesh_ms;
  state.counters["lattice_ms"] = update.lattice_ms;
}
BENCHMARK(BM_SceneAfterOneBrick)->ArgName("edge_mm")->Arg(10)->Arg(16)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace motion_planning
