// SPDX-License-Identifier: BSD-3-Clause
// Poses that are off: what stands must stay, what is taken away must go.
#include <gtest/gtest.h>

#include "support/map_on_scene.h"

namespace synthetic_depth {
namespace test {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180.0;

/// A floor with two boxes before a wall, seen from one side to the other; box 1 is gone from `vanishes_at` on.
Scene corner(int num_frames, int vanishes_at) {
  std::vector<Eigen::Vector3d> eyes;
  for (int i = 0; i < num_frames; ++i) eyes.emplace_back(1.6, -0.2 + 0.4 * i / num_frames, 1.1);
  Scene scene = makeLooks(eyes, {0.0, 0.0, 0.2});
  scene.boxes = {makeBox(0, {-0.9, 0.0, 0.8}, {0.05, 2.0, 0.8}), makeBox(1, {0.1, 0.3, 0.15}, {0.15, 0.15, 0.15}),
                 makeBox(2, {0.1, -0.4, 0.2}, {0.15, 0.2, 0.2}, {0.0, 0.0, 0.4})};
  scene.boxes[1].vanishes_at_frame = vanishes_at;
  addAxialNoise(&scene);
  return scene;
}

UpdateStatistics feedOff(GpisMap* map, const Scene& scene, int frame, const Eigen::Isometry3d& off) {
  return map->update(toDepthImage(measureDepth(scene, frame)), mapCamera(scene), scene.cameraInMap(frame) * off,
                     scene.stampSeconds(frame));
}

/// 4 cm and 2 degrees: what a tracker is off for one image.
Eigen::Isometry3d slip(double share) {
  Eigen::Isometry3d off = Eigen::Isometry3d::Identity();
  off.rotate(Eigen::AngleAxisd(share * 2.0 * kDegree, Eigen::Vector3d(0.6, 0.8, 0.0)));
  off.translation() = share * Eigen::Vector3d(0.02, 0.01, 0.03);
  return off;
}

std::ptrdiff_t countOn(const GpisMap& map, const Scene& scene, const Box& box) {
  const std::vector<SurfacePoint> points = pointsOf(map);
  return std::count_if(points.begin(), points.end(), [&](const SurfacePoint& point) {
    const Eigen::Vector3d p = scene.T_map_scene.inverse() * point.position_map;
    return p.z() > 0.04 && std::abs(boxDistance(scene, box, point.position_map)) < 0.04;
  });
}

TEST(DynamicMapPoseError, OneDisplacedFrameDeletesNothing) {
  const Scene scene = corner(12, kNever);
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 0, 7);
  const std::size_t before = map.snapshot()->numPoints();
  const UpdateStatistics displaced = feedOff(&map, scene, 8, slip(1.0));
  // Silhouettes are several pixels off: what they see past there cannot be told from what has gone.
  EXPECT_LT(static_cast<double>(displaced.deleted), 0.03 * static_cast<double>(before)) << "of " << before;
  feedFrames(&map, scene, 9, 11);
  EXPECT_GT(static_cast<double>(map.snapshot()->numPoints()), 0.97 * static_cast<double>(before));
}

TEST(DynamicMapPoseError, ObjectTakenAwayVanishesFromADisplacedFrame) {
  const Scene scene = corner(12, 8);
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 0, 7);
  const auto taken = countOn(map, scene, scene.boxes[1]);
  const auto beside = countOn(map, scene, scene.boxes[2]);
  ASSERT_GT(taken, 100);
  feedOff(&map, scene, 8, slip(0.5));
  EXPECT_LT(static_cast<double>(countOn(map, scene, scene.boxes[1])), 0.05 * static_cast<double>(taken));
  EXPECT_GT(static_cast<double>(countOn(map, scene, scene.boxes[2])), 0.95 * static_cast<double>(beside));
}

TEST(DynamicMapPoseError, DisplacementThatLastsIsBelieved) {
  const Scene scene = corner(40, kNever);
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 0, 7);
  Eigen::Isometry3d off = Eigen::Isometry3d::Identity();
  off.translation().z() = -0.08;  // localisation corrected itself: everything lies nearer by that
  for (int frame = 8; frame < 40; ++frame) feedOff(&map, scene, frame, off);
  // The wall, as the last frame sees it, is where that frame puts it.
  const DepthImage image = toDepthImage(renderDepth(scene, 39));
  const std::vector<SurfacePoint> points = pointsOf(map);
  std::size_t count = 0, close = 0;
  for (const SurfacePoint& point : points) {
    if (point.last_seen_s < scene.stampSeconds(38) - scene.stampSeconds(0)) continue;
    const Eigen::Vector3d p = (scene.cameraInMap(39) * off).inverse() * point.position_map;
    const int u = static_cast<int>(std::lround(scene.camera.fx_px * p.x() / p.z() + scene.camera.cx_px));
    const int v = static_cast<int>(std::lround(scene.camera.fy_px * p.y() / p.z() + scene.camera.cy_px));
    if (u < 4 || v < 4 || u > 315 || v > 235) continue;
    ++count;
    close += std::abs(image.at(u, v) - p.z()) < 0.02;
  }
  EXPECT_GT(count, 1000u);
  EXPECT_GT(static_cast<double>(close), 0.9 * static_cast<double>(count));
}

}  // namespace
}  // namespace test
}  // namespace synthetic_depth
