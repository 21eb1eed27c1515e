// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/depth_renderer.h"

#include <array>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "synthetic_depth/scene_distance.h"
#include "synthetic_depth/testing/random_scene.h"

namespace synthetic_depth {
namespace {

using test::makeBox;
using test::makeRandomScene;
using test::makeScene;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Parameter of origin + t * direction at a triangle (Moeller and Trumbore 1997); infinite if it misses.
double hitTriangle(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, const Eigen::Vector3d& a,
                   const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  const Eigen::Vector3d p = direction.cross(c - a);
  const double determinant = (b - a).dot(p);
  if (std::abs(determinant) < 1e-14) {
    return kInfinity;
  }
  const double beta = (origin - a).dot(p) / determinant;
  const Eigen::Vector3d q = (origin - a).cross(b - a);
  const double gamma = direction.dot(q) / determinant;
  const double t = (c - a).dot(q) / determinant;
  return beta >= 0.0 && gamma >= 0.0 && beta + gamma <= 1.0 && t > 0.0 ? t : kInfinity;
}

struct SlowHit {
  double z{kInfinity};
  int id{kNoReturnId};
};

/// Every ray against both triangles of every face of every box: shares no formula with the renderer.
SlowHit castSlowly(const Scene& scene, int frame, double u, double v) {
  const Eigen::Isometry3d& T_scene_camera = scene.T_scene_camera[static_cast<std::size_t>(frame)];
  const Eigen::Vector3d origin = T_scene_camera.translation();
  const Eigen::Vector3d direction =
      T_scene_camera.linear() * Eigen::Vector3d((u - scene.camera.cx_px) / scene.camera.fx_px,
                                                (v - scene.camera.cy_px) / scene.camera.fy_px, 1.0);
  SlowHit hit;
  if (scene.has_ground && -origin.z() / direction.z() > 0.0) {
    hit = {-origin.z() / direction.z(), kGroundId};
  }
  for (const Box& box : scene.boxesAt(frame)) {
    std::array<Eigen::Vector3d, 8> corners;
    for (int i = 0; i < 8; ++i) {
      corners[static_cast<std::size_t>(i)] =
          box.T_scene_box * box.half_extents_m.cwiseProduct(
                                Eigen::Vector3d((i & 1) ? 1.0 : -1.0, (i & 2) ? 1.0 : -1.0, (i & 4) ? 1.0 : -1.0));
    }
    constexpr std::array<std::array<std::size_t, 4>, 6> kFaces{
        {{0, 1, 3, 2}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 3, 7, 5}}};
    for (const auto& face : kFaces) {
      for (const std::size_t second : {std::size_t{1}, std::size_t{2}}) {
        const double t =
            hitTriangle(origin, direction, corners[face[0]], corners[face[second]], corners[face[second + 1]]);
        if (t < hit.z) {
          hit = {t, box.id};
        }
      }
    }
  }
  return hit;
}

TEST(DepthRenderer, AgreesWithBruteForceTrianglesOnRandomScenes) {
  int num_box_pixels = 0;
  int num_grazing = 0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    const Scene scene = makeRandomScene(seed, 12, seed % 2 == 0);
    for (int frame = 0; frame < scene.numFrames(); ++frame) {
      cv::Mat ids;
      const cv::Mat depth = renderDepth(scene, frame, &ids);
      for (int v = 0; v < depth.rows; ++v) {
        for (int u = 0; u < depth.cols; ++u) {
          const SlowHit expected = castSlowly(scene, frame, u, v);
          const float z = depth.at<float>(v, u);
          // Depth is rounded to float once: half a step is 6e-8 relative.
          if (std::isinf(expected.z) ? std::isinf(z) : std::abs(z - expected.z) <= 1e-7 * expected.z) {
            num_box_pixels += expected.id >= 0 ? 1 : 0;
            EXPECT_EQ(ids.at<int>(v, u), expected.id);
          } else {
            ++num_grazing;  // a ray through an edge may be rounded to either side
          }
        }
      }
    }
  }
  EXPECT_GT(num_box_pixels, 50000);
  EXPECT_LE(num_grazing, 3);
}

TEST(DepthRenderer, SeesBoxesThatReachBehindTheImagePlane) {
  Scene scene = makeScene({0.0, 0.0, 0.5}, {1.0, 0.0, 0.5});
  scene.boxes.push_back(makeBox(0, {0.0, 0.4, 0.5}, {2.0, 0.1, 2.0}));   // a wall beside and behind the camera
  scene.boxes.push_back(makeBox(1, {-1.0, 0.0, 0.5}, {0.1, 0.1, 0.1}));  // wholly behind
  cv::Mat ids;
  const cv::Mat depth = renderDepth(scene, 0, &ids);
  int num_wall = 0;
  for (int v = 0; v < depth.rows; ++v) {
    for (int u = 0; u < depth.cols; ++u) {
      const SlowHit expected = castSlowly(scene, 0, u, v);
      EXPECT_EQ(ids.at<int>(v, u), expected.id);
      num_wall += expected.id == 0 ? 1 : 0;
      EXPECT_NE(ids.at<int>(v, u), 1);
    }
  }
  EXPECT_GT(num_wall, 1000);
}

