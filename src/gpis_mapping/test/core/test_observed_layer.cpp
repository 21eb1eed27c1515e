// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/observed_layer.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "depth_frames.h"

namespace gpis_mapping {
namespace {

using gpis_mapping_test::makeFrame;

constexpr double kBlock = 0.05;  // m
constexpr double kMaxRange = 3.0;

/// Exact depth [m] at any bearing (theta_u, theta_v), infinite for none.
using DepthFunction = std::function<double(const Eigen::Vector3d& ray)>;

/// A wall at 2.2 m, tilted, with a box face at 1.2 m before part of it.
double sceneDepth(const Eigen::Vector3d& ray) {
  if (ray.x() > -0.1 && ray.x() < 0.25 && ray.y() > -0.05 && ray.y() < 0.2) return 1.2;
  return 2.2 / (1.0 + 0.3 * ray.x());
}

Eigen::Isometry3d somePose() {
  Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
  T_map_camera.linear() = (Eigen::AngleAxisd(-1.9, Eigen::Vector3d(1.0, 0.2, 0.1).normalized())).toRotationMatrix();
  T_map_camera.translation() << 0.33, -1.21, 0.87;
  return T_map_camera;
}

std::shared_ptr<ClassifiedFrame> render(const CameraModel& camera, const DepthFunction& depth) {
  return makeFrame(camera, [&](int u, int v) { return depth(camera.ray(u, v)); });
}

/// Calls fn with the centre of every block within `reach` of the camera.
void forBlocks(const Eigen::Isometry3d& T_map_camera, double reach,
               const std::function<void(const Eigen::Vector3d&)>& fn) {
  const LatticeKey low = LatticeKey::of(T_map_camera.translation() - Eigen::Vector3d::Constant(reach), kBlock);
  const LatticeKey high = LatticeKey::of(T_map_camera.translation() + Eigen::Vector3d::Constant(reach), kBlock);
  for (LatticeKey key = low; key.x <= high.x; ++key.x) {
    for (key.y = low.y; key.y <= high.y; ++key.y) {
      for (key.z = low.z; key.z <= high.z; ++key.z) fn(key.center(kBlock));
    }
  }
}

/// Clearance of a map point by the exact depth: metres along its ray to what is seen there, negative behind it or out of
/// view by more than `border_px`.
double clearance(const CameraModel& camera, const Eigen::Isometry3d& T_camera_map, const DepthFunction& depth,
                 const Eigen::Vector3d& p_map, double border_px) {
  const Eigen::Vector3d p = T_camera_map * p_map;
  if (p.z() <= 0.0) return -1.0;
  const Eigen::Vector3d ray = p / p.z();
  const double u = camera.fx * ray.x() + camera.cx;
  const double v = camera.fy * ray.y() + camera.cy;
  if (u < border_px || v < border_px || u > camera.width - 1 - border_px || v > camera.height - 1 - border_px)
    return -1.0;
  return (depth(ray) - p.z()) * ray.norm();
}

struct Check {
  int marked{0};
  int wrong_core{0};    // marked, with a sample of the inscribed ball that is not free
  int wrong_corner{0};  // marked, with a sample anywhere in the block that is not free
  double worst_corner{0.0};
  int clear{0};  // free by a wide margin
  int clear_marked{0};
};

Check checkAgainstBruteForce(const CameraModel& camera, const DepthFunction& depth) {
  const Eigen::Isometry3d T_map_camera = somePose();
  const Eigen::Isometry3d T_camera_map = T_map_camera.inverse();
  ObservedLayer layer(kBlock);
  layer.observe(*render(camera, depth), camera, T_map_camera, kMaxRange, 7.0f, 1);
  Check check;
  forBlocks(T_map_camera, kMaxRange + 0.2, [&](const Eigen::Vector3d& center) {
    const bool is_free = layer.isFree(center);
    check.marked += is_free;
    if (is_free) {
      EXPECT_EQ(layer.lastFree(center), 7.0f);
      EXPECT_LE((T_camera_map * center).norm(), kMaxRange);
    }
    double core = 1e9;
    double corner = 1e9;
    double wide = 1e9;
    for (int i = 0; i < 125; ++i) {
      const Eigen::Vector3d offset = Eigen::Vector3d(i % 5 - 2, i / 5 % 5 - 2, i / 25 - 2) * (0.25 * kBlock);
      const double clear = clearance(camera, T_camera_map, depth, center + offset, 0.0);
      corner = std::min(corner, clear);
      if (offset.norm() <= 0.5 * kBlock) core = std::min(core, clear);
      // Three times the block and 8 px: what a pyramid of 4, 8, ... pixel squares may add.
      wide = std::min(wide, clearance(camera, T_camera_map, depth, center + 3.0 * offset, 8.0));
      if (!is_free && wide <= 0.0) break;  // neither claimed nor required to be free
    }
    if (is_free && core < 0.0) ++check.wrong_core;
    if (is_free && corner < 0.0) {
      ++check.wrong_corner;
      check.worst_corner = std::min(check.worst_corner, std::max(-1.0, corner));
    }
    if (wide > 0.0 && (T_camera_map * center).norm() < kMaxRange) {
      ++check.clear;
      check.clear_marked += is_free;
    }
  });
  return check;
}

TEST(ObservedLayer, MarksOnlyWhatIsFreeByBruteForceAndMostOfIt) {
  const CameraModel camera{160, 120, 140.0, 140.0, 79.5, 59.5};
  const Check check = checkAgainstBruteForce(camera, sceneDepth);
  EXPECT_GT(check.marked, 5000);
  EXPECT_EQ(check.wrong_core, 0);
  // A block counts as the ball of 0.6 blocks round its centre (its corners stick out to 0.87): corners of blocks beside a
  // surface or the frustum's border may be unseen.
  EXPECT_LT(check.wrong_corner, 0.1 * check.marked);
  EXPECT_GT(check.clear, 3000);
  EXPECT_GT(check.clear_marked, 0.98 * check.clear);
}

TEST(ObservedLayer, HoldsForNonSquarePixels) {
  // A lens whose vertical focal length is half as long again: footprints are ellipses.
  const CameraModel camera{160, 160, 110.0, 220.0, 79.5, 79.5};
  const Check check = checkAgainstBruteForce(camera, sceneDepth);
  EXPECT_GT(check.marked, 2000);
  EXPECT_EQ(check.wrong_core, 0);
  EXPECT_GT(check.clear_marked, 0.98 * check.clear);
}

TEST(ObservedLayer, AThinPoleKeepsItsBlocksFromBeingFree) {
  // 3 px wide at 1 m before a wall: no block on the pole or in its shadow is free.
  const CameraModel camera{160, 120, 140.0, 140.0, 79.5, 59.5};
  const DepthFunction depth = [](const Eigen::Vector3d& ray) { return std::abs(ray.x()) < 0.0107 ? 1.0 : 2.2; };
  const Check check = checkAgainstBruteForce(camera, depth);
  EXPECT_GT(check.marked, 2000);
  EXPECT_EQ(check.wrong_core, 0);
}

TEST(ObservedLayer, PixelsWithoutInformationAndAmbiguousHolesAreNoEvidence) {
  const CameraModel camera{160, 120, 140.0, 140.0, 79.5, 59.5};
  const Eigen::Isometry3d identity = Eigen::Isometry3d::Identity();
  const Eigen::Vector3d p(0.02, 0.02, 1.02);  // seen near the image centre
  for (const PixelKind kind : {PixelKind::kSurface, PixelKind::kWall, PixelKind::kHole, PixelKind::kNoInformation}) {
    const auto frame = makeFrame(camera, [](int, int) { return 2.0; });
    // A patch in the block's footprint (7 px wide there): however it lies on the 4 x 4 pixel grid, four of its pixels
    // share a square, more than count as speckle.
    for (int v = 61; v <= 63; ++v) {
      for (int u = 82; u <= 84; ++u) frame->kind[frame->index(u, v)] = kind;
    }
    ObservedLayer layer(kBlock);
    layer.observe(*frame, camera, identity, kMaxRange, 1.0f, 1);
    EXPECT_EQ(layer.isFree(p), kind == PixelKind::kSurface || kind == PixelKind::kWall) << static_cast<int>(kind);
    EXPECT_TRUE(layer.isFree({-0.32, 0.02, 1.02}));  // far from that patch
  }
}

TEST(ObservedLayer, AnExplainedGapIsClearUpToItsNearerSide) {
  const CameraModel camera{160, 120, 140.0, 140.0, 79.5, 59.5};
  const auto frame = makeFrame(camera, [](int, int) { return 2.0; });
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 76; u < 90; ++u) {
      frame->kind[frame->index(u, v)] = PixelKind::kHole;
      frame->clear_to[frame->index(u, v)] = 1.0f / 1.5f;
    }
  }
  ObservedLayer layer(kBlock);
  layer.observe(*frame, camera, Eigen::Isometry3d::Identity(), kMaxRange, 1.0f, 1);
  EXPECT_TRUE(layer.isFree({0.02, 0.02, 1.37}));
  EXPECT_FALSE(layer.isFree({0.02, 0.02, 1.62}));
}

