// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/missing_returns.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "synthetic_depth/depth_renderer.h"
#include "synthetic_depth/scene_loader.h"
#include "synthetic_depth/sensor.h"
#include "synthetic_depth/testing/random_scene.h"

namespace synthetic_depth {
namespace {

using test::makeBox;
using test::makeScene;

constexpr float kInfinity = std::numeric_limits<float>::infinity();

bool isSame(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && std::equal(a.datastart, a.dataend, b.datastart, b.dataend);
}

cv::Mat missingOf(const Scene& scene, int frame = 0, const cv::Mat& albedo = {}) {
  return missingReturns(scene.camera, scene.sensor, scene.seed, static_cast<std::uint64_t>(frame),
                        renderDepth(scene, frame), albedo);
}

/// A box, half of it dark, on the ground; seen from above, with everything that can be missing.
Scene sceneWithAllDefects() {
  Scene scene = makeScene({0.6, 0.2, 1.0}, {0.0, 0.0, 0.1}, 2);
  scene.boxes = {makeBox(0, {0.0, 0.15, 0.2}, {0.15, 0.1, 0.2}), makeBox(1, {0.0, -0.15, 0.2}, {0.15, 0.1, 0.2})};
  scene.boxes[1].albedo = 0.3;
  scene.sensor.border_left_px = 6;
  scene.sensor.has_hexagonal_view = true;
  scene.sensor.min_return_per_m2 = 0.3;
  scene.sensor.edge_loss_px = 3.0;
  return scene;
}

TEST(MissingReturns, RectangularBorderHasTheMargins) {
  Scene scene = makeScene({0.0, 0.0, 1.0}, {0.0, 0.0, 0.0});
  scene.sensor.border_left_px = 3;
  scene.sensor.border_right_px = 35;
  scene.sensor.border_top_px = 34;
  scene.sensor.border_bottom_px = 1;
  const cv::Mat missing = missingOf(scene);
  for (int v = 0; v < missing.rows; ++v) {
    for (int u = 0; u < missing.cols; ++u) {
      const bool is_inside = u >= 3 && u < 160 - 35 && v >= 34 && v < 120 - 1;
      ASSERT_EQ(missing.at<unsigned char>(v, u), is_inside ? 0 : 255) << u << ", " << v;
    }
  }
}

TEST(MissingReturns, HexagonalBorderHasCornersLeftAndRight) {
  Scene scene = makeScene({0.0, 0.0, 1.0}, {0.0, 0.0, 0.0});
  scene.sensor.has_hexagonal_view = true;
  scene.sensor.border_top_px = 20;
  const cv::Mat missing = missingOf(scene);
  // Half-planes in continuous coordinates: 160 x 100 px, centre (79.5, 69.5); from (+-80, 0) to (+-40, +-50).
  for (int v = 0; v < missing.rows; ++v) {
    for (int u = 0; u < missing.cols; ++u) {
      const double x = std::abs(u - 79.5);
      const double y = std::abs(v - 69.5);
      const double outside_px = std::max(x + 0.8 * y - 80.0, y - 50.0);
      if (std::abs(outside_px) < 0.75) continue;  // whole pixels
      ASSERT_EQ(missing.at<unsigned char>(v, u), outside_px > 0.0 ? 255 : 0) << u << ", " << v;
    }
  }
}

TEST(MissingReturns, NothingAtAllIsMeasuredOutsideTheView) {
  // Neither "nothing within range" nor "too close", which would both be measurements.
  for (const double height : {0.1, 5.0}) {
    Scene scene = makeScene({0.0, 0.0, height}, {0.0, 0.0, 0.0});
    scene.sensor.min_range_m = 0.3;
    scene.sensor.max_range_m = 3.0;
    scene.sensor.border_left_px = 10;
    const cv::Mat depth = measureDepth(scene, 0);
    EXPECT_TRUE(std::isnan(depth.at<float>(60, 9)));
    EXPECT_EQ(depth.at<float>(60, 10), height > 1.0 ? kInfinity : -kInfinity);
    EXPECT_EQ(encodeDepth16(depth, 1000.0).at<std::uint16_t>(60, 9), 0);
  }
}

TEST(MissingReturns, StrengthOfAPlaneFollowsTheRangeEquation) {
  // The ground at several inclinations, against ray and normal in the scene frame.
  for (const double back : {0.0, 0.5, 2.0, 5.0}) {
    const Scene scene = makeScene({-back, 0.3, 1.0}, {0.0, 0.0, 0.0});
    const cv::Mat exact = renderDepth(scene, 0);
    const cv::Mat albedo(exact.size(), CV_32FC1, cv::Scalar(0.4));
    const cv::Mat strength = returnStrength(scene.camera, exact, albedo);
    for (int v = 0; v < exact.rows; ++v) {
      for (int u = 0; u < exact.cols; ++u) {
        const double z = exact.at<float>(v, u);
        if (!(z < 20.0)) continue;  // next to the horizon float depth has no slope
        const Eigen::Vector3d ray =
            scene.T_scene_camera[0].linear() * Eigen::Vector3d((u - scene.camera.cx_px) / scene.camera.fx_px * z,
                                                               (v - scene.camera.cy_px) / scene.camera.fy_px * z, z);
        const double expected = 0.4 * -ray.z() / ray.norm() / ray.squaredNorm();
        ASSERT_NEAR(strength.at<float>(v, u), expected, 2e-3 * expected) << u << ", " << v << " from " << back;
      }
    }
  }
}

TEST(MissingReturns, StrengthBesideAnEdgeIsThatOfThePixelsOwnSurface) {
  Scene scene = makeScene({0.0, 0.0, 1.0}, {0.0, 0.0, 0.0});
  scene.boxes = {makeBox(0, {0.0, 0.0, 0.2}, {0.1, 0.1, 0.2})};
  cv::Mat ids;
  const cv::Mat exact = renderDepth(scene, 0, &ids);
  const cv::Mat strength = returnStrength(scene.camera, exact, {});
  for (int v = 0; v < exact.rows; ++v) {
    for (int u = 0; u < exact.cols; ++u) {
      const double x = (u - scene.camera.cx_px) / scene.camera.fx_px;
      const double y = (v - scene.camera.cy_px) / scene.camera.fy_px;
      const double z = ids.at<int>(v, u) == 0 ? 0.6 : 1.0;  // both face the camera, so cos = z / range
      const double expected = 1.0 / (z * z * std::pow(1.0 + x * x + y * y, 1.5));
      ASSERT_NEAR(strength.at<float>(v, u), expected, 1e-3 * expected) << u << ", " << v;
    }
  }
}

TEST(MissingReturns, WeakSurfacesAreLostAndStrongOnesAreNot) {
  Scene scene = makeScene({-1.0, 0.0, 1.0}, {0.0, 0.0, 0.0}, 3);
  scene.sensor.min_return_per_m2 = 0.3;
  scene.sensor.return_flicker = 0.2;
  const cv::Mat strength = returnStrength(scene.camera, renderDepth(scene, 0), {});
  const cv::Mat missing[] = {missingOf(scene, 0), missingOf(scene, 1), missingOf(scene, 2)};
  int num_unsure = 0;
  int num_changing = 0;
  for (int v = 0; v < strength.rows; ++v) {
    for (int u = 0; u < strength.cols; ++u) {
      int num_missing = 0;
      for (const cv::Mat& image : missing) num_missing += image.at<unsigned char>(v, u) / 255;
      const float s = strength.at<float>(v, u);
      if (s == 0.0F) {
        ASSERT_EQ(num_missing, 0);  // no surface
      } else if (s * 1.2F < 0.3F) {
        ASSERT_EQ(num_missing, 3);
      } else if (s * 0.8F > 0.3F) {
        ASSERT_EQ(num_missing, 0);
      } else {
        ++num_unsure;
        num_changing += num_missing % 3 != 0 ? 1 : 0;
      }
    }
  }
  EXPECT_GT(num_unsure, 1000);
  EXPECT_GT(num_changing, num_unsure / 5);  // a strength in the middle of the band changes in 3 of 4 cases
  scene.sensor.return_flicker = 0.0;
  EXPECT_TRUE(isSame(missingOf(scene, 0), missingOf(scene, 1)));
}

TEST(MissingReturns, FlickersInPatches) {
  // A plane at the threshold everywhere: half is lost. Neighbours agree; pixels drawn one by one agree half of the time.
  Scene scene = makeScene({0.0, 0.0, 1.0}, {0.0, 0.0, 0.0});
  scene.camera.fx_px = scene.camera.fy_px = 2000.0;
  scene.sensor.min_return_per_m2 = 1.0;
  const cv::Mat missing = missingOf(scene);
  int num_missing = 0;
  int num_borders = 0;
  for (int v = 0; v < missing.rows; ++v) {
    for (int u = 1; u < missing.cols; ++u) {
      num_missing += missing.at<unsigned char>(v, u) / 255;
      num_borders += missing.at<unsigned char>(v, u) != missing.at<unsigned char>(v, u - 1) ? 1 : 0;
    }
  }
  const double total = static_cast<double>(missing.total());
  EXPECT_NEAR(num_missing / total, 0.5, 0.15);  // 150 independent patches
  EXPECT_LT(num_borders / total, 0.1);          // at most about one in a patch's 12 px
}

TEST(MissingReturns, DarkBoxIsLostAndTheOtherIsNot) {
  Scene scene = sceneWithAllDefects();
  scene.sensor = {};
  scene.sensor.min_return_per_m2 = 0.35;  // at 0.8 m facing: 1.5 and 0.45; sides at 60 degrees: half of that
  scene.boxes[1].albedo = 0.15;
  cv::Mat ids;
  const cv::Mat exact = renderDepth(scene, 0, &ids);
  const cv::Mat depth = applySensor(scene, 0, exact);
  EXPECT_EQ(cv::countNonZero((ids == 1) & (depth == depth)), 0);
  const int num_seen = cv::countNonZero((ids == 0) & (depth == depth));
  EXPECT_GT(num_seen, 0.95 * cv::countNonZero(ids == 0));
  // The same from an image whose albedo is given.
  cv::Mat albedo(exact.size(), CV_32FC1, cv::Scalar(1.0));
  albedo.setTo(0.15, ids == 1);
  EXPECT_TRUE(isSame(applySensor(scene.camera, scene.sensor, scene.seed, 0, exact, {}, albedo), depth));
}

TEST(MissingReturns, StripsLieBesideEdgesAndAreRagged) {
  Scene scene = makeScene({0.0, 0.0, 1.0}, {0.0, 0.0, 0.0}, 2);
  scene.boxes = {makeBox(0, {0.0, 0.0, 0.2}, {0.15, 0.15, 0.2})};
  scene.sensor.edge_loss_px = 4.0;
  cv::Mat ids;
  renderDepth(scene, 0, &ids);
  const cv::Mat missing = missingOf(scene);
  // Brute force: steps along u and v to the nearest pixel of the other surface. That one is 1 px from the edge's own.
  int widths = 0;
  int num_near = 0;
  int num_missing = 0;
  for (int v = 0; v < ids.rows; ++v) {
    for (int u = 0; u < ids.cols; ++u) {
      int distance = 100;
      for (int dv = -6; dv <= 6; ++dv) {
        for (int du = -6; du <= 6; ++du) {
          if (v + dv < 0 || v + dv >= ids.rows || u + du < 0 || u + du >= ids.cols) continue;
          if (ids.at<int>(v + dv, u + du) != ids.at<int>(v, u)) {
            distance = std::min(distance, std::abs(du) + std::abs(dv));
          }
        }
      }
      const bool is_missing = missing.at<unsigned char>(v, u) != 0;
      num_near += distance <= 4 ? 1 : 0;
      if (is_missing) {
        ASSERT_LE(distance, 4) << u << ", " << v;
        ++num_missing;
        widths |= 1 << distance;
      }
    }
  }
  EXPECT_EQ(widths, 0b11110);                                           // from 1 to 4 px, each somewhere
  EXPECT_NEAR(num_missing / static_cast<double>(num_near), 0.6, 0.15);  // uniform in (0, 4], rounded up: 2.5 of 4
  EXPECT_FALSE(isSame(missing, missingOf(scene, 1)));
}

TEST(MissingReturns, GrazingPlaneIsNoEdgeAndItsHorizonIs) {
  Scene scene = makeScene({0.0, 0.0, 0.5}, {5.0, 0.0, 0.3});
  scene.sensor.edge_loss_px = 4.0;
  const cv::Mat exact = renderDepth(scene, 0);
  const cv::Mat missing = missingOf(scene);
  // At z a row is z^2 / (135 px 0.5 m): more than edge_threshold_m from 1.8 m, more than 5 % of z from 3.4 m. The strip
  // reaches 3 rows nearer, to 2.9 m.
  EXPECT_EQ(cv::countNonZero(missing & (exact < 2.8F)), 0);
  EXPECT_GT(cv::countNonZero(missing), missing.cols / 2);
}

TEST(MissingReturns, SameSeedSameImageAndOtherSeedOtherImage) {
  for (const bool has_strips : {false, true}) {
    Scene scene = makeScene({-1.0, 0.0, 1.0}, {0.0, 0.0, 0.0}, 2);
    scene.boxes = {makeBox(0, {0.0, 0.0, 0.2}, {0.15, 0.15, 0.2})};
    (has_strips ? scene.sensor.edge_loss_px : scene.sensor.min_return_per_m2) = has_strips ? 3.0 : 0.3;
    const cv::Mat first = missingOf(scene);
    EXPECT_TRUE(isSame(missingOf(scene), first));
    EXPECT_FALSE(isSame(missingOf(scene, 1), first)) << "strips: " << has_strips;
    scene.seed += 1;
    EXPECT_FALSE(isSame(missingOf(scene), first)) << "strips: " << has_strips;
  }
}

TEST(MissingReturns, LeaveTheOtherPixelsAsTheyWere) {
  Scene scene = sceneWithAllDefects();
  scene.sensor.axial_noise_a_m = 0.002;
  scene.sensor.dropout_probability = 0.1;
  Scene without = scene;
  without.sensor = {};
  without.sensor.axial_noise_a_m = 0.002;
  without.sensor.dropout_probability = 0.1;
  const cv::Mat depth = measureDepth(scene, 0);
  const cv::Mat reference = measureDepth(without, 0);
  EXPECT_EQ(cv::countNonZero((depth == depth) & (depth != reference)), 0);
  EXPECT_GT(cv::countNonZero(~(depth == depth) & (reference == reference)), 1000);
}

TEST(MissingReturns, AreNoneInAnIdealSensor) {
  Scene scene = sceneWithAllDefects();
  ASSERT_FALSE(missingOf(scene).empty());
  scene.sensor = scene.sensor.withoutNoise();
  EXPECT_TRUE(missingOf(scene).empty());
  EXPECT_TRUE(isSame(measureDepth(scene, 0), renderDepth(scene, 0)));
}

TEST(MissingReturns, RefuseBadParametersWithValueAndRange) {
  SensorModel sensor;
  sensor.border_right_px = 320;
  sensor.border_bottom_px = -1;
  sensor.min_return_per_m2 = std::numeric_limits<double>::quiet_NaN();
  sensor.return_flicker = 1.5;
  sensor.edge_loss_px = 21.0;
  const std::vector<std::string> expected{"sensor/border_right_px = 320 px, must be in [0, 319] px",
                                          "sensor/border_bottom_px = -1 px, must be in [0, 239] px",
                                          "sensor/min_return_per_m2 = nan 1/m^2, must be in [0, 100] 1/m^2",
                                          "sensor/return_flicker = 1.5, must be in [0, 1]",
                                          "sensor/edge_loss_px = 21 px, must be in [0, 20] px"};
  EXPECT_EQ(missingReturnProblems({}, sensor), expected);
  EXPECT_TRUE(missingReturnProblems({}, {}).empty());
  Scene scene = sceneWithAllDefects();
  EXPECT_TRUE(scene.validate().empty());
  scene.sensor.edge_loss_px = -1.0;
  scene.boxes[0].albedo = 1.1;
  EXPECT_EQ(scene.validate().size(), 2U);
  const cv::Mat exact = renderDepth(scene, 0);
  EXPECT_THROW(applySensor(scene.camera, {}, 1, 0, exact, {}, cv::Mat(10, 10, CV_32FC1)), std::invalid_argument);
}

}  // namespace
}  // namespace synthetic_depth
