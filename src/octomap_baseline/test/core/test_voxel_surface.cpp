// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline/voxel_surface.h"

#include <cmath>
#include <limits>
#include <random>

#include <gtest/gtest.h>

namespace octomap_baseline {
namespace {

using gpis_mapping::Points3d;
using gpis_mapping::QueryResult;
using gpis_mapping::SpaceState;

constexpr double kVoxel_m = 0.05;

SpaceState stateAt(const octomap::OcTree& tree, const Eigen::Vector3d& p) {
  const octomap::OcTreeNode* node = tree.search(p.x(), p.y(), p.z());
  if (node == nullptr) return SpaceState::kUnknown;
  return tree.isNodeOccupied(node) ? SpaceState::kOccupied : SpaceState::kFree;
}

/// A third of a box of voxels each; with a block of occupied ones, which is one leaf.
octomap::OcTree randomTree(unsigned seed) {
  octomap::OcTree tree(kVoxel_m);
  std::mt19937 random(seed);
  for (int x = -4; x < 6; ++x) {
    for (int y = -4; y < 6; ++y) {
      for (int z = -2; z < 4; ++z) {
        const octomap::point3d middle(static_cast<float>((x + 0.5) * kVoxel_m),
                                      static_cast<float>((y + 0.5) * kVoxel_m),
                                      static_cast<float>((z + 0.5) * kVoxel_m));
        const bool is_block = x >= 0 && x < 4 && y >= 0 && y < 4 && z >= 0;
        const unsigned kind = random() % 3;
        if (is_block) tree.setNodeValue(middle, 2.0F);
        if (!is_block && kind != 2) tree.updateNode(middle, kind == 0);
      }
    }
  }
  tree.prune();
  return tree;
}

/// The nearest point of all sides between an occupied and a free voxel, one after the other.
double distanceBySearch(const octomap::OcTree& tree, const Eigen::Vector3d& x) {
  double least_m = std::numeric_limits<double>::infinity();
  const Eigen::Array3d half = Eigen::Array3d::Constant(0.5 * kVoxel_m);
  for (int i = -6; i < 8; ++i) {
    for (int j = -6; j < 8; ++j) {
      for (int k = -4; k < 6; ++k) {
        const Eigen::Vector3d middle = kVoxel_m * Eigen::Vector3d(i + 0.5, j + 0.5, k + 0.5);
        if (stateAt(tree, middle) != SpaceState::kOccupied) continue;
        for (int axis = 0; axis < 3; ++axis) {
          for (const double front : {-1.0, 1.0}) {
            const Eigen::Vector3d step = front * kVoxel_m * Eigen::Vector3d::Unit(axis);
            if (stateAt(tree, middle + step) != SpaceState::kFree) continue;
            Eigen::Array3d beyond = ((x - middle - 0.5 * step).array().abs() - half).max(0.0);
            beyond[axis] = std::abs(x[axis] - middle[axis] - 0.5 * step[axis]);
            least_m = std::min(least_m, beyond.matrix().norm());
          }
        }
      }
    }
  }
  return least_m;
}

TEST(VoxelSurface, DistancesAreThoseToTheNearestSideWithTheSignOfTheState) {
  for (unsigned seed = 0; seed < 4; ++seed) {
    const octomap::OcTree tree = randomTree(seed);
    std::mt19937 random(seed + 100);
    std::uniform_real_distribution<double> spread(-0.4, 0.5);
    Points3d points(3, 300);
    for (Eigen::Index i = 0; i < points.size(); ++i) points.data()[i] = spread(random);
    const QueryResult result = querySides(tree, false, points, {});
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      const Eigen::Vector3d x = points.col(i);
      const SpaceState state = stateAt(tree, x);
      ASSERT_EQ(result.state[static_cast<std::size_t>(i)], state);
      EXPECT_NEAR(result.euclidean_distance[i], distanceBySearch(tree, x), 1e-6) << "of the tree's float coordinates";
      EXPECT_EQ(std::abs(result.distance[i]), result.euclidean_distance[i]);
      if (state != SpaceState::kUnknown) {
        EXPECT_EQ(result.distance[i] < 0.0, state == SpaceState::kOccupied);
      }
      EXPECT_EQ(std::isnan(result.occupancy[i]), state == SpaceState::kUnknown);
      if (result.euclidean_distance[i] < 1e-4) continue;
      // The derivative by differences, where no other side is as near.
      constexpr double kStep_m = 1e-6;
      Eigen::Vector3d slope;
      for (int axis = 0; axis < 3; ++axis) {
        Points3d pair(3, 2);
        pair << x + kStep_m * Eigen::Vector3d::Unit(axis), x - kStep_m * Eigen::Vector3d::Unit(axis);
        const QueryResult near = querySides(tree, false, pair, {});
        slope[axis] = (near.euclidean_distance[0] - near.euclidean_distance[1]) / (2.0 * kStep_m);
      }
      if (std::abs(slope.norm() - 1.0) > 1e-4) continue;  // between two sides
      EXPECT_NEAR((slope - result.euclidean_gradient.col(i)).norm(), 0.0, 1e-3);
    }
  }
}

TEST(VoxelSurface, TrianglesLieBetweenOccupiedAndFreeAndTurnToTheFree) {
  const octomap::OcTree tree = randomTree(7);
  const gpis_mapping::TriangleMesh mesh = meshOfSides(tree);
  ASSERT_FALSE(mesh.triangles.empty());
  ASSERT_EQ(mesh.normals_map.size(), mesh.vertices_map.size());
  ASSERT_EQ(mesh.variance_m2.size(), mesh.vertices_map.size());
  double area_m2 = 0.0;
  for (const auto& triangle : mesh.triangles) {
    const Eigen::Vector3d &a = mesh.vertices_map[triangle[0]], &b = mesh.vertices_map[triangle[1]],
                          &c = mesh.vertices_map[triangle[2]];
    const Eigen::Vector3d normal = (b - a).cross(c - a);
    area_m2 += 0.5 * normal.norm();
    const Eigen::Vector3d middle = (a + b + c) / 3.0, ahead = 0.5 * kVoxel_m * normal.normalized();
    EXPECT_EQ(stateAt(tree, middle + ahead), SpaceState::kFree);
    EXPECT_EQ(stateAt(tree, middle - ahead), SpaceState::kOccupied);
  }
  int sides = 0;
  for (int i = -6; i < 8; ++i) {
    for (int j = -6; j < 8; ++j) {
      for (int k = -4; k < 6; ++k) {
        const Eigen::Vector3d middle = kVoxel_m * Eigen::Vector3d(i + 0.5, j + 0.5, k + 0.5);
        if (stateAt(tree, middle) != SpaceState::kOccupied) continue;
        for (int axis = 0; axis < 3; ++axis) {
          for (const double front : {-kVoxel_m, kVoxel_m}) {
            sides += stateAt(tree, middle + front * Eigen::Vector3d::Unit(axis)) == SpaceState::kFree ? 1 : 0;
          }
        }
      }
    }
  }
  EXPECT_NEAR(area_m2, sides * kVoxel_m * kVoxel_m, 1e-6);

  const Eigen::AlignedBox3d box{Eigen::Vector3d::Constant(-0.07), Eigen::Vector3d{0.12, 0.12, 0.02}};
  const auto countIn = [&box](const gpis_mapping::TriangleMesh& in) {
    return std::count_if(in.triangles.begin(), in.triangles.end(), [&](const auto& t) {
      return box.contains(
          Eigen::Vector3d((in.vertices_map[t[0]] + in.vertices_map[t[1]] + in.vertices_map[t[2]]) / 3.0));
    });
  };
  const gpis_mapping::TriangleMesh part = meshOfSides(tree, false, box);
  EXPECT_LT(part.triangles.size(), mesh.triangles.size() / 2);
  EXPECT_GT(countIn(part), 10);
  EXPECT_EQ(countIn(part), countIn(mesh));
}

TEST(VoxelSurface, WithoutASideThereIsNoDistance) {
  octomap::OcTree tree(kVoxel_m);
  tree.updateNode(octomap::point3d(0.01F, 0.01F, 0.01F), true);
  Points3d points(3, 3);
  points.col(0).setConstant(0.01);
  points.col(1).setConstant(1.0);
  points.col(2).setConstant(std::numeric_limits<double>::quiet_NaN());
  gpis_mapping::QueryOptions options;
  options.variance_gradient = true;
  const QueryResult result = querySides(tree, false, points, options);
  EXPECT_EQ(result.state, (std::vector<SpaceState>{SpaceState::kOccupied, SpaceState::kUnknown, SpaceState::kUnknown}));
  EXPECT_TRUE(result.distance.array().isNaN().all());
  EXPECT_TRUE(result.variance.array().isNaN().all());
  EXPECT_TRUE(result.variance_gradient.array().isNaN().all());
  EXPECT_GT(result.occupancy[0], 0.5);
}

TEST(VoxelSurface, SpecksHaveNoSidesIfTheyAreLeftOut) {
  octomap::OcTree tree(kVoxel_m);
  for (int x = -3; x <= 3; ++x)
    tree.updateNode(octomap::point3d(static_cast<float>(x) * 0.05F + 0.01F, 0.01F, 0.01F), x == 0);
  EXPECT_EQ(meshOfSides(tree).triangles.size(), 4U);
  EXPECT_TRUE(meshOfSides(tree, true).triangles.empty());
  tree.updateNode(octomap::point3d(0.06F, 0.06F, 0.06F), true);  // they touch at a corner
  EXPECT_EQ(meshOfSides(tree, true).triangles.size(), 4U);
}

}  // namespace
}  // namespace octomap_baseline
