// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/partition_of_unity.h"

#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <set>

#include <gtest/gtest.h>

#include "analytic_surfaces.h"
#include "eigen_asserts.h"

namespace gpis_mapping {
namespace {

using gpis_mapping_test::centralDifference;
using gpis_mapping_test::isNear;
using gpis_mapping_test::randomVector;

constexpr double kSize = 0.1;      // m
constexpr double kMargin = 0.015;  // m
const GpisConfig::Cells kCells{kSize, 0.03, kMargin};

std::map<LatticeKey, double> weightsAt(const Eigen::Vector3d& x) {
  BlendWeight entries[8];
  const int count = blendWeights(x, kCells, entries);
  std::map<LatticeKey, double> weights;
  for (int i = 0; i < count; ++i) weights[entries[i].key] = entries[i].weight;
  return weights;
}

TEST(PartitionOfUnity, WeightsSumToOneAndGradientsToZero) {
  std::mt19937 rng(1);
  std::set<int> counts;
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Vector3d x = randomVector(&rng, -0.35, 0.35);
    BlendWeight entries[8];
    const int count = blendWeights(x, kCells, entries);
    counts.insert(count);
    double sum = 0.0;
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    std::set<LatticeKey> keys;
    for (int j = 0; j < count; ++j) {
      EXPECT_GE(entries[j].weight, 0.0);
      EXPECT_LE(entries[j].weight, 1.0);
      sum += entries[j].weight;
      gradient += entries[j].gradient;
      keys.insert(entries[j].key);
    }
    EXPECT_NEAR(sum, 1.0, 1e-14);                                   // eight roundings
    EXPECT_TRUE(isNear(gradient, Eigen::Vector3d::Zero(), 1e-12));  // of terms up to 1 / kMargin
    EXPECT_EQ(keys.size(), static_cast<std::size_t>(count)) << "a cell is listed twice";
  }
  // In the middle, at a face, at an edge, at a corner of a cube.
  EXPECT_EQ(counts, (std::set<int>{1, 2, 4, 8}));
}

TEST(PartitionOfUnity, BeyondTheLatticeTheCellAtItsBorderHasAllTheWeight) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  for (const double far : {1e300, -1e300, 1.2e8, -1.2e8, infinity, -infinity, nan}) {
    const auto weights = weightsAt({0.0, far, 0.0});
    ASSERT_EQ(weights.size(), 1u) << far;
    EXPECT_EQ(weights.begin()->first, (LatticeKey{0, far > 0.0 ? 1 << 30 : -(1 << 30), 0})) << far;
    EXPECT_EQ(weights.begin()->second, 1.0) << far;
  }
}

TEST(PartitionOfUnity, OwnCellHasAllTheWeightInsideItsCore) {
  for (const double offset : {-7.0, -1.0, 0.0, 3.0}) {
    const Eigen::Vector3d x(offset * kSize, (offset - 0.3) * kSize, (offset + 0.34) * kSize);
    const int index = static_cast<int>(offset);
    EXPECT_EQ(weightsAt(x), (std::map<LatticeKey, double>{{LatticeKey{index, index, index}, 1.0}}));
  }
}

TEST(PartitionOfUnity, EveryCellThatHasAWeightIsWithinTheMargin) {
  std::mt19937 rng(2);
  for (int i = 0; i < 5000; ++i) {
    const Eigen::Vector3d x = randomVector(&rng, -0.35, 0.35);
    const auto weights = weightsAt(x);
    for (const auto& [key, weight] : weights) {
      for (int axis = 0; axis < 3; ++axis) {
        const double from_center = std::abs(x[axis] - kCells.center(key)[axis]);
        EXPECT_LE(from_center, 0.5 * kSize + kMargin + 1e-12);
      }
    }
    // The cell that holds the point has at least the largest weight of all.
    const double own = weights.at(kCells.at(x));
    for (const auto& entry : weights) EXPECT_GE(own, entry.second - 1e-12);
  }
}