TEST(ObservedLayer, ADropoutOrTwoAmongSixteenPixelsIsSpeckle) {
  const CameraModel camera{160, 120, 140.0, 140.0, 79.5, 59.5};
  const auto frame = makeFrame(camera, [](int, int) { return 2.0; });
  for (const int u : {81, 83}) frame->kind[frame->index(u, 62)] = PixelKind::kNoInformation;
  ObservedLayer layer(kBlock);
  layer.observe(*frame, camera, Eigen::Isometry3d::Identity(), kMaxRange, 1.0f, 1);
  EXPECT_TRUE(layer.isFree({0.02, 0.02, 1.02}));
}

TEST(ObservedLayer, WallIsSeenThroughUpToTheMaximumRange) {
  const CameraModel camera{160, 120, 140.0, 140.0, 79.5, 59.5};
  const auto frame = makeFrame(camera, [](int, int) { return 100.0; });
  std::fill(frame->kind.begin(), frame->kind.end(), PixelKind::kWall);
  ObservedLayer layer(kBlock);
  layer.observe(*frame, camera, Eigen::Isometry3d::Identity(), kMaxRange, 1.0f, 1);
  EXPECT_TRUE(layer.isFree({0.01, 0.01, 2.9}));
  EXPECT_FALSE(layer.isFree({0.01, 0.01, 3.1}));
  EXPECT_FALSE(layer.isFree({0.01, 0.01, -0.5}));  // behind the camera
}

