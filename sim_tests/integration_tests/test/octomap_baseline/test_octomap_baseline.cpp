// SPDX-License-Identifier: BSD-3-Clause
// The comparison map on the scenes: what is taken away goes at once, what stays does not wear off.
#include <gtest/gtest.h>

#include "octomap_baseline/dynamic_octomap.h"
#include "support/map_on_scene.h"

namespace synthetic_depth {
namespace test {
namespace {

using octomap_baseline::DynamicOctomap;
using octomap_baseline::ForgetPolicy;
using octomap_baseline::OctomapConfig;
using octomap_baseline::OctomapUpdateStatistics;

/// The map's defaults with the scene's sensor and one thread.
OctomapConfig octomapConfig(const Scene& scene) {
  OctomapConfig config;
  config.sensor = mapConfig(scene).sensor;
  config.sensor.max_range_m = 2.5;  // beyond every scene here: rays that are longer take time and tell nothing
  config.threads = 1;
  return config;
}

OctomapUpdateStatistics look(DynamicOctomap* map, const Scene& scene, int frame) {
  return map->update(toDepthImage(measureDepth(scene, frame)), mapCamera(scene), scene.cameraInMap(frame),
                     scene.stampSeconds(frame));
}

bool isOccupied(const octomap::OcTree& tree, const Eigen::Vector3d& p) {
  const octomap::OcTreeNode* node = tree.search(p.x(), p.y(), p.z());
  return node != nullptr && tree.isNodeOccupied(node);
}

/// Centres of all occupied voxels.
std::vector<Eigen::Vector3d> occupiedVoxels(const DynamicOctomap& map) {
  octomap::OcTree tree(map.tree());
  tree.expand();
  std::vector<Eigen::Vector3d> centers;
  for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) {
    if (tree.isNodeOccupied(*leaf)) centers.emplace_back(leaf.getX(), leaf.getY(), leaf.getZ());
  }
  return centers;
}

/// Occupied voxels within 3 cm of the box's surface, or in it.
std::size_t countOnBox(const DynamicOctomap& map, const Scene& scene, const Box& box) {
  std::size_t count = 0;
  for (const Eigen::Vector3d& p : occupiedVoxels(map)) count += boxDistance(scene, box, p) < 0.03;
  return count;
}

/// Share of the surface samples with an occupied voxel's centre within a voxel's edge.
double coveredShare(const DynamicOctomap& map, const Eigen::Matrix3Xd& samples_map) {
  const double edge = map.config().resolution_m;
  std::size_t covered = 0;
  for (Eigen::Index i = 0; i < samples_map.cols(); ++i) {
    bool found = false;
    for (int n = 0; n < 27 && !found; ++n) {
      const Eigen::Vector3d p = samples_map.col(i) + edge * Eigen::Vector3d(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1);
      const octomap::OcTreeKey key = map.tree().coordToKey(p.x(), p.y(), p.z());
      const octomap::point3d c = map.tree().keyToCoord(key);
      const Eigen::Vector3d center(c.x(), c.y(), c.z());
      found = (center - samples_map.col(i)).norm() <= edge && isOccupied(map.tree(), center);
    }
    covered += found;
  }
  return static_cast<double>(covered) / static_cast<double>(samples_map.cols());
}

TEST(OctomapBaseline, BoxBeforeEmptyBackgroundIsGoneInOneImage) {
  const Scene scene = loadSmallScene("box_before_empty_background");
  DynamicOctomap map(octomapConfig(scene));
  for (int frame = 0; frame < 10; ++frame) look(&map, scene, frame);
  const std::size_t before = countOnBox(map, scene, scene.boxes[0]);
  ASSERT_GT(before, 150u);  // three faces of 10 x 10 voxels, seen aslant
  look(&map, scene, 10);
  // Voxels at the silhouette are half beside it; the box's rim in the image is about a tenth of its face.
  EXPECT_LT(countOnBox(map, scene, scene.boxes[0]), before / 50);
  for (int frame = 11; frame < 20; ++frame) look(&map, scene, frame);
  EXPECT_EQ(countOnBox(map, scene, scene.boxes[0]), 0u);
}

TEST(OctomapBaseline, TextbookOddsKeepTheGhostForEightImages) {
  const Scene scene = loadSmallScene("box_before_empty_background");
  OctomapConfig config = octomapConfig(scene);
  config.dynamic.policy = ForgetPolicy::kOdds;
  config.occupancy = {0.7, 0.4, 0.12, 0.97, 0.5};
  DynamicOctomap map(config);
  for (int frame = 0; frame < 10; ++frame) look(&map, scene, frame);
  const std::size_t before = countOnBox(map, scene, scene.boxes[0]);
  for (int frame = 10; frame < 14; ++frame) look(&map, scene, frame);
  EXPECT_GT(countOnBox(map, scene, scene.boxes[0]), before / 2);
  for (int frame = 14; frame < 20; ++frame) look(&map, scene, frame);
  EXPECT_LT(countOnBox(map, scene, scene.boxes[0]), before / 50);
}

TEST(OctomapBaseline, TwentyNoisyLooksDoNotWearOffTheSurface) {
  const Scene scene = loadSmallScene("static_box_twenty_looks");
  const Eigen::Matrix3Xd samples = visibleSurfaceSamples(scene, 0, 0, 0.01).points_map;
  DynamicOctomap map(octomapConfig(scene));
  for (int frame = 0; frame < 5; ++frame) look(&map, scene, frame);
  const double early = coveredShare(map, samples);
  for (int frame = 5; frame < 20; ++frame) look(&map, scene, frame);
  const double late = coveredShare(map, samples);
  RecordProperty("early_percent", static_cast<int>(100.0 * early));
  EXPECT_GT(early, 0.98);  // silhouettes and shadows lose some
  EXPECT_GT(late, early - 0.005);
}

TEST(OctomapBaseline, FloorSeenAtGrazingAngleStays) {
  // 0.25 m over the floor: at 2 m the view is 7 degrees from grazing, where each ray skims several voxels of the floor.
  std::vector<Eigen::Vector3d> eyes;
  for (int i = 0; i < 20; ++i) eyes.emplace_back(-0.5 + 0.01 * i, 0.02 * (i % 5), 0.25);
  Scene scene = makeLooks(eyes, {1.2, 0.0, 0.0});
  scene.roi.min_m = Eigen::Vector3d(0.3, -0.4, -0.05);
  scene.roi.max_m = Eigen::Vector3d(1.5, 0.4, 0.1);
  addAxialNoise(&scene);
  const Eigen::Matrix3Xd samples = visibleSurfaceSamples(scene, 0, 0, 0.02).points_map;
  ASSERT_GT(samples.cols(), 1000);
  DynamicOctomap map(octomapConfig(scene));
  look(&map, scene, 0);
  const double first = coveredShare(map, samples);
  EXPECT_GT(first, 0.95);  // at 1.8 m two rays of 320 x 240 px are 4 cm apart on the floor: some voxels get none
  for (int frame = 1; frame < 20; ++frame) {
    look(&map, scene, frame);
    EXPECT_GT(coveredShare(map, samples), first) << "frame " << frame;
  }
  EXPECT_GT(coveredShare(map, samples), 0.99);
}

TEST(OctomapBaseline, SurfaceSeenFromAllAroundStays) {
  Scene scene = loadSmallScene("static_box_twenty_looks");
  OrbitConfig orbit;
  orbit.radius_m = 1.0;
  orbit.height_m = 0.6;
  orbit.look_at_m = Eigen::Vector3d(0.0, 0.0, 0.1);
  orbit.turns = 2.0;
  orbit.frames = 40;
  scene.T_scene_camera = orbitPoses(orbit);
  const Eigen::Matrix3Xd samples = visibleSurfaceSamples(scene, 0, 39, 0.02).points_map;
  DynamicOctomap map(octomapConfig(scene));
  for (int frame = 0; frame < 20; ++frame) look(&map, scene, frame);
  const double once = coveredShare(map, samples);
  for (int frame = 20; frame < 40; ++frame) look(&map, scene, frame);
  const double twice = coveredShare(map, samples);
  EXPECT_GT(once, 0.98);
  EXPECT_GT(twice, once - 0.005);
}

TEST(OctomapBaseline, BoxThatGetsHiddenStays) {
  Scene scene = loadSmallScene("two_boxes_occluding");
  scene.boxes[0].appears_at_frame = 3;
  scene.boxes[0].vanishes_at_frame = kNever;
  DynamicOctomap map(octomapConfig(scene));
  for (int frame = 0; frame < 3; ++frame) look(&map, scene, frame);
  const std::size_t seen = countOnBox(map, scene, scene.boxes[1]);
  ASSERT_GT(seen, 200u);
  for (int frame = 3; frame < 20; ++frame) look(&map, scene, frame);
  // The half that is still seen loses a few voxels to noise and edges; a hidden half lost would be 50 %.
  EXPECT_GT(countOnBox(map, scene, scene.boxes[1]), seen * 95 / 100);
}

}  // namespace
}  // namespace test
}  // namespace synthetic_depth
