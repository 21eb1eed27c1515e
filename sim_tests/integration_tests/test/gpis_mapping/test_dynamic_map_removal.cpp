// SPDX-License-Identifier: BSD-3-Clause
// Algorithm 1: what is seen past goes in that very update, what is hidden stays, what is seen again gets better.
#include <algorithm>

#include <gtest/gtest.h>

#include "support/map_on_scene.h"

namespace synthetic_depth {
namespace test {
namespace {

constexpr int kNear = 0;
constexpr int kFar = 1;
constexpr int kFrontFrame = 4;    // the near box hides the middle of the far one
constexpr int kRemovalFrame = 5;  // the same look without the near box

/// Two boxes in line. Four looks from the sides see both whole; then two from the front.
Scene twoBoxes() {
  Scene scene = makeLooks(
      {{0.9, 1.1, 0.8}, {-1.1, 1.1, 0.8}, {0.9, -1.1, 0.8}, {-1.1, -1.1, 0.8}, {1.5, 0.0, 0.5}, {1.5, 0.0, 0.5}},
      {0.0, 0.0, 0.1});
  scene.boxes = {makeBox(kNear, {0.35, 0.0, 0.15}, {0.08, 0.15, 0.15}, {0.0, 0.0, 0.2}),
                 makeBox(kFar, {-0.25, 0.1, 0.2}, {0.1, 0.2, 0.2}, {0.0, 0.0, -0.3})};
  scene.boxes[0].vanishes_at_frame = kRemovalFrame;
  return scene;
}

/// Depth along z of the true surface under every pixel within `radius_px` is at least `gap_m` nearer than the point.
bool isWellHidden(const cv::Mat& depth_m, const Pixel& pixel, int radius_px, double gap_m) {
  for (int dv = -radius_px; dv <= radius_px; ++dv) {
    for (int du = -radius_px; du <= radius_px; ++du) {
      if (!(depth_m.at<float>(pixel.row() + dv, pixel.column() + du) < pixel.z_m - gap_m)) return false;
    }
  }
  return true;
}

TEST(DynamicMapRemoval, DeletesEveryPointOfARemovedBoxInTheUpdateThatSeesPastIt) {
  for (const bool has_noise : {false, true}) {
    Scene scene = twoBoxes();
    if (has_noise) addAxialNoise(&scene);
    GpisMap map(mapConfig(scene));
    feedFrames(&map, scene, 0, kFrontFrame);
    // The foot of a face is the foot of the ground too: within 3 cm (the map's tolerance and its reach round an edge)
    // of what remains, a point may belong to either.
    const SceneDistance remains(scene, kRemovalFrame);
    const auto isOnRemovedBox = [&](const SurfacePoint& point) {
      return std::abs(boxDistance(scene, scene.boxes[0], point.position_map)) < 0.02 &&
             distanceAt(remains, point.position_map) > 0.03;
    };
    const std::vector<SurfacePoint> before = pointsOf(map);
    const auto num_before = std::count_if(before.begin(), before.end(), isOnRemovedBox);
    // 0.3 x 0.16 m top and 0.27 m of four sides: 0.30 m^2 with discs of 2 cm packed
    // at random (coverage 0.547: 1740 per m^2) are 520; less the lowest 3 cm, which is a tenth. A few frames leave gaps.
    ASSERT_GT(num_before, 350);
    const UpdateStatistics statistics = feedFrames(&map, scene, kRemovalFrame, kRemovalFrame);
    const std::vector<SurfacePoint> after = pointsOf(map);
    EXPECT_EQ(std::count_if(after.begin(), after.end(), isOnRemovedBox), 0) << "noise " << has_noise;
    EXPECT_GE(statistics.deleted, static_cast<std::size_t>(num_before));
    EXPECT_EQ(statistics.deleted, statistics.removed_points_map.size());
  }
}

TEST(DynamicMapRemoval, DropoutsOfSinglePixelsSpareNothing) {
  Scene scene = twoBoxes();
  addAxialNoise(&scene);
  scene.sensor.dropout_probability = 0.005;
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 0, kFrontFrame);
  const SceneDistance remains(scene, kRemovalFrame);
  const auto isOnRemovedBox = [&](const SurfacePoint& point) {
    return std::abs(boxDistance(scene, scene.boxes[0], point.position_map)) < 0.02 &&
           distanceAt(remains, point.position_map) > 0.03;
  };
  const std::vector<SurfacePoint> before = pointsOf(map);
  const auto num_before = std::count_if(before.begin(), before.end(), isOnRemovedBox);
  ASSERT_GT(num_before, 350);
  feedFrames(&map, scene, kRemovalFrame, kRemovalFrame);
  const std::vector<SurfacePoint> after = pointsOf(map);
  // A dropout that may hide a depth edge (within 2 px of the far box's outline) spares what is within 3 px of it: of
  // an image's 0.5 %, those along an outline of a few hundred pixels spare a point or two.
  EXPECT_LE(std::count_if(after.begin(), after.end(), isOnRemovedBox), num_before / 100);
}

TEST(DynamicMapRemoval, ShadowsDropoutsAndFlyingPixelsKeepNoPieceOfABrick) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    Scene scene = loadScene(std::string(SYNTHETIC_DEPTH_SCENES) + "/fig8.yaml");  // every effect of a stereo camera
    scene.seed = seed;
    GpisMap map{gpis_mapping::GpisConfig{}};
    feedFrames(&map, scene, 0, 0);
    const auto removed =
        std::find_if(scene.boxes.begin(), scene.boxes.end(), [](const Box& box) { return box.vanishes_at_frame == 1; });
    ASSERT_NE(removed, scene.boxes.end());
    const SceneDistance remains(scene, 1);
    const auto isOnRemovedBox = [&](const SurfacePoint& point) {
      return std::abs(boxDistance(scene, *removed, point.position_map)) < 0.02 &&
             distanceAt(remains, point.position_map) > 0.03;
    };
    const std::vector<SurfacePoint> before = pointsOf(map);
    ASSERT_GT(std::count_if(before.begin(), before.end(), isOnRemovedBox), 80);
    feedFrames(&map, scene, 1, 1);
    const std::vector<SurfacePoint> after = pointsOf(map);
    // A point or two whose few neighbours are gone already have nobody to share a fate with.
    EXPECT_LE(std::count_if(after.begin(), after.end(), isOnRemovedBox), 1) << "seed " << seed;
  }
}

