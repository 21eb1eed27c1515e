// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/scene_distance.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "synthetic_depth/scene_loader.h"
#include "synthetic_depth/testing/random_scene.h"

namespace synthetic_depth {
namespace {

using test::makeBox;
using test::makeRandomScene;
using test::makeScene;
using test::randomPoint;

/// Positive outside the box, negative inside; only the sign and the order of size matter here.
double largestExcess(const Box& box, const Eigen::Vector3d& p_scene) {
  return ((box.T_scene_box.inverse(Eigen::Isometry) * p_scene).cwiseAbs() - box.half_extents_m).maxCoeff();
}

bool isSolid(const Scene& scene, const Eigen::Vector3d& p_scene) {
  return (scene.has_ground && p_scene.z() <= 0.0) ||
         std::any_of(scene.boxes.begin(), scene.boxes.end(),
                     [&](const Box& box) { return largestExcess(box, p_scene) <= 0.0; });
}

/// One face, by its centre and half axes.
struct Face {
  Eigen::Vector3d center, half_u, half_v, normal;

  Eigen::Vector3d at(const Eigen::Vector2d& uv) const { return center + uv.x() * half_u + uv.y() * half_v; }
};

struct Sample {
  Eigen::Vector3d p;
  const Face* face;
  Eigen::Vector2d uv;  // in [-1, 1]
};

/// Distance to the surface of the union by search: dense points on all faces, those kept that have air 1 um in front of
/// them, then a finer and finer search around the nearest. Shares nothing with the library but the meaning of a box.
class BruteForceSurface {
 public:
  explicit BruteForceSurface(const Scene& scene) : scene_(scene) {
    for (const Box& box : scene.boxes) {
      const Eigen::Matrix3d scaled = box.T_scene_box.linear() * box.half_extents_m.asDiagonal();
      for (int axis = 0; axis < 3; ++axis) {
        for (const double sign : {-1.0, 1.0}) {
          faces_.push_back({box.T_scene_box.translation() + sign * scaled.col(axis), scaled.col((axis + 1) % 3),
                            scaled.col((axis + 2) % 3), sign * box.T_scene_box.linear().col(axis)});
        }
      }
    }
    if (scene.has_ground) {
      faces_.push_back({{0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}});
    }
    for (const Face& face : faces_) {
      const int num_u = static_cast<int>(std::ceil(2.0 * face.half_u.norm() / kSpacing_m));
      const int num_v = static_cast<int>(std::ceil(2.0 * face.half_v.norm() / kSpacing_m));
      for (int i = 0; i <= num_u; ++i) {
        for (int j = 0; j <= num_v; ++j) {
          const Eigen::Vector2d uv(2.0 * i / num_u - 1.0, 2.0 * j / num_v - 1.0);
          if (isAir(face, uv)) {
            samples_.push_back({face.at(uv), &face, uv});
          }
        }
      }
    }
  }

  double distance(const Eigen::Vector3d& p) const {
    constexpr std::size_t kNumStarts = 12;
    std::vector<std::pair<double, const Sample*>> nearest;
    for (const Sample& sample : samples_) {
      nearest.emplace_back((sample.p - p).norm(), &sample);
    }
    std::partial_sort(nearest.begin(), nearest.begin() + kNumStarts, nearest.end());
    double best = nearest.front().first;
    for (std::size_t start = 0; start < kNumStarts; ++start) {
      best = std::min(best, refine(p, *nearest[start].second));
    }
    return best;
  }

 private:
  static constexpr double kSpacing_m = 0.004;

  bool isAir(const Face& face, const Eigen::Vector2d& uv) const {
    // Drawn in by 1 um: on the very edge of two touching boxes, "in front" is ambiguous.
    const Eigen::Vector2d drawn_in(uv.x() * (1.0 - 1e-6 / face.half_u.norm()),
                                   uv.y() * (1.0 - 1e-6 / face.half_v.norm()));
    return uv.cwiseAbs().maxCoeff() <= 1.0 && !isSolid(scene_, face.at(drawn_in) + 1e-6 * face.normal);
  }

