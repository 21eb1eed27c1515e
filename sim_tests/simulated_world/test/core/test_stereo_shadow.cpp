// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/stereo_shadow.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <gtest/gtest.h>

#include "synthetic_depth/depth_renderer.h"
#include "synthetic_depth/sensor.h"
#include "synthetic_depth/testing/random_scene.h"

namespace simulated_world {
namespace {

using synthetic_depth::Scene;
using synthetic_depth::SeededRandom;

/// Boxes wider than the baseline, lying and leaning on the ground as in a pile.
Scene makePile(std::uint64_t seed) {
  SeededRandom random(seed);
  Scene scene = synthetic_depth::test::makeScene({1.5, 0.4, 1.0}, {0.0, 0.0, 0.1});
  scene.camera = {640, 480, 525.0, 525.0, 319.5, 239.5};
  scene.T_scene_camera = synthetic_depth::orbitPoses({1.5, 1.0, {0.0, 0.0, 0.1}, 1.0, random.uniform(0.0, 6.0), 3});
  for (int id = 0; id < 12; ++id) {
    const Eigen::Vector3d centre(random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5), random.uniform(0.0, 0.3));
    const Eigen::Vector3d turn(random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5), random.uniform(-3.0, 3.0));
    scene.boxes.push_back(synthetic_depth::test::makeBox(id, centre, {0.15, 0.1, 0.1}, turn));
  }
  return scene;
}

/// Shadow by casting every line of sight, and its number of left and right borders over all rows.
cv::Mat castShadows(Scene scene, int frame, double baseline_m, const cv::Mat& exact_m) {
  scene.sensor = {};
  scene.sensor.has_shadows = true;
  scene.sensor.baseline_m = baseline_m;
  const cv::Mat depth_m = synthetic_depth::applySensor(scene, frame, exact_m);
  cv::Mat mask(depth_m.size(), CV_8UC1);
  std::transform(depth_m.begin<float>(), depth_m.end<float>(), mask.begin<unsigned char>(),
                 [](float z) { return std::isnan(z) ? 255 : 0; });
  return mask;
}

int numBorders(const cv::Mat& mask) {
  int count = 0;
  for (int v = 0; v < mask.rows; ++v) {
    for (int u = 1; u < mask.cols; ++u) {
      count += mask.at<unsigned char>(v, u) != mask.at<unsigned char>(v, u - 1) ? 1 : 0;
    }
  }
  return count;
}

TEST(StereoShadow, AgreesWithCastLinesOfSightUpToTheBorderPixel) {
  constexpr double kBaseline_m = 0.06;
  int num_shadowed = 0;
  int num_borders = 0;
  int num_different = 0;
  int num_far_off = 0;
  for (const std::uint64_t seed : {1U, 2U, 3U, 4U}) {
    const Scene scene = makePile(seed);
    for (int frame = 0; frame < scene.numFrames(); ++frame) {
      const cv::Mat exact = synthetic_depth::renderDepth(scene, frame);
      const cv::Mat expected = castShadows(scene, frame, kBaseline_m, exact);
      const cv::Mat mask = stereoShadowMask(scene.camera, kBaseline_m, exact);
      ASSERT_EQ(mask.type(), CV_8UC1);
      num_shadowed += cv::countNonZero(expected);
      num_borders += numBorders(expected);
      for (int v = 0; v < mask.rows; ++v) {
        for (int u = 1; u + 1 < mask.cols; ++u) {
          const auto is = [v](const cv::Mat& image, int column) { return image.at<unsigned char>(v, column) != 0; };
          if (is(mask, u) != is(expected, u)) {
            ++num_different;
            num_far_off += is(mask, u) != is(expected, u - 1) && is(mask, u) != is(expected, u + 1) ? 1 : 0;
          }
        }
      }
    }
  }
  std::printf("%d shadowed, %d borders, %d different, %d of them farther than a pixel\n", num_shadowed, num_borders,
              num_different, num_far_off);
  ASSERT_GT(num_shadowed, 20000);
  // A border lies somewhere between two pixel centres, where only the image has samples: at worst one pixel each.
  EXPECT_LT(num_different, num_borders / 2);
  EXPECT_LT(num_far_off, 0.01 * num_shadowed);
}

TEST(StereoShadow, HasTheWidthOfTheParallax) {
  Scene scene = synthetic_depth::test::makeScene({0.0, 0.0, 1.2}, {0.0, 0.0, 0.0});
  scene.boxes.push_back(synthetic_depth::test::makeBox(0, {0.0, 0.0, 0.3}, {0.15, 0.15, 0.3}));
  const cv::Mat exact = synthetic_depth::renderDepth(scene, 0);
  const cv::Mat mask = stereoShadowMask(scene.camera, 0.25, exact);
  const double expected = scene.camera.fx_px * 0.25 * (1.0 / 0.6 - 1.0 / 1.2);
  EXPECT_NEAR(cv::countNonZero(mask.row(60)), expected, 1.0);  // whole pixels
  EXPECT_EQ(cv::countNonZero(mask.row(2)), 0);                 // above the box
}

TEST(StereoShadow, IsEmptyWithoutBaselineAndWhereNothingReturns) {
  const Scene scene = makePile(1);
  const cv::Mat exact = synthetic_depth::renderDepth(scene, 0);
  ASSERT_GT(cv::countNonZero(stereoShadowMask(scene.camera, 0.06, exact)), 0);
  EXPECT_EQ(cv::countNonZero(stereoShadowMask(scene.camera, 0.0, exact)), 0);
  cv::Mat half_empty = exact.clone();
  half_empty.colRange(0, 320).setTo(std::numeric_limits<float>::infinity());
  EXPECT_EQ(cv::countNonZero(stereoShadowMask(scene.camera, 0.06, half_empty).colRange(0, 320)), 0);
}

TEST(StereoShadow, RefusesAnotherImageOrANegativeBaseline) {
  const Scene scene = makePile(1);
  EXPECT_THROW(stereoShadowMask(scene.camera, 0.1, cv::Mat(10, 10, CV_32FC1)), std::invalid_argument);
  const cv::Mat exact(480, 640, CV_32FC1, cv::Scalar(1.0));
  EXPECT_THROW(stereoShadowMask(scene.camera, -0.1, exact), std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
