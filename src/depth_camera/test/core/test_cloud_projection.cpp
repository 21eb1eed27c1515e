// SPDX-License-Identifier: BSD-3-Clause
#include "depth_camera/cloud_projection.h"

#include <cmath>
#include <limits>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace depth_camera {
namespace {

const CameraModel kCamera = {9, 5, 10.0, 10.0, 4.0, 2.0};

DepthImage project(const Eigen::Matrix3Xf& points, const Eigen::Matrix3f& R_view_cloud = Eigen::Matrix3f::Identity()) {
  return projectPoints(points, R_view_cloud, kCamera);
}

TEST(CloudProjection, EachPointFallsIntoThePixelThatSeesIt) {
  for (int v = 0; v < kCamera.height; ++v) {
    for (int u = 0; u < kCamera.width; ++u) {
      const DepthImage image = project((2.0 * kCamera.ray(u + 0.4, v - 0.4)).cast<float>());
      for (int y = 0; y < kCamera.height; ++y) {
        for (int x = 0; x < kCamera.width; ++x) {
          if (x == u && y == v) {
            EXPECT_EQ(image.at(x, y), 2.0f);
          } else {
            EXPECT_TRUE(std::isnan(image.at(x, y))) << x << " " << y;
          }
        }
      }
    }
  }
}

TEST(CloudProjection, TheNearestPointOfAPixelCounts) {
  Eigen::Matrix3Xf points(3, 3);
  points.row(0).setZero();
  points.row(1).setZero();
  points.row(2) << 3.0f, 1.0f, 2.0f;
  EXPECT_EQ(project(points).at(4, 2), 1.0f);
}

TEST(CloudProjection, WhatThePinholeCannotSeeIsLeftOut) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInf = std::numeric_limits<float>::infinity();
  Eigen::Matrix3Xf points(3, 7);
  points.col(0) << 0, 0, -1;
  points.col(1) << 0, 0, 0;
  points.col(2) << 1, 0, 1;  // u = 14 of 9
  points.col(3) << 0, -1, 1;
  points.col(4) << kNan, 0, 1;
  points.col(5) << 0, 0, kInf;
  points.col(6) << 3e38f, 0, 1e-38f;
  EXPECT_FALSE(holdsMeasurement(project(points)));
}

TEST(CloudProjection, TheViewIsTurned) {
  const Eigen::Matrix3f turn = Eigen::AngleAxisf(0.5f * static_cast<float>(M_PI), Eigen::Vector3f::UnitX()).matrix();
  EXPECT_NEAR(project(Eigen::Vector3f(0, 2, 0), turn).at(4, 2), 2.0f, 1e-6f);
}

}  // namespace
}  // namespace depth_camera