  double refine(const Eigen::Vector3d& p, const Sample& start) const {
    double best = (start.p - p).norm();
    Eigen::Vector2d best_uv = start.uv;
    const Eigen::Vector2d metre(1.0 / start.face->half_u.norm(), 1.0 / start.face->half_v.norm());
    for (double window = 1.5 * kSpacing_m; window > 1e-6; window *= 0.5) {
      const Eigen::Vector2d middle = best_uv;
      for (int i = -3; i <= 3; ++i) {
        for (int j = -3; j <= 3; ++j) {
          const Eigen::Vector2d uv = middle + window / 3.0 * metre.cwiseProduct(Eigen::Vector2d(i, j));
          const double distance = (start.face->at(uv) - p).norm();
          if (distance < best && isAir(*start.face, uv)) {
            best = distance;
            best_uv = uv;
          }
        }
      }
    }
    return best;
  }

  Scene scene_;
  std::vector<Face> faces_;
  std::vector<Sample> samples_;
};

/// The search can only end too far away: by rounding, and by where it stops short in an acute corner of a surface patch.
void expectAgreesWithSearch(const Scene& scene, std::uint64_t seed, const Eigen::Vector3d& low,
                            const Eigen::Vector3d& high, int num_points, int least_num_inside) {
  const BruteForceSurface surface(scene);
  const SceneDistance distance(scene, 0);
  SeededRandom random(seed);
  int num_inside = 0;
  for (int i = 0; i < num_points; ++i) {
    const Eigen::Vector3d p = randomPoint(random, low, high);
    const double d = distance.signedDistanceScene(p);
    const bool is_inside = isSolid(scene, p);
    num_inside += is_inside ? 1 : 0;
    const double searched = surface.distance(p);
    ASSERT_EQ(d < 0.0, is_inside) << p.transpose();
    ASSERT_LE(std::abs(d), searched + 3e-6) << p.transpose();
    ASSERT_GE(std::abs(d), searched - 1e-4) << p.transpose();
  }
  EXPECT_GE(num_inside, least_num_inside);
}

Scene makeStack() {
  // Two equal bricks side by side without a gap, two more turned by 90 degrees flush on top, one upright against them.
  Scene scene = makeScene({1.5, 0.4, 1.0}, {0.0, 0.0, 0.15});
  scene.boxes = {
      makeBox(0, {0.0, -0.075, 0.05}, {0.15, 0.075, 0.05}), makeBox(1, {0.0, 0.075, 0.05}, {0.15, 0.075, 0.05}),
      makeBox(2, {-0.075, 0.0, 0.15}, {0.075, 0.15, 0.05}), makeBox(3, {0.075, 0.0, 0.15}, {0.075, 0.15, 0.05}),
      makeBox(4, {0.20, 0.0, 0.15}, {0.05, 0.075, 0.15})};
  return scene;
}

TEST(SceneDistance, OfOneBoxIsTheTextbookFormula) {
  Scene scene = makeScene({1.0, 0.0, 0.5}, {0.0, 0.0, 0.0});
  scene.has_ground = false;
  scene.boxes.push_back(makeBox(0, {0.1, 0.2, 0.3}, {0.1, 0.2, 0.3}));
  const SceneDistance distance(scene, 0);
  EXPECT_NEAR(distance.signedDistanceScene({0.1, 0.2, 0.3}), -0.1, 1e-12);
  EXPECT_NEAR(distance.signedDistanceScene({0.1, 0.38, 0.3}), -0.02, 1e-12);
  EXPECT_NEAR(distance.signedDistanceScene({0.5, 0.2, 0.3}), 0.3, 1e-12);
  EXPECT_NEAR(distance.signedDistanceScene({0.2 + 0.03, 0.4 + 0.04, 0.3}), 0.05, 1e-12);
  EXPECT_NEAR(distance.signedDistanceScene({0.2, 0.2, 0.3}), 0.0, 1e-12);
}

TEST(SceneDistance, InsideTouchingBricksReachesTheExposedSurface) {
  const SceneDistance distance(makeStack(), 0);
  // On the common line of four bricks: every single one has it on its surface, yet air is 0.1 m above.
  EXPECT_NEAR(distance.signedDistanceScene({0.0, 0.0, 0.1}), -0.1, 1e-6);
  // Between the lower two, on the ground: it is 0.15 m to either side, 0.2 m up, 0.15 m to the free end.
  EXPECT_NEAR(distance.signedDistanceScene({0.0, 0.0, 0.0}), -0.15, 1e-6);
  // Under the ground below the middle: to the foot of the free side at x = -0.15.
  EXPECT_NEAR(distance.signedDistanceScene({-0.05, 0.0, -0.02}), -std::hypot(0.1, 0.02), 1e-6);
  // Under open ground.
  EXPECT_NEAR(distance.signedDistanceScene({0.6, 0.6, -0.2}), -0.2, 1e-9);
}

TEST(SceneDistance, InsideInterpenetratingBoxesIgnoresBuriedFaces) {
  Scene scene = makeScene({1.0, 0.0, 0.5}, {0.0, 0.0, 0.0});
  scene.has_ground = false;
  scene.boxes = {makeBox(0, {-0.08, 0.0, 0.0}, {0.1, 0.3, 0.3}), makeBox(1, {0.08, 0.0, 0.0}, {0.1, 0.3, 0.3})};
  // The centre is 0.02 m from two buried faces and 0.18 m from the nearest exposed one.
  EXPECT_NEAR(SceneDistance(scene, 0).signedDistanceScene({0.0, 0.0, 0.0}), -0.18, 1e-6);
}

TEST(SceneDistance, AgreesWithBruteForceSearchInAStackOfTouchingBricks) {
  const Scene scene = makeStack();
  expectAgreesWithSearch(scene, 5, {-0.3, -0.3, -0.1}, {0.35, 0.3, 0.4}, 1500, 300);
}

TEST(SceneDistance, AgreesWithBruteForceSearchInATiltedStackOfTouchingBricks) {
  Scene scene = makeStack();
  scene.has_ground = false;
  const Eigen::Isometry3d tilt = poseFromXyzRpy({0.03, -0.02, 0.4}, {0.7, -0.4, 1.1});
  for (Box& box : scene.boxes) {
    box.T_scene_box = tilt * box.T_scene_box;
  }
  expectAgreesWithSearch(scene, 6, {-0.3, -0.3, 0.1}, {0.35, 0.3, 0.8}, 1500, 100);
}

TEST(SceneDistance, AgreesWithBruteForceSearchInRandomInterpenetratingScenes) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const Scene scene = makeRandomScene(seed, 8, seed % 2 == 0);
    expectAgreesWithSearch(scene, 100 + seed, {-0.6, -0.6, -0.1}, {0.6, 0.6, 0.7}, 500, 30);
  }
}