TEST(DynamicMapRemoval, LeavesOccludedPointsUntouchedBitForBit) {
  Scene scene = twoBoxes();
  addAxialNoise(&scene);
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 0, kFrontFrame - 1);
  const std::vector<SurfacePoint> before = pointsOf(map);
  const UpdateStatistics statistics = feedFrames(&map, scene, kFrontFrame, kFrontFrame);
  const std::vector<SurfacePoint> after = pointsOf(map);
  const cv::Mat depth_m = renderDepth(scene, kFrontFrame);
  std::size_t num_hidden = 0;
  std::size_t num_on_far_box = 0;
  for (const SurfacePoint& point : before) {
    // Away from silhouettes: 5 px is more than the 2 px over which the tolerance widens at a depth edge. 6 cm is
    // beyond 3 sigma at 1.8 m (5.4 mm) and the floor of the tolerance at any slope (1.2 cm / 0.5).
    const Pixel pixel = project(scene, kFrontFrame, point.position_map, 5.0);
    if (!pixel.inside || !isWellHidden(depth_m, pixel, 5, 0.06)) continue;
    ++num_hidden;
    num_on_far_box += std::abs(boxDistance(scene, scene.boxes[1], point.position_map)) < 0.02;
    EXPECT_TRUE(holds(after, point)) << point.position_map.transpose();
  }
  // The near box hides a window of about 0.35 x 0.4 m of the far one: 300 points at one per 4 cm^2 and more behind.
  EXPECT_GT(num_on_far_box, 100u);
  // Counted where the image around shows one surface: not within a 12 px window of an edge, a third of the near box.
  EXPECT_GT(statistics.occluded, num_hidden / 3);
}

TEST(DynamicMapRemoval, KeepsWhatWasHiddenAndDeletesWhatHidItOnceTheNearBoxIsGone) {
  const Scene scene = twoBoxes();
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 0, kFrontFrame);
  const auto countFar = [&] {
    const std::vector<SurfacePoint> points = pointsOf(map);
    return std::count_if(points.begin(), points.end(), [&](const SurfacePoint& point) {
      return std::abs(boxDistance(scene, scene.boxes[1], point.position_map)) < 0.02;
    });
  };
  const auto before = countFar();
  feedFrames(&map, scene, kRemovalFrame, kRemovalFrame);
  // Without noise nothing of a box that did not move may go; new points may fill gaps.
  EXPECT_GE(countFar(), before);
}

