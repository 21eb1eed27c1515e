// SPDX-License-Identifier: BSD-3-Clause
// Pixels without a depth: the robot's own body, shadows, too near, holes that may be anything.
#include <functional>

#include <gtest/gtest.h>

#include "support/map_on_scene.h"

namespace synthetic_depth {
namespace test {
namespace {

/// Points of the map that an image may not touch: the pixel they fall on, or one within a kernel length of the
/// 2.5D^-1 map, satisfies `is_silent`. Returns how many there are; fails for each that is not in `after` bit for bit.
std::size_t expectUntouched(const GpisMap& map, const std::vector<SurfacePoint>& before,
                            const std::vector<SurfacePoint>& after, const Scene& scene, int frame,
                            const DepthImage& image, const std::function<bool(float)>& is_silent) {
  const double kernel_px = map.config().frame_map.kernel_length_rad * scene.camera.fx_px;
  std::size_t count = 0;
  for (const SurfacePoint& point : before) {
    const Pixel pixel = project(scene, frame, point.position_map);
    if (!pixel.inside || !anyPixelNear(image, pixel, kernel_px, is_silent)) continue;
    ++count;
    EXPECT_TRUE(holds(after, point)) << "changed or gone at pixel " << pixel.u << ", " << pixel.v;
  }
  return count;
}

/// Fails for each point of `after` that is new (nothing of `before` within 5 mm, more than any fusion moves a point)
/// on a silent pixel.
void expectNothingNew(const GpisMap& map, const std::vector<SurfacePoint>& before,
                      const std::vector<SurfacePoint>& after, const Scene& scene, int frame, const DepthImage& image,
                      const std::function<bool(float)>& is_silent) {
  // One pixel less: a point lies where the smoothed image puts it, not exactly on the pixel it was made from.
  const double kernel_px = std::max(0.5, map.config().frame_map.kernel_length_rad * scene.camera.fx_px - 1.0);
  for (const SurfacePoint& point : after) {
    const Pixel pixel = project(scene, frame, point.position_map);
    if (!pixel.inside || holds(before, point) || !anyPixelNear(image, pixel, kernel_px, is_silent)) continue;
    const bool is_old = std::any_of(before.begin(), before.end(), [&](const SurfacePoint& old) {
      return (old.position_map - point.position_map).norm() < 0.005;
    });
    EXPECT_TRUE(is_old) << "new point at pixel " << pixel.u << ", " << pixel.v;
  }
}

bool isNaN(float z) {
  return std::isnan(z);
}
bool isZero(float z) {
  return z == 0.0f;
}

/// A box on the ground for five looks; from frame 5 on it is gone and another stands beside it.
Scene changingScene() {
  Scene scene =
      makeLooks({{1.1, 0.4, 0.8}, {1.1, 0.3, 0.8}, {1.1, -0.4, 0.8}, {1.1, 0.0, 0.9}, {1.1, 0.0, 0.8}, {1.1, 0.0, 0.8}},
                {0.0, 0.0, 0.1});
  scene.boxes = {makeBox(0, {0.0, 0.0, 0.1}, {0.1, 0.1, 0.1}, {0.0, 0.0, 0.3}),
                 makeBox(1, {0.0, 0.3, 0.1}, {0.1, 0.1, 0.1}, {0.0, 0.0, 0.3})};
  scene.boxes[0].vanishes_at_frame = 5;
  scene.boxes[1].appears_at_frame = 5;
  addAxialNoise(&scene);
  return scene;
}

TEST(DynamicMapInvalidPixels, MaskedRegionDeletesAndInsertsNothing) {
  const Scene scene = changingScene();
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 0, 4);
  const std::vector<SurfacePoint> before = pointsOf(map);
  // A slanted bar, as an arm would be, across the box that went and the one that came.
  cv::Mat depth_m = measureDepth(scene, 5);
  for (int v = 0; v < depth_m.rows; ++v) {
    for (int u = 0; u < depth_m.cols; ++u) {
      if (std::abs((v - 120) + 0.2 * (u - 160)) < 12.0) depth_m.at<float>(v, u) = kNaN;
    }
  }
  const DepthImage image = toDepthImage(depth_m);
  const Eigen::Vector3d masked_center = scene.T_map_scene * Eigen::Vector3d(0.0, 0.0, 0.1);
  const UpdateStatistics statistics = feed(&map, scene, 5, image);
  const std::vector<SurfacePoint> after = pointsOf(map);
  EXPECT_GT(expectUntouched(map, before, after, scene, 5, image, isNaN), 100u);
  expectNothingNew(map, before, after, scene, 5, image, isNaN);
  // The rest of the image does its work: the removed box's other parts go, the new one's appear.
  // A box has 150 points on the three sides in view (0.12 m^2 less what is hidden); a fifth is well above noise.
  EXPECT_GT(statistics.deleted, 30u);
  EXPECT_GT(statistics.inserted, 30u);
  // And the space behind the mask is not called free.
  EXPECT_EQ(ask(*map.snapshot(), masked_center).state, SpaceState::kOccupied);
}

TEST(DynamicMapInvalidPixels, AllMaskedImageChangesNothing) {
  const Scene scene = changingScene();
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 0, 4);
  const std::vector<SurfacePoint> before = pointsOf(map);
  const std::shared_ptr<const MapSnapshot> old = map.snapshot();
  const UpdateStatistics statistics = feed(&map, scene, 5, constantImage(scene, kNaN));
  EXPECT_EQ(statistics.inserted + statistics.fused + statistics.deleted, 0u);
  EXPECT_EQ(statistics.cells_retrained, 0u);
  EXPECT_TRUE(areIdentical(before, pointsOf(map)));
  const Eigen::Matrix3Xd points = randomPointsInMap(scene, 6, 500, {-0.6, -0.6, -0.1}, {1.0, 0.6, 0.8});
  EXPECT_TRUE(areBitwiseEqual(old->query(points), map.snapshot()->query(points)));
}

/// The shipped shadow scene: frames 0 and 1 from straight above without shadows before the box is there, frame 2 with
/// the box and the shadow that it throws on the ground.
Scene shadowScene(bool has_shadows) {
  Scene scene = loadSmallScene("shadow");
  scene.T_scene_camera.assign(3, scene.T_scene_camera.front());
  scene.sensor.has_shadows = has_shadows;
  scene.boxes[0].appears_at_frame = 2;
  return scene;
}

TEST(DynamicMapInvalidPixels, BaselineShadowDeletesAndInsertsNothing) {
  for (const bool is_16_bit : {false, true}) {
    const Scene scene = shadowScene(true);
    GpisMap map(mapConfig(scene));
    feedFrames(&map, scene, 0, 1);
    const std::vector<SurfacePoint> before = pointsOf(map);
    const cv::Mat depth_m = measureDepth(scene, 2);
    const DepthImage image = is_16_bit ? toDepthImage16(depth_m) : toDepthImage(depth_m);
    feed(&map, scene, 2, image);
    const std::vector<SurfacePoint> after = pointsOf(map);
    // 262.5 * 0.08 * (1/0.6 - 1/1.2) = 17.5 px wide and 87 px tall, at 1.2 m 8 x 40 cm of ground: 56 points when
    // discs of 2 cm are packed at random (1740 per m^2); half of them will do.
    const std::size_t num_shadowed = expectUntouched(map, before, after, scene, 2, image, is_16_bit ? isZero : isNaN);
    EXPECT_GT(num_shadowed, 28u) << "16 bit: " << is_16_bit;
    expectNothingNew(map, before, after, scene, 2, image, is_16_bit ? isZero : isNaN);
  }
}

TEST(DynamicMapInvalidPixels, TooNearDeletesNothing) {
  const Scene scene = changingScene();
  // -Inf by REP-117, and a driver that hands out the useless depth itself (0.25 m is the least that counts).
  for (const float too_near : {-kInfinity, 0.12f}) {
    GpisMap map(mapConfig(scene));
    feedFrames(&map, scene, 0, 4);
    const std::vector<SurfacePoint> before = pointsOf(map);
    feed(&map, scene, 5, constantImage(scene, too_near));
    EXPECT_TRUE(areIdentical(before, pointsOf(map))) << "all pixels " << too_near;
    // The lower half too near, the rest as it is: the rest works, the half stays.
    cv::Mat depth_m = measureDepth(scene, 5);
    depth_m.rowRange(120, 240).setTo(too_near);
    const DepthImage image = toDepthImage(depth_m);
    feed(&map, scene, 5, image);
    EXPECT_GT(
        expectUntouched(map, before, pointsOf(map), scene, 5, image, [too_near](float z) { return z == too_near; }),
        300u);
  }
}

/// A wall fills the view at 1 m; a hole of zeros is `width_px` x 60 px in its middle.
struct HoleLooks {
  Scene scene = makeLooks(std::vector<Eigen::Vector3d>(20, {1.0, 0.0, 1.0}), {0.0, 0.0, 1.0});
  GpisConfig config;
  int next_frame{0};