TEST(SceneDistance, AgreesWithBruteForceSearchInsideTheDemoPile) {
  Scene scene = loadScene(std::string(SYNTHETIC_DEPTH_SCENES) + "/demo_pile.yaml");
  expectAgreesWithSearch(scene, 9, {-0.5, -0.5, -0.05}, {0.5, 0.5, 0.45}, 600, 100);
}

TEST(SceneDistance, NeverChangesFasterThanThePointMoves) {
  for (std::uint64_t seed = 11; seed <= 14; ++seed) {
    const Scene scene = makeRandomScene(seed, 20, seed % 2 == 0);
    const SceneDistance distance(scene, 0);
    SeededRandom random(seed);
    for (int i = 0; i < 4000; ++i) {
      const Eigen::Vector3d p = randomPoint(random, {-0.7, -0.7, -0.2}, {0.7, 0.7, 0.9});
      const double scale = std::pow(10.0, random.uniform(-5.0, -0.5));
      const Eigen::Vector3d q =
          p + randomPoint(random, Eigen::Vector3d::Constant(-scale), Eigen::Vector3d::Constant(scale));
      ASSERT_LE(std::abs(distance.signedDistanceScene(p) - distance.signedDistanceScene(q)), (p - q).norm() + 3e-6)
          << p.transpose() << " and " << q.transpose();
    }
  }
}