TEST(DynamicMapRemoval, FusedPointsMoveTowardsTheTruthAndTheirVarianceFalls) {
  // Looks from all around the front, so that edges are seen from several sides.
  Scene scene = makeLooks({{1.2, 0.3, 0.8},
                           {1.2, 0.25, 0.8},
                           {1.2, 0.35, 0.8},
                           {1.15, 0.3, 0.8},
                           {1.25, 0.3, 0.85},
                           {1.2, 0.2, 0.8},
                           {1.2, 0.4, 0.75},
                           {1.2, 0.3, 0.9}},
                          {0.0, 0.0, 0.1});
  scene.boxes = {makeBox(0, {0.0, 0.0, 0.15}, {0.15, 0.2, 0.15}, {0.0, 0.0, 0.4})};
  addAxialNoise(&scene);
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 0, 0);
  const std::vector<SurfacePoint> first = pointsOf(map);
  const UpdateStatistics statistics = feedFrames(&map, scene, 1, scene.numFrames() - 1);
  EXPECT_GT(statistics.fused, first.size() / 2);
  const std::vector<SurfacePoint> last = pointsOf(map);

  // A fused point moves along its normal only, by a few standard deviations (3 mm at 1.4 m): far less than half the
  // spacing to its neighbours, so the nearest one with the same normal is it.
  std::vector<SurfacePoint> moved_from;
  std::vector<SurfacePoint> moved_to;
  for (const SurfacePoint& point : first) {
    const SurfacePoint* nearest = nullptr;
    double best2 = 0.008 * 0.008;
    for (const SurfacePoint& other : last) {
      const double distance2 = (other.position_map - point.position_map).squaredNorm();
      if (distance2 < best2 && other.normal_map.dot(point.normal_map) > 0.8f && other.num_looks > 4) {
        best2 = distance2;
        nearest = &other;
      }
    }
    if (nearest == nullptr) continue;
    moved_from.push_back(point);
    moved_to.push_back(*nearest);
    EXPECT_LE(nearest->variance_m2, point.variance_m2);
  }
  ASSERT_GT(moved_to.size(), first.size() / 2);
  double variance_first = 0.0;
  double variance_last = 0.0;
  for (std::size_t i = 0; i < moved_to.size(); ++i) {
    variance_first += moved_from[i].variance_m2;
    variance_last += moved_to[i].variance_m2;
  }
  // Five to eight looks fused: 1/5 of the variance, but for the floor of (1 mm)^2 against (2 to 3 mm)^2 at the first.
  EXPECT_LT(variance_last, 0.4 * variance_first);
  const Errors error_first = pointErrors(moved_from, scene, 0);
  const Errors error_last = pointErrors(moved_to, scene, 0);
  // Noise falls by sqrt(5); what does not fall is the rounding of edges. Two thirds leaves room for it.
  EXPECT_LT(error_last.rms(), 0.67 * error_first.rms())
      << error_first.rms() << " m at the first look, " << error_last.rms() << " m at the last";
  std::size_t num_better = 0;
  const SceneDistance truth(scene, 0);
  for (std::size_t i = 0; i < moved_to.size(); ++i) {
    num_better +=
        std::abs(distanceAt(truth, moved_to[i].position_map)) < std::abs(distanceAt(truth, moved_from[i].position_map));
  }
  // With sigma falling to sigma/sqrt(6), P(|last| < |first|) = 2/pi atan(sqrt 6) = 0.75 for independent errors.
  EXPECT_GT(static_cast<double>(num_better), 0.6 * static_cast<double>(moved_to.size()));
}

/// Three boxes on the ground seen from all around; the middle one is taken away.
Scene threeBoxes() {
  OrbitConfig orbit;
  orbit.radius_m = 1.2;
  orbit.height_m = 0.9;
  orbit.look_at_m = {0.0, 0.0, 0.1};
  orbit.frames = 8;
  Scene scene = makeLooks({}, Eigen::Vector3d::Zero());
  scene.T_scene_camera = orbitPoses(orbit);
  scene.T_scene_camera.push_back(lookAt({0.9, -0.5, 1.0}, {0.0, 0.0, 0.1}));
  scene.boxes = {makeBox(0, {0.0, 0.0, 0.1}, {0.1, 0.1, 0.1}, {0.0, 0.0, 0.3}),
                 makeBox(1, {0.02, 0.35, 0.08}, {0.15, 0.07, 0.08}, {0.0, 0.0, 0.1}),
                 makeBox(2, {0.0, -0.36, 0.06}, {0.1, 0.1, 0.06}, {0.0, 0.0, -0.2})};
  scene.boxes[0].vanishes_at_frame = 8;
  addAxialNoise(&scene);
  return scene;
}

