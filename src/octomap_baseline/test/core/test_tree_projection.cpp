// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline/tree_projection.h"

#include <cmath>

#include <gtest/gtest.h>

namespace octomap_baseline {
namespace {

using gpis_mapping::SpaceState;

SpaceState stateAt(const gpis_mapping::GroundGrid& grid, double x, double y) {
  const int column = static_cast<int>(std::floor((x - grid.origin_x_m) / grid.cell_size_m));
  const int row = static_cast<int>(std::floor((y - grid.origin_y_m) / grid.cell_size_m));
  if (column < 0 || row < 0 || column >= grid.width || row >= grid.height) return SpaceState::kUnknown;
  return grid.state[static_cast<std::size_t>(row) * grid.width + column];
}

TEST(TreeProjection, EmptyTreeGivesAnEmptyGrid) {
  const octomap::OcTree tree(0.1);
  const gpis_mapping::GroundGrid grid = projectDown(tree, -1.0, 1.0);
  EXPECT_EQ(grid.width, 0);
  EXPECT_EQ(grid.height, 0);
  EXPECT_TRUE(grid.state.empty());
}

TEST(TreeProjection, OccupiedBeatsFreeBeatsUnknownWithinTheHeights) {
  octomap::OcTree tree(0.1);
  tree.updateNode(octomap::point3d(0.05f, 0.05f, 0.05f), false);
  tree.updateNode(octomap::point3d(0.05f, 0.05f, 0.25f), true);  // above a free one
  tree.updateNode(octomap::point3d(-0.35f, 0.25f, 0.05f), false);
  tree.updateNode(octomap::point3d(0.25f, -0.15f, 0.95f), true);  // too high
  const gpis_mapping::GroundGrid grid = projectDown(tree, 0.0, 0.5);
  EXPECT_EQ(grid.cell_size_m, 0.1);
  EXPECT_NEAR(grid.origin_x_m, -0.4, 1e-9);
  EXPECT_NEAR(grid.origin_y_m, 0.0, 1e-9);
  EXPECT_EQ(grid.width, 5);
  EXPECT_EQ(grid.height, 3);
  EXPECT_EQ(stateAt(grid, 0.05, 0.05), SpaceState::kOccupied);
  EXPECT_EQ(stateAt(grid, -0.35, 0.25), SpaceState::kFree);
  EXPECT_EQ(stateAt(grid, -0.15, 0.15), SpaceState::kUnknown);
  EXPECT_EQ(stateAt(projectDown(tree, 0.0, 1.0), 0.25, -0.15), SpaceState::kOccupied);
  // The occupied voxel's centre is above the limit.
  EXPECT_EQ(stateAt(projectDown(tree, 0.0, 0.2), 0.05, 0.05), SpaceState::kFree);
}

TEST(TreeProjection, PrunedLeafCoversAllItsColumns) {
  octomap::OcTree tree(0.1);
  for (int x = 0; x < 4; ++x) {
    for (int y = 0; y < 4; ++y) {
      for (int z = 0; z < 4; ++z) {
        tree.setNodeValue(octomap::point3d(0.05f + 0.1f * x, 0.05f + 0.1f * y, 0.05f + 0.1f * z), 2.0f);
      }
    }
  }
  tree.prune();
  ASSERT_EQ(tree.getNumLeafNodes(), 1u);
  const gpis_mapping::GroundGrid grid = projectDown(tree, -1.0, 1.0);
  EXPECT_EQ(grid.width, 4);
  EXPECT_EQ(grid.height, 4);
  EXPECT_EQ(grid.state, std::vector<SpaceState>(16, SpaceState::kOccupied));
}

TEST(TreeProjection, SpecksCanBeLeftOut) {
  octomap::OcTree tree(0.1);
  tree.updateNode(octomap::point3d(0.05f, 0.05f, 0.05f), true);  // alone
  tree.updateNode(octomap::point3d(0.45f, 0.05f, 0.05f), true);  // two that touch at a corner
  tree.updateNode(octomap::point3d(0.55f, 0.15f, 0.15f), true);
  EXPECT_EQ(stateAt(projectDown(tree, 0.0, 0.5), 0.05, 0.05), SpaceState::kOccupied);
  const gpis_mapping::GroundGrid grid = projectDown(tree, 0.0, 0.5, true);
  EXPECT_EQ(stateAt(grid, 0.05, 0.05), SpaceState::kFree);
  EXPECT_EQ(stateAt(grid, 0.45, 0.05), SpaceState::kOccupied);
  EXPECT_EQ(stateAt(grid, 0.55, 0.15), SpaceState::kOccupied);
}

}  // namespace
}  // namespace octomap_baseline
