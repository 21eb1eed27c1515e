// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/box_separation.h"

#include <gtest/gtest.h>

#include "synthetic_depth/seeded_random.h"

namespace simulated_world {
namespace {

using synthetic_depth::SeededRandom;

Eigen::Isometry3d randomPose(SeededRandom& random, double half_m) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() = Eigen::Vector3d(random.uniform(-half_m, half_m), random.uniform(-half_m, half_m),
                                       random.uniform(-half_m, half_m));
  const Eigen::Vector3d axis(random.normal(), random.normal(), random.normal());
  pose.linear() = Eigen::AngleAxisd(random.uniform(0.0, 3.0), axis.normalized()).toRotationMatrix();
  return pose;
}

/// Whether any point of a fine grid in the first box is in the second, which is grown by `grow_m`.
bool shareAPoint(const Eigen::Isometry3d& T_map_a, const Eigen::Vector3d& size_a, const Eigen::Isometry3d& T_map_b,
                 const Eigen::Vector3d& size_b, double grow_m) {
  const Eigen::Isometry3d T_b_a = T_map_b.inverse() * T_map_a;
  constexpr int kPoints = 40;
  for (int i = 0; i <= kPoints; ++i) {
    for (int j = 0; j <= kPoints; ++j) {
      for (int k = 0; k <= kPoints; ++k) {
        const Eigen::Vector3d share = Eigen::Vector3d(i, j, k) / kPoints - Eigen::Vector3d::Constant(0.5);
        const Eigen::Vector3d p = T_b_a * share.cwiseProduct(size_a);
        if ((p.cwiseAbs() - 0.5 * size_b).maxCoeff() <= grow_m) return true;
      }
    }
  }
  return false;
}

TEST(BoxSeparation, TellsWhetherBoxesShareAPoint) {
  const Eigen::Vector3d size_a(0.3, 0.2, 0.1);
  const Eigen::Vector3d size_b(0.1, 0.4, 0.2);
  // Two neighbours in the grid of points are so far apart at most.
  const double grid_m = size_a.norm() / 40.0;
  SeededRandom random(1);
  int num_apart = 0;
  int num_overlapping = 0;
  for (int repeat = 0; repeat < 300; ++repeat) {
    const Eigen::Isometry3d a = randomPose(random, 0.2);
    const Eigen::Isometry3d b = randomPose(random, 0.2);
    const double separation = boxSeparation(a, size_a, b, size_b);
    EXPECT_NEAR(separation, boxSeparation(b, size_b, a, size_a), 1e-12);
    if (separation > 0.0) {
      ++num_apart;
      EXPECT_FALSE(shareAPoint(a, size_a, b, size_b, 0.0));
    } else {
      ++num_overlapping;
      EXPECT_TRUE(shareAPoint(a, size_a, b, size_b, grid_m));
    }
  }
  EXPECT_GT(num_apart, 50);
  EXPECT_GT(num_overlapping, 50);
}

TEST(BoxSeparation, IsTheGapOfAlignedBoxes) {
  const Eigen::Vector3d size(0.3, 0.2, 0.2);
  Eigen::Isometry3d a = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d b = a;
  for (const double gap_m : {-0.05, 0.0, 0.05}) {
    b.translation().z() = 0.2 + gap_m;
    EXPECT_NEAR(boxSeparation(a, size, b, size), gap_m, 1e-12);
  }
}

TEST(BoxSeparation, SeesAGapBetweenCrossedEdges) {
  // Two rods on edge, one above the other and crosswise: no face separates them.
  const Eigen::Vector3d rod(1.0, 0.1, 0.1);
  Eigen::Isometry3d a = Eigen::Isometry3d::Identity();
  a.linear() = Eigen::AngleAxisd(0.25 * 3.14159265358979, Eigen::Vector3d::UnitX()).toRotationMatrix();
  Eigen::Isometry3d b = Eigen::Isometry3d::Identity();
  b.linear() = Eigen::AngleAxisd(0.5 * 3.14159265358979, Eigen::Vector3d::UnitZ()).toRotationMatrix() * a.linear();
  b.translation().z() = 0.1 * std::sqrt(2.0) + 0.01;
  EXPECT_NEAR(boxSeparation(a, rod, b, rod), 0.01, 1e-9);
}

}  // namespace
}  // namespace simulated_world