TEST(PartitionOfUnity, NeighboursShareEquallyOnTheirCommonFace) {
  // Both sides of zero, and a face whose coordinate is no binary fraction.
  for (const int face : {-4, -1, 0, 1, 3}) {
    const auto weights = weightsAt({(face - 0.5) * kSize, 0.0, 0.0});
    ASSERT_EQ(weights.size(), 2u);
    EXPECT_NEAR(weights.at(LatticeKey{face - 1, 0, 0}), 0.5, 1e-12);
    EXPECT_NEAR(weights.at(LatticeKey{face, 0, 0}), 0.5, 1e-12);
  }
}

TEST(PartitionOfUnity, GradientsMatchCentralDifferences) {
  std::mt19937 rng(3);
  for (int i = 0; i < 3000; ++i) {
    const Eigen::Vector3d x = randomVector(&rng, -0.25, 0.25);
    BlendWeight entries[8];
    const int count = blendWeights(x, kCells, entries);
    for (int j = 0; j < count; ++j) {
      const LatticeKey key = entries[j].key;
      const auto weight = [key](const Eigen::Vector3d& y) {
        const auto weights = weightsAt(y);
        const auto found = weights.find(key);
        return found == weights.end() ? 0.0 : found->second;
      };
      // Step 1e-7 m: truncation step^2 w''' / 6, w''' at most 60 / (2 kMargin)^3, is 2e-8; rounding 1e-16 / step 1e-9.
      // At the band's ends w''' jumps from 0 to that.
      EXPECT_TRUE(isNear(entries[j].gradient, centralDifference(weight, x, 1e-7), 1e-6)) << x.transpose();
    }
  }
}

TEST(PartitionOfUnity, WeightsAndGradientsAreContinuousAcrossBorders) {
  // A line through faces, edges and corners of the lattice and across zero. Bounds per step of length h: the quintic
  // smoothstep's slope is at most 15/8 / (2 margin), that of the slope 10/sqrt(3) / (2 margin)^2, per axis.
  const Eigen::Vector3d direction = Eigen::Vector3d(1.0, 0.73, -0.41);
  const double h = 1e-5;
  const double slope = 1.875 / (2.0 * kMargin);
  const double bend = 5.774 / (4.0 * kMargin * kMargin) + 2.0 * slope * slope;
  std::map<LatticeKey, BlendWeight> before;
  for (double t = -0.3; t < 0.3; t += h) {
    BlendWeight entries[8];
    const int count = blendWeights(t * direction, kCells, entries);
    std::map<LatticeKey, BlendWeight> now;
    for (int j = 0; j < count; ++j) now[entries[j].key] = entries[j];
    if (!before.empty()) {
      for (const auto& [key, entry] : now) {
        const auto found = before.find(key);
        const double weight = found == before.end() ? 0.0 : found->second.weight;
        const Eigen::Vector3d gradient =
            found == before.end() ? Eigen::Vector3d(Eigen::Vector3d::Zero()) : found->second.gradient;
        ASSERT_NEAR(entry.weight, weight, 3.0 * slope * h) << "at t = " << t;
        ASSERT_TRUE(isNear(entry.gradient, gradient, 3.0 * bend * h)) << "at t = " << t;
      }
      for (const auto& [key, entry] : before) {
        if (now.count(key) == 0) {
          ASSERT_LT(entry.weight, 3.0 * slope * h) << "a cell left with weight, t = " << t;
        }
      }
    }
    before = now;
  }
}

TEST(PartitionOfUnity, IsInvariantToShiftsByWholeCells) {
  std::mt19937 rng(4);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector3d x = randomVector(&rng, 0.0, 0.1);
    const auto here = weightsAt(x);
    const auto there = weightsAt(x - Eigen::Vector3d(7.0, 3.0, 11.0) * kSize);
    for (const auto& [key, weight] : here) {
      const auto found = there.find(key.offset(-7, -3, -11));
      // A weight that rounding takes over the band's end is as small as the rounding.
      EXPECT_NEAR(found == there.end() ? 0.0 : found->second, weight, 1e-12);
    }
  }
}

}  // namespace
}  // namespace gpis_mapping
