// SPDX-License-Identifier: BSD-3-Clause
#include "../../src/core/insertion_grid.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "analytic_surfaces.h"
#include "depth_frames.h"

namespace gpis_mapping {
namespace {

using gpis_mapping_test::makeFrame;
using gpis_mapping_test::planeDepth;
using gpis_mapping_test::surfacePoint;

const CameraModel kCamera{160, 120, 131.0, 128.0, 79.0, 61.0};

// Long: the search that it is compared with is part of it.
TEST(InsertionGrid, StrikesOutWhatASearchOfAllPointsFinds) {
  GpisConfig config;
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const Crowding crowding{0.8 * config.surface.spacing_m, config.dynamic.tolerance_sigmas};
  const Eigen::Vector3d plane_n = Eigen::Vector3d(0.3, -0.2, -1.0).normalized();
  const double plane_offset = plane_n.z() * 1.6;
  const auto pixels =
      makeFrame(kCamera, [&](int u, int v) { return planeDepth(kCamera.ray(u, v), plane_n, plane_offset); });
  // A hole: nothing to begin at.
  for (int u = 0; u < 30; ++u) pixels->kind[pixels->index(u, 60)] = PixelKind::kHole;
  Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
  T_map_camera.rotate(Eigen::AngleAxisd(0.4, Eigen::Vector3d(1.0, 0.5, -0.3).normalized()));
  T_map_camera.translation() << 0.3, -0.2, 1.1;
  const double z = 0.5 * (config.sensor.min_range_m + config.sensor.max_range_m);
  const auto regressor =
      std::make_shared<FrameRegressor>(kCamera, config.frame_map, config.sensor.noise.sigma(z) / (z * z));
  const std::vector<PixelHistory> history(160 * 120, PixelHistory::kMeasures);
  const Frame frame(config, pixels, regressor, history, T_map_camera, {}, 1.0f, 1);
  InsertionGrid grid(frame, config, crowding, 2);
  ASSERT_EQ(grid.rows(), 40);
  ASSERT_EQ(grid.columns(), 54);

  // On the plane, before and behind it, of the same and of other directions, in and out of the image, behind the camera.
  std::vector<SurfacePoint> points;
  for (int i = 0; i < 6000; ++i) {
    const Eigen::Vector3d ray = kCamera.ray(80.0 + 120.0 * uniform(rng), 60.0 + 90.0 * uniform(rng));
    const Eigen::Vector3d on = ray * planeDepth(ray, plane_n, plane_offset);
    const Eigen::Vector3d n = i % 5 == 0 ? gpis_mapping_test::randomUnit(&rng) : plane_n;
    points.push_back(
        surfacePoint(T_map_camera * (on + 0.03 * uniform(rng) * plane_n), T_map_camera.linear() * n, 0.004));
  }
  points.push_back(surfacePoint(T_map_camera * Eigen::Vector3d(0.0, 0.0, -1.0), {0.0, 0.0, 1.0}, 0.004));
  for (const SurfacePoint& point : points) grid.strikeOut(point);

  int open = 0, struck = 0;
  for (int row = 0; row < grid.rows(); ++row) {
    for (int column = 0; column < grid.columns(); ++column) {
      const int u = column * InsertionGrid::kStridePx;
      const int v = row * InsertionGrid::kStridePx;
      if (pixels->kind[pixels->index(u, v)] != PixelKind::kSurface) {
        EXPECT_FALSE(grid.isOpen(row, column));
        continue;
      }
      if (!frame.map().isSmooth(u, v)) {
        EXPECT_TRUE(grid.isOpen(row, column));
        continue;
      }
      const Eigen::Vector3d p_camera = kCamera.ray(u, v) / pixels->inverse_depth[pixels->index(u, v)];
      const Eigen::Vector3d p = T_map_camera * p_camera;
      const Eigen::Vector3f n = T_map_camera.linear().cast<float>() * frame.map().trendNormal(u, v);
      const double variance = frame.correlatedVariance(p_camera.z());
      // Struck out: a point leaves no room. Open: none does that is not farther across the ray than the spacing. A micrometre
      // for floats.
      bool is_found = false, is_found_near = false;
      for (const SurfacePoint& point : points) {
        const auto finds = [&](double spacing) {
          const Crowding rule{spacing, crowding.tolerance_sigmas};
          return rule.leavesNoRoom<double>(p - point.position_map, point.normal_map, n, variance + point.variance_m2,
                                           rule.reach(variance));
        };
        is_found = is_found || finds(crowding.spacing_m + 1e-6);
        const Eigen::Vector3d q = T_map_camera.inverse() * point.position_map;
        const double across = std::max(std::abs(q.x() / q.z() - p_camera.x() / p_camera.z()),
                                       std::abs(q.y() / q.z() - p_camera.y() / p_camera.z())) *
                              q.z();
        is_found_near =
            is_found_near || (q.z() > 0.0 && across < crowding.spacing_m - 1e-6 && finds(crowding.spacing_m - 1e-6));
      }
      if (grid.isOpen(row, column)) {
        ++open;
        EXPECT_FALSE(is_found_near) << u << ", " << v;
      } else {
        ++struck;
        EXPECT_TRUE(is_found) << u << ", " << v;
      }
    }
  }
  EXPECT_GT(open, 200);
  EXPECT_GT(struck, 200);
}

}  // namespace
}  // namespace gpis_mapping