TEST(ObservedLayer, ALaterLookRenewsTheStampAndDoesNotForget) {
  const CameraModel camera{160, 120, 140.0, 140.0, 79.5, 59.5};
  const Eigen::Isometry3d pose = somePose();
  ObservedLayer layer(kBlock);
  layer.observe(*render(camera, [](const Eigen::Vector3d&) { return 2.5; }), camera, pose, kMaxRange, 1.0f, 1);
  layer.observe(*render(camera, [](const Eigen::Vector3d&) { return 1.5; }), camera, pose, kMaxRange, 2.0f, 1);
  EXPECT_EQ(layer.lastFree(pose * Eigen::Vector3d(0.0, 0.0, 1.0)), 2.0f);
  EXPECT_EQ(layer.lastFree(pose * Eigen::Vector3d(0.0, 0.0, 2.0)), 1.0f);
  EXPECT_EQ(layer.lastFree(pose * Eigen::Vector3d(0.0, 0.0, 2.8)), ObservedLayer::kNever);
}

TEST(ObservedLayer, DoesNotDependOnTheNumberOfThreads) {
  const CameraModel camera{160, 120, 140.0, 140.0, 79.5, 59.5};
  ObservedLayer one(kBlock);
  ObservedLayer three(kBlock);
  one.observe(*render(camera, sceneDepth), camera, somePose(), kMaxRange, 1.0f, 1);
  three.observe(*render(camera, sceneDepth), camera, somePose(), kMaxRange, 1.0f, 3);
  ASSERT_EQ(one.numChunks(), three.numChunks());
  for (const auto& [key, chunk] : one.chunks()) EXPECT_EQ(*chunk, *three.chunk(key));
}

TEST(ObservedLayer, OccupyForgetsOneBlock) {
  // All eight octants, blocks at chunk borders included: block -1 and block 0 are neighbours in different chunks.
  for (const double x : {-0.801, -0.799, -0.001, 0.001, 0.799, 0.801}) {
    for (const double y : {-0.001, 0.001}) {
      for (const double z : {-1.601, -0.001, 0.001}) {
        const Eigen::Vector3d p(x, y, z);
        ObservedLayer layer(kBlock);
        ObservedLayer::Chunk all;
        all.fill(3.0f);
        const LatticeKey chunk = LatticeKey::of(p, kBlock * ObservedLayer::kChunkBlocks);
        for (int i = 0; i < 27; ++i) layer.setChunk(chunk.offset(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1), all);
        ASSERT_EQ(layer.lastFree(p), 3.0f);
        layer.occupy(p);
        const LatticeKey own = LatticeKey::of(p, kBlock);
        for (int i = 0; i < 27; ++i) {
          const LatticeKey block = own.offset(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1);
          EXPECT_EQ(layer.isFree(block.center(kBlock)), block != own) << p.transpose();
        }
      }
    }
  }
}

TEST(ObservedLayer, UnseenSpaceIsNeverFreeAndOccupyingItDoesNothing) {
  ObservedLayer layer(kBlock);
  EXPECT_FALSE(layer.isFree({0.1, -0.2, 0.3}));
  EXPECT_EQ(layer.lastFree({0.1, -0.2, 0.3}), ObservedLayer::kNever);
  layer.occupy({0.1, -0.2, 0.3});
  EXPECT_EQ(layer.numChunks(), 0U);
}

