// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline/dynamic_octomap.h"

#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <set>
#include <string>
#include <tuple>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

namespace octomap_baseline {
namespace {

using gpis_mapping::CameraModel;
using gpis_mapping::DepthImage;
using octomap::OcTreeKey;
using test_support::messageOf;
using ::testing::AllOf;
using testing::HasSubstr;

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();
const CameraModel kCamera{160, 120, 130.0, 130.0, 79.5, 59.5};

OctomapConfig testConfig() {
  OctomapConfig config;
  config.resolution_m = 0.03;
  config.sensor.max_range_m = 2.5;
  config.threads = 2;
  return config;
}

/// Off the voxel lattice, tilted, looking along the map's x.
Eigen::Isometry3d cameraPose() {
  Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
  T_map_camera.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  T_map_camera.rotate(Eigen::AngleAxisd(0.07, Eigen::Vector3d(0.3, 1.0, -0.2).normalized()));
  T_map_camera.translation() = Eigen::Vector3d(0.0137, -0.0213, 0.8171);
  return T_map_camera;
}

DepthImage constantImage(float depth_m) {
  return {kCamera.width, kCamera.height,
          std::vector<float>(static_cast<std::size_t>(kCamera.width) * kCamera.height, depth_m)};
}

void fillRectangle(DepthImage* image, int u0, int v0, int u1, int v1, float depth_m) {
  for (int v = v0; v < v1; ++v) {
    for (int u = u0; u < u1; ++u) image->depth_m[static_cast<std::size_t>(v) * image->width + u] = depth_m;
  }
}

/// A plate of 60 x 40 px at 1.2 m before `background` [m].
DepthImage plateBefore(float background) {
  DepthImage image = constantImage(background);
  fillRectangle(&image, 50, 40, 110, 80, 1.2f);
  return image;
}

Eigen::Vector3d pointAt(double u, double v, double depth_m) {
  return cameraPose() * (depth_m * Eigen::Vector3d((u - kCamera.cx) / kCamera.fx, (v - kCamera.cy) / kCamera.fy, 1.0));
}

octomap::point3d toOctomap(const Eigen::Vector3d& p) {
  return {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())};
}

using KeyTuple = std::tuple<int, int, int>;

/// Every voxel the tree knows, with its log odds.
std::map<KeyTuple, float> contentsOf(const octomap::OcTree& tree) {
  octomap::OcTree copy(tree);
  copy.expand();
  std::map<KeyTuple, float> voxels;
  for (auto leaf = copy.begin_leafs(); leaf != copy.end_leafs(); ++leaf) {
    const OcTreeKey key = leaf.getKey();
    voxels[{key[0], key[1], key[2]}] = leaf->getLogOdds();
  }
  return voxels;
}

std::size_t countOccupied(const octomap::OcTree& tree) {
  std::size_t count = 0;
  for (const auto& voxel : contentsOf(tree)) count += voxel.second >= tree.getOccupancyThresLog();
  return count;
}

bool isOccupiedAt(const octomap::OcTree& tree, const Eigen::Vector3d& p_map) {
  const octomap::OcTreeNode* node = tree.search(toOctomap(p_map));
  return node != nullptr && tree.isNodeOccupied(node);
}

bool isKnownAt(const octomap::OcTree& tree, const Eigen::Vector3d& p_map) {
  return tree.search(toOctomap(p_map)) != nullptr;
}

/// Share of the plate's pixels whose voxel is occupied.
double plateShare(const octomap::OcTree& tree) {
  int found = 0;
  int all = 0;
  for (int v = 42; v < 78; ++v) {
    for (int u = 52; u < 108; ++u, ++all) found += isOccupiedAt(tree, pointAt(u, v, 1.2));
  }
  return static_cast<double>(found) / all;
}

DepthImage randomImage(std::mt19937* random) {
  DepthImage image = constantImage(0.0f);
  std::uniform_real_distribution<float> depth(0.6f, 1.9f);
  for (int v = 0; v < image.height; v += 10) {
    for (int u = 0; u < image.width; u += 10) fillRectangle(&image, u, v, u + 10, v + 10, depth(*random));
  }
  return image;
}

TEST(DynamicOctomap, OddsPolicyEqualsOctoMapsOwnDiscreteInsertion) {
  OctomapConfig config = testConfig();
  config.dynamic.policy = ForgetPolicy::kOdds;
  config.occupancy.prob_miss = 0.4;
  DynamicOctomap map(config);
  octomap::OcTree oracle(config.resolution_m);
  oracle.setProbHit(0.7);
  oracle.setProbMiss(0.4);
  oracle.setClampingThresMin(0.12);
  oracle.setClampingThresMax(0.97);
  std::mt19937 random(1);
  for (int frame = 0; frame < 4; ++frame) {
    const DepthImage image = randomImage(&random);
    octomap::Pointcloud cloud;
    for (int v = 0; v < image.height; ++v) {
      for (int u = 0; u < image.width; ++u) cloud.push_back(toOctomap(pointAt(u, v, image.at(u, v))));
    }
    map.update(image, kCamera, cameraPose(), frame);
    oracle.insertPointCloud(cloud, toOctomap(cameraPose().translation()), -1.0, false, true);
    const auto ours = contentsOf(map.tree());
    const auto theirs = contentsOf(oracle);
    std::size_t different = 0;
    for (const auto& [key, log_odds] : theirs) {
      const auto found = ours.find(key);
      // Both add the same floats in the same order; a bit more than rounding of one addition.
      different += found == ours.end() || std::abs(found->second - log_odds) > 1e-5f;
    }
    ASSERT_GT(theirs.size(), 10000u);
    // Pixels on the border of two voxels: depth goes through its inverse here, so that one ulp may put them next door.
    EXPECT_LE(different, theirs.size() / 2000) << "frame " << frame;
    EXPECT_NEAR(static_cast<double>(ours.size()), static_cast<double>(theirs.size()), 1e-3 * theirs.size());
  }
}

TEST(DynamicOctomap, HitAndFreedVoxelsEqualDenselySampledRays) {
  // 20 x 16 px: left half a plate, right half nothing within reach, one column without information.
  const CameraModel camera{20, 16, 15.0, 15.0, 9.5, 7.5};
  DepthImage image{camera.width, camera.height, std::vector<float>(320, kInfinity)};
  fillRectangle(&image, 0, 0, 10, 16, 0.9f);
  fillRectangle(&image, 15, 0, 16, 16, kNaN);
  OctomapConfig config = testConfig();
  config.sensor.max_range_m = 1.3;
  DynamicOctomap map(config);
  map.update(image, camera, cameraPose(), 1.0);

  const octomap::OcTree& tree = map.tree();
  std::set<KeyTuple> hits;
  std::set<KeyTuple> ends;
  const auto keyOf = [&](const Eigen::Vector3d& p) {
    const OcTreeKey key = tree.coordToKey(toOctomap(p));
    return KeyTuple{key[0], key[1], key[2]};
  };
  const Eigen::Vector3d origin = cameraPose().translation();
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      if (u == 15) continue;
      const Eigen::Vector3d ray((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
      const double depth = u < 10 ? 0.9 : 2.0;
      const bool is_hit = depth * ray.norm() <= 1.3;
      // Two voxels farther than what can be hit.
      const KeyTuple key = keyOf(cameraPose() * (is_hit ? depth * ray : 1.36 * ray.normalized()));
      ends.insert(key);
      if (is_hit) hits.insert(key);
    }
  }
  ASSERT_GT(hits.size(), 100u);
  ASSERT_LT(hits.size(), ends.size());
  std::set<KeyTuple> passed;
  for (const KeyTuple& end : ends) {
    const auto [x, y, z] = end;
    const octomap::point3d center = tree.keyToCoord(OcTreeKey(x, y, z));
    const Eigen::Vector3d target(center.x(), center.y(), center.z());
    constexpr int kSamples = 20000;  // 0.06 mm apart: what is missed is a corner cut by less than that
    for (int i = 0; i < kSamples; ++i) {
      const KeyTuple key = keyOf(origin + (target - origin) * i / kSamples);
      if (key != end) passed.insert(key);
    }
  }
  std::size_t missing = 0;
  std::size_t extra = 0;
  const auto contents = contentsOf(tree);
  for (const auto& [key, log_odds] : contents) {
    if (log_odds > 0.0f) {
      EXPECT_EQ(hits.count(key), 1u);
    } else {
      extra += passed.count(key) == 0;
    }
  }
  for (const KeyTuple& key : hits) EXPECT_GT(contents.at(key), 0.0f);
  for (const KeyTuple& key : passed) missing += contents.count(key) == 0;
  // A ray through an edge of the lattice may take either side.
  EXPECT_LE(missing, passed.size() / 500);
  EXPECT_LE(extra, passed.size() / 500);
}

TEST(DynamicOctomap, VirtualWallClearsAVanishedPlateInOneImage) {
  DynamicOctomap map(testConfig());
  for (int i = 0; i < 10; ++i) map.update(plateBefore(kInfinity), kCamera, cameraPose(), i);
  ASSERT_GT(plateShare(map.tree()), 0.99);
  const OctomapUpdateStatistics gone = map.update(constantImage(kInfinity), kCamera, cameraPose(), 10.0);
  EXPECT_EQ(countOccupied(map.tree()), 0u);
  EXPECT_GT(gone.freed, 150u);  // the plate is 18 x 12 voxels
  EXPECT_EQ(gone.hit_voxels, 0u);
}

TEST(DynamicOctomap, FarBackgroundClearsLikeTheWall) {
  DynamicOctomap map(testConfig());
  for (int i = 0; i < 10; ++i) map.update(plateBefore(6.0f), kCamera, cameraPose(), i);
  ASSERT_GT(plateShare(map.tree()), 0.99);
  map.update(constantImage(6.0f), kCamera, cameraPose(), 10.0);  // measured, but beyond the maximum range
  EXPECT_EQ(countOccupied(map.tree()), 0u);
}

TEST(DynamicOctomap, OddsPolicyNeedsAsManyImagesAsTheLogOddsTell) {
  OctomapConfig config = testConfig();
  config.dynamic.policy = ForgetPolicy::kOdds;
  config.occupancy.prob_miss = 0.4;
  DynamicOctomap map(config);
  for (int i = 0; i < 10; ++i) map.update(plateBefore(kInfinity), kCamera, cameraPose(), i);
  // From logit(0.97) = 3.48 down by -logit(0.4) = 0.405 each: below 0 with the ninth.
  for (int i = 0; i < 8; ++i) map.update(constantImage(kInfinity), kCamera, cameraPose(), 10.0 + i);
  EXPECT_GT(plateShare(map.tree()), 0.99);
  map.update(constantImage(kInfinity), kCamera, cameraPose(), 18.0);
  EXPECT_EQ(countOccupied(map.tree()), 0u);
}

TEST(DynamicOctomap, WithoutVirtualWallEmptyBackgroundClearsNothing) {
  OctomapConfig config = testConfig();
  config.dynamic.virtual_wall = false;
  DynamicOctomap map(config);
  map.update(plateBefore(kInfinity), kCamera, cameraPose(), 0.0);
  const auto before = contentsOf(map.tree());
  for (int i = 1; i < 20; ++i) map.update(constantImage(kInfinity), kCamera, cameraPose(), i);
  EXPECT_EQ(contentsOf(map.tree()), before);
  // What is measured still clears.
  for (int i = 20; i < 22; ++i) map.update(constantImage(2.0f), kCamera, cameraPose(), i);
  EXPECT_EQ(plateShare(map.tree()), 0.0);
}

TEST(DynamicOctomap, NoInformationNeitherClearsNorInserts) {
  DynamicOctomap map(testConfig());
  map.update(plateBefore(2.0f), kCamera, cameraPose(), 0.0);
  const auto before = contentsOf(map.tree());
  for (const float value : {kNaN, -kInfinity, 0.1f, -1.0f}) {  // not measured, too close twice, against REP-117
    for (int i = 0; i < 10; ++i) map.update(constantImage(value), kCamera, cameraPose(), i);
    EXPECT_EQ(contentsOf(map.tree()), before) << value;
  }
}

TEST(DynamicOctomap, AmbiguousHoleWaitsForASecondLook) {
  // A hole of 10 px between equal depths: too wide for speckle, too narrow to be sure of the wall.
  DepthImage hole = constantImage(1.2f);
  fillRectangle(&hole, 70, 0, 80, kCamera.height, 0.0f);
  DynamicOctomap map(testConfig());
  for (int i = 0; i < 5; ++i) map.update(constantImage(1.2f), kCamera, cameraPose(), i);
  const Eigen::Vector3d p = pointAt(75, 60, 1.2);
  ASSERT_TRUE(isOccupiedAt(map.tree(), p));
  map.update(hole, kCamera, cameraPose(), 5.0);
  EXPECT_TRUE(isOccupiedAt(map.tree(), p));
  for (int i = 0; i < 10; ++i) map.update(hole, kCamera, cameraPose(), 6.0 + i);
  EXPECT_FALSE(isOccupiedAt(map.tree(), p));
}

TEST(DynamicOctomap, WhatIsHiddenStays) {
  DynamicOctomap map(testConfig());
  map.update(constantImage(1.8f), kCamera, cameraPose(), 0.0);
  for (int i = 1; i < 20; ++i) map.update(plateBefore(1.8f), kCamera, cameraPose(), i);
  for (int v = 45; v < 75; ++v) {
    for (int u = 55; u < 105; ++u) ASSERT_TRUE(isOccupiedAt(map.tree(), pointAt(u, v, 1.8))) << u << ' ' << v;
  }
}

TEST(DynamicOctomap, EdgeStaysWhenNoiseMovesItByAVoxel) {
  DynamicOctomap map(testConfig());
  for (int i = 0; i < 10; ++i) map.update(plateBefore(2.0f), kCamera, cameraPose(), i);
  // The plate a voxel farther and a pixel narrower: most pixels around the voxels of its edge see past them, but some do
  // not, within the tolerance.
  DepthImage image = constantImage(2.0f);
  fillRectangle(&image, 51, 41, 109, 79, 1.23f);
  // 9 at the corners, where both edges recede; 87 when pixels that end near the voxel do not count.
  EXPECT_LT(map.update(image, kCamera, cameraPose(), 10.0).freed, 20u);
  EXPECT_GT(plateShare(map.tree()), 0.95);
}

TEST(DynamicOctomap, FreedVoxelIsOccupiedAgainByOneHit) {
  DynamicOctomap map(testConfig());
  for (int i = 0; i < 10; ++i) map.update(plateBefore(kInfinity), kCamera, cameraPose(), i);
  map.update(constantImage(kInfinity), kCamera, cameraPose(), 10.0);
  ASSERT_EQ(plateShare(map.tree()), 0.0);
  map.update(plateBefore(kInfinity), kCamera, cameraPose(), 11.0);
  EXPECT_GT(plateShare(map.tree()), 0.99);
}

TEST(DynamicOctomap, StaticModeKeepsWhatWasOccupiedOnce) {
  for (const ForgetPolicy policy : {ForgetPolicy::kOdds, ForgetPolicy::kSeenThrough}) {
    OctomapConfig config = testConfig();
    config.dynamic.enabled = false;
    config.dynamic.policy = policy;
    DynamicOctomap map(config);
    map.update(plateBefore(kInfinity), kCamera, cameraPose(), 0.0);
    const std::size_t before = countOccupied(map.tree());
    for (int i = 1; i < 20; ++i) {
      EXPECT_EQ(map.update(constantImage(kInfinity), kCamera, cameraPose(), i).freed, 0u);
    }
    EXPECT_EQ(countOccupied(map.tree()), before);
    EXPECT_GT(plateShare(map.tree()), 0.99);
  }
}

TEST(DynamicOctomap, RegionLimitsHitsAndMisses) {
  OctomapConfig config = testConfig();
  config.region.min_m = Eigen::Vector3d(0.5, -10.0, -10.0);
  config.region.max_m = Eigen::Vector3d(1.6, 10.0, 10.0);
  DynamicOctomap map(config);
  map.update(plateBefore(2.0f), kCamera, cameraPose(), 0.0);
  const auto contents = contentsOf(map.tree());
  ASSERT_GT(contents.size(), 1000u);
  for (const auto& voxel : contents) {
    const double x = map.tree().keyToCoord(static_cast<octomap::key_type>(std::get<0>(voxel.first)));
    ASSERT_GT(x, 0.5);
    ASSERT_LT(x, 1.6);
  }
  EXPECT_GT(plateShare(map.tree()), 0.99);
}

TEST(DynamicOctomap, NumberOfThreadsChangesNothing) {
  std::map<KeyTuple, float> expected;
  for (const int threads : {1, 2, 5}) {
    OctomapConfig config = testConfig();
    config.threads = threads;
    DynamicOctomap map(config);
    std::mt19937 random(7);
    for (int i = 0; i < 4; ++i) map.update(randomImage(&random), kCamera, cameraPose(), i);
    if (threads == 1) expected = contentsOf(map.tree());
    EXPECT_EQ(contentsOf(map.tree()), expected) << threads;
  }
}

TEST(DynamicOctomap, RefusesBadInputAndStaysAsItWas) {
  DynamicOctomap map(testConfig());
  map.update(plateBefore(2.0f), kCamera, cameraPose(), 4.0);
  const auto before = contentsOf(map.tree());
  const DepthImage good = constantImage(kInfinity);
  const auto refusal = [&](const DepthImage& image, const CameraModel& camera, const Eigen::Isometry3d& pose,
                           double stamp_s) -> std::string {
    try {
      map.update(image, camera, pose, stamp_s);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "no exception";
  };
  DepthImage short_image = good;
  short_image.depth_m.pop_back();
  EXPECT_THAT(refusal(short_image, kCamera, cameraPose(), 5.0), HasSubstr("with 19199 values"));
  CameraModel camera = kCamera;
  camera.fx = -1.0;
  EXPECT_THAT(refusal(good, camera, cameraPose(), 5.0), HasSubstr("fx = -1 px, must be in"));
  camera = kCamera;
  camera.width = 80;
  EXPECT_THAT(refusal(good, camera, cameraPose(), 5.0), HasSubstr("the camera model says 80 x 120"));
  Eigen::Isometry3d pose = cameraPose();
  pose.linear() *= 1.1;
  EXPECT_THAT(refusal(good, kCamera, pose, 5.0), HasSubstr("no rigid motion"));
  pose = cameraPose();
  pose.linear().col(0) *= -1.0;
  EXPECT_THAT(refusal(good, kCamera, pose, 5.0), HasSubstr("no rigid motion"));
  pose = cameraPose();
  pose.translation().y() = kNaN;
  EXPECT_THAT(refusal(good, kCamera, pose, 5.0), HasSubstr("not finite"));
  EXPECT_THAT(refusal(good, kCamera, cameraPose(), kNaN), HasSubstr("not finite"));
  pose = cameraPose();
  pose.translation().z() = 985.0;
  EXPECT_THAT(refusal(good, kCamera, pose, 5.0), HasSubstr("must be within +-980.42 m"));
  EXPECT_EQ(contentsOf(map.tree()), before);
  EXPECT_EQ(map.stamp(), 4.0);
  EXPECT_EQ(map.numUpdates(), 1u);
  // Still usable.
  map.update(good, kCamera, cameraPose(), 5.0);
  EXPECT_EQ(plateShare(map.tree()), 0.0);
}

TEST(DynamicOctomap, CountsOccupiedVoxels) {
  DynamicOctomap map(testConfig());
  std::mt19937 random(5);
  for (int i = 0; i < 6; ++i) {
    const OctomapUpdateStatistics statistics = map.update(randomImage(&random), kCamera, cameraPose(), i);
    EXPECT_EQ(statistics.occupied, countOccupied(map.tree()));
    EXPECT_EQ(statistics.freed > 0, i > 0);
  }
  map.clearBox(pointAt(80, 60, 1.2) - Eigen::Vector3d(0.5, 0.3, 0.3), pointAt(80, 60, 1.2));
  EXPECT_EQ(map.numOccupied(), countOccupied(map.tree()));
  map.clear();
  EXPECT_EQ(map.numOccupied(), 0u);
}

TEST(DynamicOctomap, ClearForgetsEverything) {
  DynamicOctomap map(testConfig());
  map.update(plateBefore(2.0f), kCamera, cameraPose(), 4.0);
  map.clear();
  EXPECT_EQ(map.tree().size(), 0u);
  EXPECT_EQ(map.numUpdates(), 0u);
  map.update(plateBefore(2.0f), kCamera, cameraPose(), 1.0);
  EXPECT_GT(plateShare(map.tree()), 0.99);
}

TEST(DynamicOctomap, ClearBoxFreesKnownVoxelsInsideOnly) {
  DynamicOctomap map(testConfig());
  for (int i = 0; i < 10; ++i) map.update(plateBefore(2.0f), kCamera, cameraPose(), i);  // free space is pruned
  const auto before = contentsOf(map.tree());
  const Eigen::Vector3d low = pointAt(80, 60, 1.2) - Eigen::Vector3d(0.3, 0.1, 0.1);
  const Eigen::Vector3d high = pointAt(80, 60, 1.2) + Eigen::Vector3d(0.3, 0.1, 0.1);
  const std::size_t freed = map.clearBox(low, high);
  const auto after = contentsOf(map.tree());
  ASSERT_EQ(after.size(), before.size());
  std::size_t changed = 0;
  for (const auto& [key, log_odds] : before) {
    const auto [x, y, z] = key;
    const octomap::point3d center = map.tree().keyToCoord(OcTreeKey(x, y, z));
    const Eigen::Vector3d p(center.x(), center.y(), center.z());
    if ((p.array() >= low.array()).all() && (p.array() <= high.array()).all()) {
      EXPECT_EQ(after.at(key), map.tree().getClampingThresMinLog());
      changed += log_odds >= 0.0f;
    } else {
      EXPECT_EQ(after.at(key), log_odds);
    }
  }
  EXPECT_EQ(freed, changed);
  EXPECT_GT(freed, 30u);  // the plate is 6 x 6 voxels there
  EXPECT_FALSE(isOccupiedAt(map.tree(), pointAt(80, 60, 1.2)));
  EXPECT_TRUE(isOccupiedAt(map.tree(), pointAt(55, 60, 1.2)));
  EXPECT_FALSE(isKnownAt(map.tree(), pointAt(80, 60, 1.5)));  // behind the plate
  EXPECT_THROW(map.clearBox(high, low), std::invalid_argument);
  EXPECT_THROW(map.clearBox(Eigen::Vector3d(kNaN, 0, 0), high), std::invalid_argument);
}

TEST(DynamicOctomap, RefusesAnImpossibleConfiguration) {
  OctomapConfig config;
  config.resolution_m = 0.0;
  config.occupancy.prob_miss = 0.6;
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { DynamicOctomap map(config); }),
              AllOf(HasSubstr("resolution_m = 0 m, must be in [0.002, 1] m"),
                    HasSubstr("occupancy/prob_miss = 0.6, must be in [0.001, 0.499]")));
}

}  // namespace
}  // namespace octomap_baseline