TEST(SceneDistance, HasUnitGradientWhereItIsSmooth) {
  const Scene scene = makeRandomScene(31, 15, true);
  const SceneDistance distance(scene, 0);
  SeededRandom random(31);
  constexpr double kStep = 1e-5;
  int num_unit = 0;
  constexpr int kNumPoints = 3000;
  for (int i = 0; i < kNumPoints; ++i) {
    const Eigen::Vector3d p = randomPoint(random, {-0.7, -0.7, -0.1}, {0.7, 0.7, 0.9});
    Eigen::Vector3d gradient;
    for (int axis = 0; axis < 3; ++axis) {
      const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(axis);
      gradient[axis] =
          (distance.signedDistanceScene(p + step) - distance.signedDistanceScene(p - step)) / (2.0 * kStep);
    }
    num_unit += std::abs(gradient.norm() - 1.0) < 1e-3 ? 1 : 0;
  }
  // The rest are within a step of the medial axis or a fold, a set of measure zero.
  EXPECT_GT(num_unit, 0.995 * kNumPoints);
}

TEST(SceneDistance, MovesRigidlyWithTheMapFrame) {
  Scene scene = makeRandomScene(41, 10, true);
  SeededRandom random(41);
  Eigen::Matrix3Xd points_scene(3, 200);
  for (Eigen::Index i = 0; i < points_scene.cols(); ++i) {
    points_scene.col(i) = randomPoint(random, {-0.7, -0.7, -0.1}, {0.7, 0.7, 0.9});
  }
  scene.T_map_scene = Eigen::Isometry3d::Identity();
  const Eigen::VectorXd expected = signedDistance(scene, 0, points_scene);
  scene.T_map_scene = poseFromXyzRpy({1.0, -2.0, 0.5}, {0.3, -0.8, 2.0});
  const Eigen::Matrix3Xd points_map = scene.T_map_scene * points_scene;
  EXPECT_LT((signedDistance(scene, 0, points_map) - expected).cwiseAbs().maxCoeff(), 1e-9);
}

TEST(SceneDistance, IsInfiniteInAnEmptySceneAndNaNForNaN) {
  Scene scene = makeScene({1.0, 0.0, 0.5}, {0.0, 0.0, 0.0});
  scene.has_ground = false;
  Eigen::Matrix3Xd points(3, 2);
  points << 0.0, std::nan(""), 0.0, 0.0, 0.0, 0.0;
  const Eigen::VectorXd d = signedDistance(scene, 0, points);
  EXPECT_EQ(d[0], std::numeric_limits<double>::infinity());
  EXPECT_TRUE(std::isnan(d[1]));
}

TEST(ExposedSurfaceSamples, LieOnTheSurfaceWithAirInFrontAndSolidBehind) {
  constexpr double kStep = 3e-7;  // just beyond the contact tolerance: in a narrow wedge, air ends soon
  for (const Scene& scene : {makeStack(), makeRandomScene(51, 12, true), makeRandomScene(52, 12, false)}) {
    const SurfaceSamples samples = exposedSurfaceSamples(scene, 0, 0.02);
    ASSERT_GT(samples.points_map.cols(), 500);
    ASSERT_EQ(samples.points_map.cols(), static_cast<Eigen::Index>(samples.ids.size()));
    const SceneDistance distance(scene, 0);
    EXPECT_LT(distance.signedDistance(samples.points_map).cwiseAbs().maxCoeff(), 1e-6);
    const Eigen::Matrix3Xd in_front = samples.points_map + kStep * samples.normals_map;
    const Eigen::Matrix3Xd behind = samples.points_map - kStep * samples.normals_map;
    EXPECT_GT(distance.signedDistance(in_front).minCoeff(), 0.0);
    EXPECT_LT(distance.signedDistance(behind).maxCoeff(), 0.0);
  }
}

