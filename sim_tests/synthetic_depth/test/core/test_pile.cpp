// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/pile.h"

#include <algorithm>
#include <stdexcept>

#include <gtest/gtest.h>

#include "synthetic_depth/testing/random_scene.h"

namespace synthetic_depth {
namespace {

PileConfig smallPile(std::uint64_t seed) {
  PileConfig config;
  config.seed = seed;
  config.extent_m = 1.2;
  config.height_m = 0.45;
  config.max_bricks = 25;
  config.remove_topmost = 3;
  config.remove_at_frame = 7;
  return config;
}

bool contains(const Box& box, const Eigen::Vector3d& p) {
  return ((box.T_scene_box.inverse(Eigen::Isometry) * p).cwiseAbs().array() <= box.half_extents_m.array()).all();
}

double topOf(const Box& box) {
  return box.T_scene_box.translation().z() + box.half_extents_m.z();
}

/// Grid over a box, in the scene frame, drawn in by `inset` on each side.
std::vector<Eigen::Vector3d> grid(const Box& box, int n, double inset) {
  std::vector<Eigen::Vector3d> points;
  const Eigen::Vector3d half = box.half_extents_m.array() - inset;
  for (int i = 0; i <= n; ++i) {
    for (int j = 0; j <= n; ++j) {
      for (int k = 0; k <= n; ++k) {
        const Eigen::Vector3d share(2.0 * i / n - 1.0, 2.0 * j / n - 1.0, 2.0 * k / n - 1.0);
        points.emplace_back(box.T_scene_box * half.cwiseProduct(share));
      }
    }
  }
  return points;
}

TEST(Pile, BricksDoNotInterpenetrateEachOtherOrTheGround) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const std::vector<Box> boxes = makePile(smallPile(seed));
    for (const Box& box : boxes) {
      for (const Eigen::Vector3d& p : grid(box, 12, 1e-6)) {
        EXPECT_GT(p.z(), 0.0);
        for (const Box& other : boxes) {
          ASSERT_TRUE(other.id == box.id || !contains(other, p)) << "boxes " << box.id << " and " << other.id;
        }
      }
    }
  }
}

TEST(Pile, EveryBrickRestsOnGroundOrBricksOverHalfItsBaseAndBothSidesOfItsCentre) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const std::vector<Box> boxes = makePile(smallPile(seed));
    int num_stacked = 0;
    for (const Box& box : boxes) {
      const double bottom = box.T_scene_box.translation().z() - box.half_extents_m.z();
      if (bottom < 1e-6) {
        EXPECT_NEAR(bottom, 0.0, 1e-9);
        continue;
      }
      ++num_stacked;
      constexpr int kN = 80;
      int num_supported = 0;
      Eigen::AlignedBox2d supported;  // in the box's own axes
      for (int i = 0; i < kN; ++i) {
        for (int j = 0; j < kN; ++j) {
          const Eigen::Vector3d q(box.half_extents_m.x() * (2.0 * (i + 0.5) / kN - 1.0),
                                  box.half_extents_m.y() * (2.0 * (j + 0.5) / kN - 1.0),
                                  -box.half_extents_m.z() - 1e-6);
          const Eigen::Vector3d p = box.T_scene_box * q;
          if (std::any_of(boxes.begin(), boxes.end(), [&](const Box& below) { return contains(below, p); })) {
            ++num_supported;
            supported.extend(Eigen::Vector2d(q.head<2>()));
          }
        }
      }
      EXPECT_GE(num_supported / static_cast<double>(kN * kN), 0.48) << "box " << box.id;  // 0.5 less the grid's error
      EXPECT_TRUE(supported.contains(Eigen::Vector2d::Zero())) << "box " << box.id;
    }
    EXPECT_GT(num_stacked, 5);
  }
}

TEST(Pile, RemovesTheTopmostBricksAndNothingThatCarriesAnother) {
  const std::vector<Box> boxes = makePile(smallPile(2));
  double lowest_removed = 1e9;
  double highest_kept = 0.0;
  int num_removed = 0;
  for (const Box& box : boxes) {
    if (box.vanishes_at_frame == 7) {
      ++num_removed;
      lowest_removed = std::min(lowest_removed, topOf(box));
    } else {
      EXPECT_EQ(box.vanishes_at_frame, kNever);
      highest_kept = std::max(highest_kept, topOf(box));
    }
  }
  EXPECT_EQ(num_removed, 3);
  EXPECT_GE(lowest_removed, highest_kept - 1e-6);
}

TEST(Pile, StaysWithinItsEnvelope) {
  const PileConfig config = smallPile(3);
  for (const Box& box : makePile(config)) {
    EXPECT_LE(topOf(box), config.height_m + 1e-9);
    for (const Eigen::Vector3d& p : grid(box, 1, 0.0)) {
      EXPECT_LE(p.head<2>().norm(), 0.5 * config.extent_m + 1e-9);
    }
  }
}

TEST(Pile, IsFixedByItsSeed) {
  const std::vector<Box> first = makePile(smallPile(4));
  const std::vector<Box> again = makePile(smallPile(4));
  const std::vector<Box> other = makePile(smallPile(5));
  ASSERT_EQ(first.size(), again.size());
  for (std::size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(first[i].T_scene_box.matrix(), again[i].T_scene_box.matrix());
  }
  EXPECT_NE(first[0].T_scene_box.matrix(), other[0].T_scene_box.matrix());
}

TEST(Pile, RefusesABadConfig) {
  PileConfig config = smallPile(1);
  config.brick_size_m.z() = -0.1;
  EXPECT_THROW(makePile(config), std::invalid_argument);
}

}  // namespace
}  // namespace synthetic_depth