TEST(DepthRenderer, GivesInfinityWhereNothingIs) {
  Scene scene = makeScene({1.0, 0.0, 0.5}, {0.0, 0.0, 0.5});
  scene.has_ground = false;
  cv::Mat ids;
  const cv::Mat depth = renderDepth(scene, 0, &ids);
  EXPECT_EQ(cv::countNonZero(depth == kInfinity), depth.rows * depth.cols);
  EXPECT_EQ(cv::countNonZero(ids == kNoReturnId), depth.rows * depth.cols);
}

TEST(DepthRenderer, GivesDepthAlongTheAxisNotRayLength) {
  Scene scene = makeScene({0.0, 0.0, 1.5}, {0.0, 0.0, 0.0});
  const cv::Mat depth = renderDepth(scene, 0);
  for (int v = 0; v < depth.rows; v += 7) {
    for (int u = 0; u < depth.cols; u += 7) {
      EXPECT_FLOAT_EQ(depth.at<float>(v, u), 1.5F);
    }
  }
}

TEST(DepthRenderer, BackprojectedPixelsLieOnTheZeroLevelSet) {
  for (std::uint64_t seed = 20; seed < 24; ++seed) {
    const Scene scene = makeRandomScene(seed, 15, true);
    const cv::Mat depth = renderDepth(scene, 1);
    const Eigen::Isometry3d T_map_camera = scene.cameraInMap(1);
    const SceneDistance distance(scene, 1);
    for (int v = 0; v < depth.rows; v += 2) {
      for (int u = 0; u < depth.cols; u += 2) {
        const double z = depth.at<float>(v, u);
        if (!std::isfinite(z)) {
          continue;
        }
        const Eigen::Vector3d p_camera((u - scene.camera.cx_px) / scene.camera.fx_px * z,
                                       (v - scene.camera.cy_px) / scene.camera.fy_px * z, z);
        const Eigen::Matrix3Xd p_map = T_map_camera * p_camera;
        // z is a float: at 2 m rounded by up to 1.2e-7 m, times the ray's obliqueness.
        ASSERT_NEAR(distance.signedDistance(p_map)[0], 0.0, 1e-6 + 2e-7 * z) << "pixel " << u << ", " << v;
      }
    }
  }
}

TEST(DepthRenderer, BoxVanishesAndAppearsExactlyAtItsFrame) {
  Scene scene = makeScene({1.0, 0.0, 0.8}, {0.0, 0.0, 0.1}, 6);
  scene.boxes.push_back(makeBox(7, {0.0, 0.15, 0.1}, {0.1, 0.1, 0.1}));
  scene.boxes.push_back(makeBox(8, {0.0, -0.15, 0.1}, {0.1, 0.1, 0.1}));
  scene.boxes[0].vanishes_at_frame = 3;
  scene.boxes[1].appears_at_frame = 4;
  const Eigen::Matrix3Xd centers_map =
      (Eigen::Matrix3Xd(3, 2) << scene.T_map_scene * scene.boxes[0].T_scene_box.translation(),
       scene.T_map_scene * scene.boxes[1].T_scene_box.translation())
          .finished();
  for (int frame = 0; frame < 6; ++frame) {
    cv::Mat ids;
    renderDepth(scene, frame, &ids);
    EXPECT_EQ(cv::countNonZero(ids == 7) > 0, frame < 3) << "frame " << frame;
    EXPECT_EQ(cv::countNonZero(ids == 8) > 0, frame >= 4) << "frame " << frame;
    const Eigen::VectorXd d = signedDistance(scene, frame, centers_map);
    EXPECT_EQ(d[0] < 0.0, frame < 3) << "frame " << frame;
    EXPECT_EQ(d[1] < 0.0, frame >= 4) << "frame " << frame;
  }
  EXPECT_EQ(scene.removedIds(), std::vector<int>{7});
  EXPECT_EQ(scene.firstRemovalFrame(), 3);
}

TEST(DepthRenderer, RefusesFramesTheSceneHasNot) {
  const Scene scene = makeScene({1.0, 0.0, 0.5}, {0.0, 0.0, 0.0});
  EXPECT_THROW(renderDepth(scene, -1), std::out_of_range);
  EXPECT_THROW(renderDepth(scene, 1), std::out_of_range);
}

TEST(ViewCaster, HidesPointsBehindBoxesAndShowsThoseInFront) {
  Scene scene = makeScene({1.0, 0.0, 0.2}, {0.0, 0.0, 0.2});
  scene.boxes.push_back(makeBox(0, {0.0, 0.0, 0.2}, {0.1, 0.1, 0.1}));
  const ViewCaster caster(scene, 0, scene.T_scene_camera[0]);
  EXPECT_TRUE(caster.isVisible({0.0, 0.0, 0.5}));
  EXPECT_TRUE(caster.isVisible({0.0, 0.0, 0.9}));  // the front face itself
  EXPECT_FALSE(caster.isVisible({0.0, 0.0, 0.95}));
  EXPECT_FALSE(caster.isVisible({0.0, 0.0, 1.5}));
  EXPECT_TRUE(caster.isVisible({0.3, 0.0, 1.5}));
  EXPECT_FALSE(caster.isVisible({0.0, 0.0, -0.5}));
}

}  // namespace
}  // namespace synthetic_depth