TEST(DynamicMapRemoval, RemovedObjectIsGoneFromMeshAndQueriesInTheSameUpdate) {
  const Scene scene = threeBoxes();
  const Box& removed = scene.boxes[0];
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 0, 7);
  const Eigen::Vector3d center = scene.T_map_scene * removed.T_scene_box.translation();
  ASSERT_LT(ask(*map.snapshot(), center).distance, -0.05);
  ASSERT_EQ(ask(*map.snapshot(), center).state, SpaceState::kOccupied);
  feedFrames(&map, scene, 8, 8);
  const SceneDistance truth(scene, 8);

  // The centre is 10 cm above what is left, the ground or its unmapped rest under the box. The nearest known surface
  // may be beside the footprint: between 10 cm and that to its rim, 0.1 m * sqrt(2) = 14 cm, plus 1 cm of noise.
  const Answer at_center = ask(*map.snapshot(), center);
  EXPECT_GT(at_center.distance, 0.09);
  EXPECT_LT(at_center.distance, 0.16);
  EXPECT_EQ(at_center.state, SpaceState::kFree);

  // Outside everything wherever the box was, from 3 cm above the ground (tolerance of the deletion, 12 mm, along a
  // ray at 45 degrees, twice). Known to be free from 10 cm up: a block of 5 cm whose centre is up to 4.3 cm lower is
  // seen through when a square of 9 px round it, 4.5 cm at 1.4 m, is seen past by 3 cm; at 45 degrees from 5.3 cm up.
  std::size_t num_asked = 0;
  const Eigen::Matrix3Xd inside = randomPointsInMap(scene, 5, 2000, {-0.14, -0.14, 0.03}, {0.14, 0.14, 0.2});
  for (Eigen::Index i = 0; i < inside.cols(); ++i) {
    if (boxDistance(scene, removed, inside.col(i)) > 0.0) continue;
    ++num_asked;
    const Eigen::Vector3d p_scene = scene.T_map_scene.inverse() * inside.col(i);
    const Answer answer = ask(*map.snapshot(), inside.col(i));
    EXPECT_GT(answer.distance, 0.0) << "at " << p_scene.transpose();
    EXPECT_NE(answer.state, SpaceState::kOccupied) << "at " << p_scene.transpose();
    if (p_scene.z() > 0.1) {
      EXPECT_EQ(answer.state, SpaceState::kFree) << "at " << p_scene.transpose();
    }
  }
  EXPECT_GT(num_asked, 500u);

  const TriangleMesh mesh = meshOf(*map.snapshot());
  std::size_t num_ghost = 0;
  for (const Eigen::Vector3d& p : mesh.vertices_map) {
    // 2 cm: ten standard deviations at 1.3 m and what marching cubes round off.
    num_ghost += boxDistance(scene, removed, p) < 0.02 && distanceAt(truth, p) > 0.02;
  }
  EXPECT_EQ(num_ghost, 0u);
}