TEST(ObservedLayer, SharedCopyDoesNotSeeLaterWrites) {
  const CameraModel camera{160, 120, 140.0, 140.0, 79.5, 59.5};
  const Eigen::Isometry3d pose = somePose();
  const auto frame = render(camera, [](const Eigen::Vector3d&) { return 2.0; });
  ObservedLayer layer(kBlock);
  layer.observe(*frame, camera, pose, kMaxRange, 1.0f, 1);
  const Eigen::Vector3d p = pose * Eigen::Vector3d(0.0, 0.0, 1.0);
  const Eigen::Vector3d q = pose * Eigen::Vector3d(0.1, 0.1, 1.2);
  ASSERT_TRUE(layer.isFree(p));
  const ObservedLayer first = layer.share();
  for (const auto& [key, chunk] : first.chunks()) EXPECT_EQ(chunk.get(), layer.chunk(key)) << "copied at once";

  layer.occupy(p);
  EXPECT_FALSE(layer.isFree(p));
  EXPECT_TRUE(first.isFree(p));
  const ObservedLayer second = layer.share();
  layer.observe(*frame, camera, pose, kMaxRange, 2.0f, 1);
  EXPECT_EQ(first.lastFree(q), 1.0f);
  EXPECT_EQ(first.lastFree(p), 1.0f);
  EXPECT_EQ(second.lastFree(q), 1.0f);
  EXPECT_FALSE(second.isFree(p));
  EXPECT_EQ(layer.lastFree(q), 2.0f);
  EXPECT_EQ(layer.lastFree(p), 2.0f);
}

TEST(ObservedLayer, WritesToASharedCopyDoNotReachTheOriginal) {
  ObservedLayer layer(kBlock);
  ObservedLayer::Chunk all;
  all.fill(3.0f);
  layer.setChunk({}, all);
  ObservedLayer copy = layer.share();
  copy.occupy({0.1, 0.1, 0.1});
  EXPECT_FALSE(copy.isFree({0.1, 0.1, 0.1}));
  EXPECT_TRUE(layer.isFree({0.1, 0.1, 0.1}));
}

TEST(ObservedLayer, HoldsWhatATableOfBlocksWould) {
  std::mt19937 random(1);
  std::uniform_int_distribution<int> coordinate(-70, 70);  // blocks: several chunks and pages, on both sides of zero
  std::map<LatticeKey, float> oracle;
  ObservedLayer layer(kBlock);
  struct Copy {
    ObservedLayer layer;
    std::map<LatticeKey, float> oracle;
  };
  std::vector<Copy> copies;
  for (int i = 0; i < 4000; ++i) {
    const LatticeKey block{coordinate(random), coordinate(random), coordinate(random)};
    if (i % 3 != 2) {
      layer.setFree(block.center(kBlock), static_cast<float>(i));
      oracle[block] = static_cast<float>(i);
    } else if (!oracle.empty()) {
      const auto forgotten = std::next(oracle.begin(), static_cast<long>(random() % oracle.size()));
      layer.occupy(forgotten->first.center(kBlock));
      oracle.erase(forgotten);
    }
    if (i % 500 == 0) copies.push_back({layer.share(), oracle});
  }
  copies.push_back({layer, oracle});
  for (const Copy& copy : copies) {
    std::map<LatticeKey, float> found;
    std::size_t chunks = 0;
    for (const auto& [key, chunk] : copy.layer.chunks()) {
      ++chunks;
      for (std::size_t k = 0; k < chunk->size(); ++k) {
        constexpr int kSide = ObservedLayer::kChunkBlocks;
        const int in_chunk = static_cast<int>(k);
        const LatticeKey block{key.x * kSide + in_chunk % kSide, key.y * kSide + in_chunk / kSide % kSide,
                               key.z * kSide + in_chunk / (kSide * kSide)};
        EXPECT_EQ(copy.layer.lastFree(block.center(kBlock)), (*chunk)[k]);
        if ((*chunk)[k] != ObservedLayer::kNever) found[block] = (*chunk)[k];
      }
    }
    EXPECT_EQ(found, copy.oracle);
    EXPECT_EQ(chunks, copy.layer.numChunks());
  }
}

TEST(ObservedLayer, APlainCopyIsIndependentToo) {
  // MapContents holds a layer by value: copying it must not tie the two together.
  const CameraModel camera{160, 120, 140.0, 140.0, 79.5, 59.5};
  const Eigen::Isometry3d pose = somePose();
  const Eigen::Vector3d p = pose * Eigen::Vector3d(0.0, 0.0, 1.0);
  ObservedLayer layer(kBlock);
  layer.observe(*render(camera, [](const Eigen::Vector3d&) { return 2.0; }), camera, pose, kMaxRange, 1.0f, 1);
  ObservedLayer copy = layer;
  copy.occupy(p);
  EXPECT_TRUE(layer.isFree(p));
  EXPECT_FALSE(copy.isFree(p));
  ObservedLayer assigned(kBlock);
  assigned = layer;
  layer.occupy(p);
  EXPECT_TRUE(assigned.isFree(p));
}

}  // namespace
}  // namespace gpis_mapping