  HoleLooks() {
    scene.boxes = {makeBox(0, {-0.5, 0.0, 1.0}, {0.5, 1.5, 1.5})};
    config = mapConfig(scene);
  }
  UpdateStatistics see(GpisMap* map, int hole_width_px) {
    cv::Mat depth_m = measureDepth(scene, next_frame);
    if (hole_width_px > 0) depth_m(cv::Rect(160 - hole_width_px / 2, 90, hole_width_px, 60)).setTo(kNaN);
    return feed(map, scene, next_frame++, toDepthImage16(depth_m));
  }
};

TEST(DynamicMapInvalidPixels, HoleInASurfaceThatIsStillSeenDeletesNothing) {
  HoleLooks looks;
  GpisMap map(looks.config);
  looks.see(&map, 0);
  looks.see(&map, 0);
  for (const int width_px : {3, 13, 40, 150}) {
    for (int look = 0; look < 3; ++look) EXPECT_EQ(looks.see(&map, width_px).deleted, 0u) << width_px << " px";
  }
}

TEST(DynamicMapInvalidPixels, HoleAcrossTheWholeViewDeletesAtOnceWhatWasMeasuredFromThere) {
  HoleLooks looks;
  looks.scene.boxes = {makeBox(0, {-0.5, 0.0, 1.0}, {0.5, 0.1, 0.1})};  // alone before nothing
  looks.scene.has_ground = false;
  GpisMap map(looks.config);
  looks.see(&map, 0);
  EXPECT_GT(map.snapshot()->numPoints(), 50u);
  EXPECT_EQ(looks.see(&map, 6).deleted, 0u) << "a part is missing";
  looks.see(&map, 100);
  EXPECT_EQ(map.snapshot()->numPoints(), 0u) << "the whole is";
}

// Its pixels are a look past it from then on, which the pixels beside them must not take for their own surface.
TEST(DynamicMapInvalidPixels, WhatComesBesideAVanishedObjectIsWhereItIs) {
  HoleLooks looks;
  looks.scene.boxes = {makeBox(0, {-0.5, 0.3, 1.0}, {0.5, 0.3, 0.3}), makeBox(1, {-0.5, -0.3, 1.0}, {0.5, 0.3, 0.3})};
  looks.scene.boxes[0].vanishes_at_frame = 3;
  looks.scene.boxes[1].appears_at_frame = 3;
  looks.scene.has_ground = false;
  GpisMap map(looks.config);
  for (int look = 0; look < 3; ++look) looks.see(&map, 0);
  const UpdateStatistics statistics = looks.see(&map, 0);
  EXPECT_GT(statistics.deleted, 50u);
  EXPECT_GT(statistics.inserted, 50u);
  for (const SurfacePoint& point : pointsOf(map)) {
    const Eigen::Vector3d p = looks.scene.T_map_scene.inverse() * point.position_map;
    EXPECT_NEAR(p.x(), 0.0, 0.02) << p.transpose();
  }
}

TEST(DynamicMapInvalidPixels, HoleOfAVanishedObjectTellsNothingOfWhatIsOutOfReach) {
  Scene scene = makeLooks({{2.0, 0.0, 1.0}, {5.0, 0.0, 1.0}, {5.0, 0.0, 1.0}, {5.0, 0.0, 1.0}}, {0.0, 0.0, 1.0});
  scene.boxes = {makeBox(0, {-0.5, 0.0, 1.0}, {0.5, 1.0, 1.0}), makeBox(1, {3.0, 0.0, 1.0}, {0.1, 0.2, 0.2})};
  scene.boxes[1].appears_at_frame = 1;
  scene.boxes[1].vanishes_at_frame = 3;
  scene.has_ground = false;
  GpisMap map(mapConfig(scene));
  const auto see = [&](int frame) {  // the wall is 2 m away, then 5 m: beyond the sensor's 4 m
    cv::Mat depth_m = measureDepth(scene, frame);
    depth_m.setTo(kNaN, depth_m > 4.0);
    feed(&map, scene, frame, toDepthImage16(depth_m));
  };
  see(0);
  const std::size_t wall = map.snapshot()->numPoints();
  see(1);
  see(2);
  EXPECT_GT(map.snapshot()->numPoints(), wall + 50u);
  see(3);
  EXPECT_EQ(map.snapshot()->numPoints(), wall);
}

TEST(DynamicMapInvalidPixels, ImageWithoutAnyDepthAfterAFullOneDeletesNothing) {
  HoleLooks looks;
  GpisMap map(looks.config);
  looks.see(&map, 0);
  const std::vector<SurfacePoint> before = pointsOf(map);
  for (int look = 0; look < 3; ++look) feed(&map, looks.scene, looks.next_frame++, constantImage(looks.scene, 0.0f));
  EXPECT_TRUE(areIdentical(before, pointsOf(map)));
}

TEST(DynamicMapInvalidPixels, HoleOutsideTheStatedFieldOfViewIsNoEvidence) {
  HoleLooks looks;
  looks.scene.boxes = {makeBox(0, {-0.05, 0.5, 1.0}, {0.05, 0.08, 0.08})};  // 27 degrees to the side
  looks.scene.has_ground = false;
  for (const double width_rad : {0.0, 0.7}) {
    looks.config.sensor.fov_width_rad = width_rad;
    GpisMap map(looks.config);
    looks.see(&map, 0);
    const std::size_t before = map.snapshot()->numPoints();
    EXPECT_GT(before, 20u);
    feed(&map, looks.scene, looks.next_frame++, constantImage(looks.scene, 0.0f));
    EXPECT_EQ(map.snapshot()->numPoints(), width_rad == 0.0 ? 0u : before) << width_rad;
  }
}

TEST(DynamicMapInvalidPixels, HolePolicyDecidesWhatZerosMean) {
  for (const auto policy : {gpis_mapping::HolePolicy::kWall, gpis_mapping::HolePolicy::kNoInformation}) {
    HoleLooks looks;
    looks.config.sensor.hole_policy = policy;
    GpisMap map(looks.config);
    looks.see(&map, 0);
    const std::size_t deleted = looks.see(&map, 40).deleted;
    if (policy == gpis_mapping::HolePolicy::kWall) {
      EXPECT_GT(deleted, 50u);
    } else {
      EXPECT_EQ(deleted, 0u);
    }
  }
}

}  // namespace
}  // namespace test
}  // namespace synthetic_depth