TEST(DynamicMapRemoval, NothingElseIsForgottenWhenAnObjectIsTakenAway) {
  const Scene scene = threeBoxes();
  const Box& removed = scene.boxes[0];
  GpisMap map(mapConfig(scene));
  feedFrames(&map, scene, 0, 7);
  const auto isElsewhere = [&](const Eigen::Vector3d& p) { return boxDistance(scene, removed, p) > 0.06; };
  const std::shared_ptr<const MapSnapshot> old_snapshot = map.snapshot();
  const auto countElsewhere = [&] {
    const std::vector<SurfacePoint> points = pointsOf(map);
    return std::count_if(points.begin(), points.end(),
                         [&](const SurfacePoint& p) { return isElsewhere(p.position_map); });
  };
  const auto before = countElsewhere();
  const UpdateStatistics statistics = feedFrames(&map, scene, 8, 8);
  // Five sides of 0.2 x 0.2 m: 0.2 m^2 of discs of 2 cm packed at random (coverage 0.547: 1740 per m^2) are 350 points;
  // the lowest of them may pass for the ground.
  EXPECT_GT(statistics.deleted, 200u);
  // 0.2 %: a noisy point at a silhouette may go, a piece of surface may not.
  std::size_t num_deleted_elsewhere = 0;
  for (const Eigen::Vector3d& p : statistics.removed_points_map) num_deleted_elsewhere += isElsewhere(p);
  EXPECT_LE(static_cast<double>(num_deleted_elsewhere), 0.002 * static_cast<double>(before));
  EXPECT_GE(static_cast<double>(countElsewhere()), 0.998 * static_cast<double>(before));

  // The surface elsewhere: old vertices still have distance 0.
  const TriangleMesh old_mesh = meshOf(*old_snapshot);
  std::vector<Eigen::Vector3d> kept;
  for (const Eigen::Vector3d& p : old_mesh.vertices_map) {
    if (isElsewhere(p)) kept.push_back(p);
  }
  ASSERT_GT(kept.size(), 5000u);
  const QueryResult answers = map.snapshot()->query(asMatrix(kept));
  const Errors shift(answers.distance);
  EXPECT_EQ(shift.numNan(), 0u);
  // One more look at 2.5 mm noise against eight fused shifts a point by 1 mm at most on average.
  EXPECT_LT(shift.rms(), 0.001);
  // Where the last look puts a new point on an edge, its rounding (spacing 2 cm) changes by some millimetres.
  EXPECT_LT(shift.shareAbove(0.005), 0.005);
  const TriangleMesh new_mesh = meshOf(*map.snapshot());
  // The voxel's edge is 14 mm: no old vertex elsewhere is farther than that from a new one.
  EXPECT_LT(distanceToMesh(asMatrix(kept), new_mesh, 0.03).shareAbove(0.0143), 0.001);
}

TEST(DynamicMapRemoval, KeepsTheGhostWhenTheDynamicTreatmentIsOff) {
  const Scene scene = threeBoxes();
  GpisConfig config = mapConfig(scene);
  config.dynamic.enabled = false;
  GpisMap map(config);
  feedFrames(&map, scene, 0, 7);
  const auto countGhost = [&] {
    const std::vector<SurfacePoint> points = pointsOf(map);
    return std::count_if(points.begin(), points.end(), [&](const SurfacePoint& point) {
      return std::abs(boxDistance(scene, scene.boxes[0], point.position_map)) < 0.02;
    });
  };
  const auto before = countGhost();
  const UpdateStatistics statistics = feedFrames(&map, scene, 8, 8);
  EXPECT_EQ(statistics.deleted, 0u);
  EXPECT_GE(countGhost(), before);
  const Eigen::Vector3d top = scene.T_map_scene * Eigen::Vector3d(0.0, 0.0, 0.2);
  EXPECT_NEAR(ask(*map.snapshot(), top).distance, 0.0, 0.01);  // the top face is still there
}

/// A box hangs before nothing and is gone at frame 3; `beside`, if true, another stays.
Scene hangingBox(bool beside) {
  Scene scene = loadSmallScene("box_before_empty_background");
  scene.T_scene_camera.assign(4, scene.T_scene_camera.front());
  scene.boxes[0].vanishes_at_frame = 3;
  if (beside) scene.boxes.push_back(makeBox(7, {0.0, 0.3, 0.5}, {0.1, 0.1, 0.1}));
  return scene;
}