TEST(ExposedSurfaceSamples, LeaveOutContactAreas) {
  const Scene scene = makeStack();
  constexpr double kSpacing = 0.005;
  const SurfaceSamples samples = exposedSurfaceSamples(scene, 0, kSpacing);
  // The lower bricks show only the sides of their common 0.3 x 0.3 x 0.1 m block, less where the upright one stands.
  int num_lower = 0;
  for (const int id : samples.ids) {
    num_lower += id == 0 || id == 1 ? 1 : 0;
  }
  const double area_of_lower = 4.0 * 0.3 * 0.1 - 0.15 * 0.1;
  EXPECT_NEAR(num_lower * kSpacing * kSpacing, area_of_lower, 1e-3);
}

TEST(ExposedSurfaceSamples, RefuseASpacingThatIsNotPositive) {
  EXPECT_THROW(exposedSurfaceSamples(makeStack(), 0, 0.0), std::invalid_argument);
}

TEST(VisibleSurfaceSamples, HoldOnlyWhatSomeFrameSaw) {
  Scene scene = makeScene({1.2, 0.0, 0.5}, {0.0, 0.0, 0.1}, 4);
  scene.boxes = {makeBox(0, {0.0, 0.0, 0.1}, {0.1, 0.1, 0.1}), makeBox(1, {0.35, 0.0, 0.15}, {0.05, 0.15, 0.15})};
  scene.boxes[1].vanishes_at_frame = 2;
  const auto countOf = [](const SurfaceSamples& samples, int id) {
    return std::count(samples.ids.begin(), samples.ids.end(), id);
  };
  const SurfaceSamples hidden = visibleSurfaceSamples(scene, 0, 1, 0.01);
  const SurfaceSamples shown = visibleSurfaceSamples(scene, 0, 2, 0.01);
  EXPECT_GT(countOf(hidden, 1), 0);
  EXPECT_EQ(countOf(shown, 1), 0);  // gone at frame 2
  EXPECT_GT(countOf(shown, 0), countOf(hidden, 0));
  // Front 0.2 x 0.2 m and top 0.2 x 0.2 m of the far box; the camera looks along -x, so no other face shows.
  EXPECT_EQ(countOf(shown, 0), 2 * 20 * 20);
  EXPECT_LT(shown.points_map.cols(), exposedSurfaceSamples(scene, 2, 0.01).points_map.cols());
}

TEST(VisibleSurfaceSamples, NeedTheSensorsRange) {
  Scene scene = makeScene({0.0, 0.0, 1.0}, {0.0, 0.0, 0.0});
  EXPECT_GT(visibleSurfaceSamples(scene, 0, 0, 0.05).ids.size(), 0U);
  scene.sensor.max_range_m = 0.9;
  EXPECT_EQ(visibleSurfaceSamples(scene, 0, 0, 0.05).ids.size(), 0U);
}

}  // namespace

TEST(VisibleSurfaceSamples, LeavesOutWhatIsSeenTooFlat) {
  Scene scene;
  scene.roi.min_m = Eigen::Vector3d(-1.0, -1.0, -0.05);
  scene.roi.max_m = Eigen::Vector3d(1.0, 1.0, 0.5);
  scene.T_scene_camera = {lookAt({-1.5, 0.0, 0.5}, Eigen::Vector3d::Zero())};
  const auto leastCosine = [&scene](const SurfaceSamples& samples) {
    double least = 1.0;
    for (Eigen::Index i = 0; i < samples.points_map.cols(); ++i) {
      const Eigen::Vector3d ray = scene.cameraInMap(0).translation() - samples.points_map.col(i);
      least = std::min(least, ray.normalized().dot(samples.normals_map.col(i)));
    }
    return least;
  };
  const SurfaceSamples all = visibleSurfaceSamples(scene, 0, 0, 0.05);
  const SurfaceSamples steep = visibleSurfaceSamples(scene, 0, 0, 0.05, 0.3);
  EXPECT_LT(leastCosine(all), 0.25);
  EXPECT_GE(leastCosine(steep), 0.3);
  EXPECT_GT(steep.points_map.cols(), all.points_map.cols() / 4);
}

}  // namespace synthetic_depth
