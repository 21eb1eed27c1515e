// SPDX-License-Identifier: BSD-3-Clause
// Images of several cameras in one map: each camera has its own speed and field of view, all share the points.
#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "gpis_mapping/gpis_map.h"

namespace gpis_mapping {
namespace {

CameraModel camera(int width = 80) {
  CameraModel camera;
  camera.width = width;
  camera.height = 60;
  camera.fx = camera.fy = 65.0;
  camera.cx = 0.5 * (width - 1);
  camera.cy = 29.5;
  return camera;
}

/// 1 m above the floor z = 0, looking down, at (x, y).
Eigen::Isometry3d above(double x, double y) {
  Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
  T_map_camera.linear() = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()).toRotationMatrix();
  T_map_camera.translation() << x, y, 1.0;
  return T_map_camera;
}

/// The floor, and, if it is there, a plate 0.3 m above it: 0.2 m a side, about the origin.
DepthImage look(const CameraModel& camera, const Eigen::Isometry3d& T_map_camera, bool has_plate) {
  DepthImage image;
  image.width = camera.width;
  image.height = camera.height;
  image.depth_m.assign(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height), 1.0f);
  if (!has_plate) return image;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const Eigen::Vector3d p = T_map_camera * (0.7 * camera.ray(u, v));
      if (std::abs(p.x()) < 0.1 && std::abs(p.y()) < 0.1) {
        image.depth_m[static_cast<std::size_t>(v) * camera.width + u] = 0.7f;
      }
    }
  }
  return image;
}

/// Two cameras at rest, `count` images of each, one after the other.
std::unique_ptr<GpisMap> mapOfTwo(int count, double period_s, double delay_s, bool tells_them_apart) {
  auto map = std::make_unique<GpisMap>(GpisConfig());
  for (int i = 0; i < count; ++i) {
    const double stamp_s = 100.0 + i * period_s;
    map->update(look(camera(), above(-0.3, 0.0), true), camera(), above(-0.3, 0.0), stamp_s);
    map->update(look(camera(), above(0.3, 0.0), true), camera(), above(0.3, 0.0), stamp_s + delay_s, nullptr,
                tells_them_apart ? 1 : 0);
  }
  return map;
}

auto pointsOfPlate(const GpisMap& map) {
  const std::vector<SurfacePoint> points = map.contents().points;
  return std::count_if(points.begin(), points.end(),
                       [](const SurfacePoint& point) { return point.position_map.z() > 0.2; });
}

double largestDifference(const MapContents& a, const MapContents& b) {
  if (a.points.size() != b.points.size()) return 1e9;
  double largest = 0.0;
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    largest = std::max(largest, (a.points[i].position_map - b.points[i].position_map).norm());
    largest =
        std::max<double>(largest, std::abs(std::sqrt(a.points[i].variance_m2) - std::sqrt(b.points[i].variance_m2)));
  }
  return largest;
}

TEST(SeveralCameras, AreAtRestAlthoughTheirImagesAlternate) {
  // Poses seconds apart tell no speed: the map of cameras at rest. All pixels measure, so the fields of view agree.
  const auto at_rest = mapOfTwo(4, 10.0, 5.0, false);
  ASSERT_GT(at_rest->snapshot()->numPoints(), 500u);
  EXPECT_EQ(largestDifference(mapOfTwo(4, 0.1, 0.05, true)->contents(), at_rest->contents()), 0.0);
  // One camera that jumps to and fro by 0.6 m in 0.05 s: its stamps' error of 2 ms is 24 mm.
  EXPECT_GT(largestDifference(mapOfTwo(4, 0.1, 0.05, false)->contents(), at_rest->contents()), 1e-4);
}

TEST(SeveralCameras, MayHaveEqualStampsOrComeOutOfOrder) {
  const MapContents in_order = mapOfTwo(4, 0.1, 0.05, true)->contents();
  for (const double delay_s : {0.0, -0.03}) {
    EXPECT_EQ(largestDifference(mapOfTwo(4, 0.1, delay_s, true)->contents(), in_order), 0.0) << delay_s;
  }
}

TEST(SeveralCameras, EachForgetsWhatItSeesPast) {
  for (const std::size_t witness : {0u, 1u}) {
    const auto map = mapOfTwo(4, 0.1, 0.05, true);
    const Points3d plate = Eigen::Vector3d(0.0, 0.0, 0.3);
    ASSERT_NEAR(map->snapshot()->query(plate).distance[0], 0.0, 0.005);
    ASSERT_GT(pointsOfPlate(*map), 10);
    const Eigen::Isometry3d T_map_camera = above(witness == 0 ? -0.3 : 0.3, 0.0);
    const UpdateStatistics statistics =
        map->update(look(camera(), T_map_camera, false), camera(), T_map_camera, 100.5, nullptr, witness);
    EXPECT_GT(statistics.deleted, 0u) << witness;
    EXPECT_EQ(pointsOfPlate(*map), 0) << witness;
    EXPECT_GT(map->snapshot()->query(plate).euclidean_distance[0], 0.2) << witness;
  }
}

TEST(SeveralCameras, MayDifferInSizeAndKeepTheFieldOfViewOfTheFirst) {
  GpisMap map{GpisConfig()};
  for (int i = 0; i < 3; ++i) {
    const double stamp_s = 100.0 + 0.1 * i;
    map.update(look(camera(), above(-0.3, 0.0), true), camera(), above(-0.3, 0.0), stamp_s);
    map.update(look(camera(120), above(0.3, 0.0), true), camera(120), above(0.3, 0.0), stamp_s, nullptr, 7);
    map.retune(map.config().sensor, map.config().dynamic);
  }
  const MapContents contents = map.contents();
  EXPECT_EQ(contents.view.camera.width, 80);
  EXPECT_EQ(contents.view.pixel_history.size(), 80u * 60u);
  EXPECT_EQ(std::count(contents.view.pixel_history.begin(), contents.view.pixel_history.end(), PixelHistory::kMeasures),
            80 * 60);
  EXPECT_EQ(contents.view.T_map_camera.translation().x(), -0.3);
}

}  // namespace
}  // namespace gpis_mapping
