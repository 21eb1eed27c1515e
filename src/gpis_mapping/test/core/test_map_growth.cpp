// SPDX-License-Identifier: BSD-3-Clause
// The work of an update, counted: it must not grow with what of the map is out of view.
#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "analytic_surfaces.h"
#include "gpis_mapping/gpis_map.h"

namespace gpis_mapping {
namespace {

CameraModel smallCamera() {
  CameraModel camera;
  camera.width = 96;
  camera.height = 72;
  camera.fx = camera.fy = 80.0;
  camera.cx = 47.5;
  camera.cy = 35.5;
  return camera;
}

/// From 1 m over the floor straight down; `height_m` of what stands in the middle of the image.
DepthImage lookDown(double height_m) {
  const CameraModel camera = smallCamera();
  DepthImage image;
  image.width = camera.width;
  image.height = camera.height;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const bool is_middle = std::abs(u - camera.cx) < 12.0 && std::abs(v - camera.cy) < 12.0;
      image.depth_m.push_back(static_cast<float>(1.0 - (is_middle ? height_m : 0.0)));
    }
  }
  return image;
}

/// Of a floor of that many m2 with the camera over its middle: what a box that comes and goes costs.
std::vector<UpdateStatistics> updatesOf(double area_m2) {
  MapContents contents;
  contents.config.threads = 1;
  const double side = std::sqrt(area_m2);
  // The same places in view whatever the area.
  const double low = -0.02 * std::floor(0.5 * side / 0.02);
  gpis_mapping_test::sampleRectangle({low, low, 0.0}, {-2.0 * low, 0.0, 0.0}, {0.0, -2.0 * low, 0.0}, 0.02, 0.001,
                                     &contents.points);
  GpisMap map(std::move(contents));
  Eigen::Isometry3d T_map_camera = Eigen::Isometry3d::Identity();
  T_map_camera.linear() = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()).toRotationMatrix();
  T_map_camera.translation() = Eigen::Vector3d(0.013, -0.021, 1.0);
  std::vector<UpdateStatistics> result;
  double stamp_s = 0.0;
  for (const double height_m : {0.0, 0.1, 0.1, 0.0}) {
    result.push_back(map.update(lookDown(height_m), smallCamera(), T_map_camera, stamp_s += 0.1));
  }
  return result;
}

TEST(MapGrowth, AnUpdateCostsTheSameInAMapOfTenTimesTheArea) {
  const std::vector<UpdateStatistics> small = updatesOf(10.0);
  const std::vector<UpdateStatistics> large = updatesOf(100.0);
  ASSERT_GT(large[0].map_points, 8 * small[0].map_points);
  std::size_t retrained = 0;
  for (std::size_t i = 0; i < small.size(); ++i) {
    SCOPED_TRACE(i);
    EXPECT_GT(small[i].fused, 300u);
    EXPECT_EQ(large[i].fused, small[i].fused);
    EXPECT_EQ(large[i].deleted, small[i].deleted);
    EXPECT_EQ(large[i].inserted, small[i].inserted);
    EXPECT_EQ(large[i].cells_retrained, small[i].cells_retrained);
    retrained += small[i].cells_retrained;
    // Pages and blocks in view are filled alike but for those that reach past the smaller floor's rim.
    EXPECT_NEAR(large[i].cells_copied, small[i].cells_copied, 0.1 * small[i].cells_copied);
    EXPECT_NEAR(large[i].cells_looked_at, small[i].cells_looked_at, 0.1 * small[i].cells_looked_at);
  }
  EXPECT_GT(retrained, 20u);  // the box and its rim, there and gone
}

}  // namespace
}  // namespace gpis_mapping
