// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/voxel_states.h"

#include <map>
#include <random>
#include <set>
#include <stdexcept>
#include <string>
#include <tuple>

#include <gtest/gtest.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

#include "analytic_surfaces.h"

namespace gpis_mapping {
namespace {

using gpis_mapping_test::buildCells;
using gpis_mapping_test::pagesOf;
using test_support::messageOf;

constexpr std::size_t kMany = 10'000'000;

using States = std::map<std::tuple<int, int, int>, SpaceState>;

/// Each voxel once, or the test fails.
States tableOf(const VoxelStates& voxels) {
  States table;
  for (const LatticeKey& key : voxels.occupied) {
    EXPECT_TRUE(table.emplace(std::make_tuple(key.x, key.y, key.z), SpaceState::kOccupied).second);
  }
  for (const LatticeKey& key : voxels.free) {
    EXPECT_TRUE(table.emplace(std::make_tuple(key.x, key.y, key.z), SpaceState::kFree).second);
  }
  return table;
}

MapSnapshot snapshotOf(const std::vector<SurfacePoint>& points, ObservedLayer observed) {
  const GpisConfig config;
  return {config, pagesOf(buildCells(config, points)), std::move(observed), 0.0, 1};
}

TEST(VoxelStates, AreWhatQueriesSayAtEveryCentre) {
  const Eigen::Vector3d centre(0.11, -0.07, 0.32);
  std::vector<SurfacePoint> points = gpis_mapping_test::sampleSphere(centre, 0.2, 0.02);
  // No point on the border of two voxels: positions are rounded to floats in the map.
  gpis_mapping_test::sampleRectangle({-0.403, -0.504, 0.003}, {0.9, 0.0, 0.0}, {0.0, 0.8, 0.0}, 0.02, 0.002, &points);
  // Free far away, near surfaces, and, by mistake, within the sphere; in negative coordinates, too.
  ObservedLayer observed{GpisConfig().observed.block_size_m};
  std::mt19937 rng(7);
  for (int i = 0; i < 4000; ++i) observed.setFree(gpis_mapping_test::randomVector(&rng, -1.2, 1.2), 1.0f);
  const MapSnapshot snapshot = snapshotOf(points, std::move(observed));

  for (const double size_m : {0.05, 0.1, 0.07}) {
    const States voxels = tableOf(classifyVoxels(snapshot, size_m, kMany));
    std::set<std::tuple<int, int, int>> shell;
    for (const SurfacePoint& point : points) {
      const Eigen::Vector3d inside =
          point.position_map - shellDepth(snapshot.config(), size_m) * point.normal_map.cast<double>();
      EXPECT_LT(snapshot.field(inside).value, 0.0) << "the field's sign says the same";
      const LatticeKey key = LatticeKey::of(inside, size_m);
      shell.emplace(key.x, key.y, key.z);
    }
    const int reach = static_cast<int>(1.5 / size_m);  // beyond all that is known
    std::size_t num_known = 0;
    std::map<SpaceState, int> counts;
    for (int x = -reach; x <= reach; ++x) {
      for (int y = -reach; y <= reach; ++y) {
        for (int z = -reach; z <= reach; ++z) {
          const Points3d p = LatticeKey{x, y, z}.center(size_m);
          const auto key = std::make_tuple(x, y, z);
          const SpaceState expected = shell.count(key) > 0 ? SpaceState::kOccupied : snapshot.query(p).state[0];
          const auto found = voxels.find(key);
          ASSERT_EQ(found == voxels.end() ? SpaceState::kUnknown : found->second, expected) << p.transpose();
          ++counts[expected];
          num_known += expected != SpaceState::kUnknown ? 1 : 0;
        }
      }
    }
    EXPECT_EQ(num_known, voxels.size()) << "none beyond";
    EXPECT_GT(counts[SpaceState::kOccupied], 50);
    EXPECT_GT(counts[SpaceState::kFree], 50);
  }
}

TEST(VoxelStates, KeepABoardThinnerThanAVoxel) {
  // 3 cm thick, between the centres of voxels of 10 cm: no centre is inside.
  const Eigen::Vector3d low(-0.3, 0.06, 0.05);
  const Eigen::Vector3d high(0.3, 0.09, 0.65);
  const MapSnapshot snapshot = snapshotOf(gpis_mapping_test::sampleBox(low, high, 0.02, true),
                                          ObservedLayer(GpisConfig().observed.block_size_m));
  const States voxels = tableOf(classifyVoxels(snapshot, 0.1, kMany));
  for (int x = -3; x < 3; ++x) {
    for (int z = 1; z < 6; ++z) {
      const Points3d centre = LatticeKey{x, 0, z}.center(0.1);
      ASSERT_NE(snapshot.query(centre).state[0], SpaceState::kOccupied) << "or nothing is tested";
      EXPECT_EQ(voxels.at({x, 0, z}), SpaceState::kOccupied) << centre.transpose();
    }
  }
}

TEST(VoxelStates, ANoisyFloorOnTheBorderLeavesTheVoxelsAboveFree) {
  std::vector<SurfacePoint> points;
  gpis_mapping_test::sampleRectangle({-0.5, -0.5, 0.0}, {1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, 0.02, 0.002, &points);
  std::mt19937 rng(3);
  std::normal_distribution<double> noise(0.0, 0.002);
  for (SurfacePoint& point : points) point.position_map.z() += noise(rng);
  const MapSnapshot snapshot = snapshotOf(points, ObservedLayer(GpisConfig().observed.block_size_m));
  const States voxels = tableOf(classifyVoxels(snapshot, 0.05, kMany));
  for (int x = -9; x < 9; ++x) {
    for (int y = -9; y < 9; ++y) {
      EXPECT_EQ(voxels.at({x, y, 0}), SpaceState::kFree) << x << ' ' << y;
      EXPECT_EQ(voxels.at({x, y, -1}), SpaceState::kOccupied) << x << ' ' << y;
    }
  }
}

TEST(VoxelStates, RefuseImpossibleAndTooManyVoxels) {
  const MapSnapshot snapshot =
      snapshotOf(gpis_mapping_test::sampleSphere({0.0, 0.0, 0.0}, 0.2, 0.02), ObservedLayer(0.05));
  EXPECT_EQ(messageOf<std::invalid_argument>([&] { classifyVoxels(snapshot, 0.0, kMany); }),
            "voxel size = 0 m, must be in [0.005, 10] m");
  EXPECT_THROW(classifyVoxels(snapshot, std::numeric_limits<double>::quiet_NaN(), kMany), std::invalid_argument);
  const std::string message = messageOf<std::invalid_argument>([&] { classifyVoxels(snapshot, 0.01, 1000); });
  EXPECT_NE(message.find("must be at most 1000"), std::string::npos) << message;
  const VoxelStates none = classifyVoxels(snapshotOf({}, ObservedLayer(0.05)), 0.05, 0);
  EXPECT_TRUE(none.free.empty() && none.occupied.empty());
}

}  // namespace
}  // namespace gpis_mapping