TEST(DynamicMapRemoval, ObjectBeforeAnEmptyBackgroundDisappearsInOneFrame) {
  for (const bool is_16_bit : {false, true}) {
    for (const bool beside : {false, true}) {
      const Scene scene = hangingBox(beside);
      GpisMap map(mapConfig(scene));  // default hole policy
      ASSERT_EQ(map.config().sensor.hole_policy, gpis_mapping::HolePolicy::kAuto);
      const auto see = [&](int frame) {
        const cv::Mat depth_m = measureDepth(scene, frame);
        return feed(&map, scene, frame, is_16_bit ? toDepthImage16(depth_m) : toDepthImage(depth_m));
      };
      const auto countOn = [&](const Box& box) {
        const std::vector<SurfacePoint> points = pointsOf(map);
        return std::count_if(points.begin(), points.end(), [&](const SurfacePoint& point) {
          return std::abs(boxDistance(scene, box, point.position_map)) < 0.02;
        });
      };
      for (int frame = 0; frame < 3; ++frame) see(frame);
      const std::string which = std::string(is_16_bit ? "16 bit" : "float") + (beside ? ", one stays" : ", alone");
      const auto num_before = countOn(scene.boxes[0]);
      ASSERT_GT(num_before, 50) << which;
      const auto num_beside = beside ? countOn(scene.boxes[1]) : 0;
      see(3);
      EXPECT_EQ(countOn(scene.boxes[0]), 0) << which;
      if (beside) {
        // Noise may take one point of the silhouette; 2 % of some hundred.
        EXPECT_GE(static_cast<double>(countOn(scene.boxes[1])), 0.98 * static_cast<double>(num_beside)) << which;
      } else {
        EXPECT_EQ(map.snapshot()->numPoints(), 0u) << which;
        EXPECT_TRUE(meshOf(*map.snapshot()).triangles.empty()) << which;
      }
      const Eigen::Vector3d center = scene.T_map_scene * Eigen::Vector3d(0.0, 0.0, 0.5);
      const Answer answer = ask(*map.snapshot(), center);
      EXPECT_EQ(answer.state, SpaceState::kFree) << which;
      EXPECT_TRUE(std::isnan(answer.distance) || answer.distance > 0.05) << which << ": " << answer.distance;
    }
  }
}

TEST(DynamicMapRemoval, AStrayBeforeAFaceIsNotConfirmedByTheFaceForEver) {
  // What a mixed pixel leaves: 12 to 15 mm over the top of a box, less than the tolerance of a face seen at its angle.
  // Looks from round about, then one standpoint's.
  constexpr int kFirst = 12;
  constexpr int kLooks = 8;
  OrbitConfig orbit;
  orbit.radius_m = 1.3;
  orbit.height_m = 1.3;
  orbit.look_at_m = {0.0, 0.0, 0.1};
  orbit.frames = kFirst;
  Scene scene = makeLooks({}, Eigen::Vector3d::Zero());
  scene.T_scene_camera = orbitPoses(orbit);
  scene.T_scene_camera.insert(scene.T_scene_camera.end(), kLooks, scene.T_scene_camera.front());
  scene.boxes = {makeBox(0, {0.0, 0.0, 0.1}, {0.15, 0.1, 0.1}, {0.0, 0.0, 0.3})};
  addAxialNoise(&scene);
  GpisMap before(mapConfig(scene));
  feedFrames(&before, scene, 0, kFirst - 1);
  const Eigen::Isometry3d T_map_box = scene.T_map_scene * scene.boxes[0].T_scene_box;
  const auto isStray = [&](const SurfacePoint& point) {
    const Eigen::Vector3d p_box = T_map_box.inverse() * point.position_map;
    return p_box.z() > 0.1 + 0.008 && (p_box.head<2>().cwiseAbs().array() < 0.13).all();
  };
  gpis_mapping::MapContents contents = before.contents();
  ASSERT_EQ(std::count_if(contents.points.begin(), contents.points.end(), isStray), 0);
  constexpr int kStrays = 12;
  for (int k = 0; k < kStrays; ++k) {
    const double azimuth_rad = 2.0 * M_PI * k / kStrays;
    SurfacePoint stray;
    stray.position_map = T_map_box * Eigen::Vector3d(0.1 * std::cos(azimuth_rad), 0.06 * std::sin(azimuth_rad),
                                                     0.1 + 0.012 + 0.001 * (k % 4));
    const Eigen::Vector3d normal_box(std::cos(azimuth_rad), std::sin(azimuth_rad), 0.25);
    stray.normal_map = (T_map_box.linear() * normal_box).normalized().cast<float>();
    stray.variance_m2 = 1e-6F;
    stray.normal_variance = 4e-4F;
    stray.last_seen_s = contents.points.front().last_seen_s;
    stray.num_looks = 20;
    contents.points.push_back(stray);
  }
  GpisMap map(contents);
  feedFrames(&map, scene, kFirst, kFirst + kLooks - 1);
  const std::vector<SurfacePoint> after = pointsOf(map);
  EXPECT_EQ(std::count_if(after.begin(), after.end(), isStray), 0);
  EXPECT_GT(after.size(), contents.points.size() * 9 / 10) << "the faces' own points stay";
}

}  // namespace
}  // namespace test
}  // namespace synthetic_depth
