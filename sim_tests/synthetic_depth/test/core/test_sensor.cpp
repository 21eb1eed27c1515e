// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/sensor.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include <gtest/gtest.h>

#include "synthetic_depth/depth_renderer.h"
#include "synthetic_depth/scene_loader.h"
#include "synthetic_depth/seeded_random.h"
#include "synthetic_depth/testing/random_scene.h"

namespace synthetic_depth {
namespace {

using test::makeBox;
using test::makeScene;

constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// Bitwise comparison, so that NaN equals NaN.
bool isSame(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && std::equal(a.begin<int>(), a.end<int>(), b.begin<int>());
}

Scene lookDown(double height_m, int num_frames = 1) {
  return makeScene({0.0, 0.0, height_m}, {0.0, 0.0, 0.0}, num_frames);
}

struct Statistics {
  double mean{0.0};
  double sigma{0.0};
  double count{0.0};
};

Statistics statisticsOf(const cv::Mat& depth) {
  Statistics s;
  double sum_of_squares = 0.0;
  for (auto z = depth.begin<float>(); z != depth.end<float>(); ++z) {
    if (std::isfinite(*z)) {
      s.count += 1.0;
      s.mean += *z;
      sum_of_squares += static_cast<double>(*z) * *z;
    }
  }
  s.mean /= s.count;
  s.sigma = std::sqrt(sum_of_squares / s.count - s.mean * s.mean);
  return s;
}

TEST(Sensor, WithEveryEffectOffChangesNothing) {
  const Scene scene = test::makeRandomScene(3, 10, false);
  const cv::Mat exact = renderDepth(scene, 0);
  EXPECT_TRUE(isSame(applySensor(scene, 0, exact), exact));
}

TEST(Sensor, AxialNoiseHasTheStatedSigmaAtEachDepth) {
  for (const double height : {0.5, 1.0, 2.0, 3.0}) {
    Scene scene = lookDown(height);
    scene.camera = {320, 240, 260.0, 260.0, 159.5, 119.5};
    scene.sensor.axial_noise_a_m = 0.0004;
    scene.sensor.axial_noise_b = -0.0002;
    scene.sensor.axial_noise_c_per_m = 0.0015;
    const double sigma = 0.0004 - 0.0002 * height + 0.0015 * height * height;
    const Statistics s = statisticsOf(measureDepth(scene, 0));
    ASSERT_EQ(s.count, 320.0 * 240.0);
    // Five standard errors of mean and of sigma over 76800 pixels.
    EXPECT_NEAR(s.mean, height, 5.0 * sigma / std::sqrt(s.count));
    EXPECT_NEAR(s.sigma, sigma, 5.0 * sigma / std::sqrt(2.0 * s.count));
  }
}

TEST(Sensor, DrawsArePairsOfThePixelsOwnStream) {
  // The slow way, one pixel after another: the first pair is the jitter's, the second one the axial noise's.
  const int frame = 1;
  Scene scene = lookDown(2.0, 2);
  scene.camera = {101, 50, 90.0, 90.0, 50.0, 24.5};  // rows are no multiple of what a thread takes at a time
  scene.sensor.axial_noise_c_per_m = 0.002;
  const cv::Mat exact = renderDepth(scene, frame);
  const cv::Mat measured = applySensor(scene, frame, exact);
  for (int v = 0; v < exact.rows; ++v) {
    for (int u = 0; u < exact.cols; ++u) {
      SeededRandom random(scene.seed, frame, static_cast<std::uint64_t>(v * exact.cols + u));
      double axial = 0.0;
      double unused = 0.0;
      random.normalPair(axial, unused);
      random.normalPair(axial, unused);
      const double z = exact.at<float>(v, u);
      ASSERT_EQ(measured.at<float>(v, u), static_cast<float>(z + axialSigma(scene.sensor, z) * axial))
          << "at " << u << ", " << v;
    }
  }
}

TEST(Sensor, AxialNoiseIsIndependentBetweenNeighboursAndFrames) {
  Scene scene = lookDown(1.0, 2);
  scene.sensor.axial_noise_a_m = 0.001;
  const cv::Mat first = measureDepth(scene, 0);
  const cv::Mat second = measureDepth(scene, 1);
  double neighbours = 0.0;
  double frames = 0.0;
  for (int v = 0; v < first.rows; ++v) {
    for (int u = 0; u + 1 < first.cols; ++u) {
      const double here = (first.at<float>(v, u) - 1.0) / 0.001;
      neighbours += here * (first.at<float>(v, u + 1) - 1.0) / 0.001;
      frames += here * (second.at<float>(v, u) - 1.0) / 0.001;
    }
  }
  const double count = first.rows * (first.cols - 1.0);
  EXPECT_LT(std::abs(neighbours / count), 5.0 / std::sqrt(count));
  EXPECT_LT(std::abs(frames / count), 5.0 / std::sqrt(count));
}

TEST(Sensor, SameSeedSameImageAndOtherSeedOtherImage) {
  Scene scene = loadScene(std::string(SYNTHETIC_DEPTH_SCENES) + "/demo_pile.yaml");
  const cv::Mat first = measureDepth(scene, 5);
  measureDepth(scene, 6);  // what is made in between must not matter
  EXPECT_TRUE(isSame(measureDepth(scene, 5), first));
  scene.seed += 1;
  EXPECT_FALSE(isSame(measureDepth(scene, 5), first));
}

TEST(Sensor, SwitchingOneEffectLeavesTheDrawsOfTheOthers) {
  Scene scene = lookDown(1.0);
  scene.sensor.axial_noise_a_m = 0.002;
  const cv::Mat without_dropout = measureDepth(scene, 0);
  scene.sensor.dropout_probability = 0.3;
  const cv::Mat with_dropout = measureDepth(scene, 0);
  for (int v = 0; v < with_dropout.rows; ++v) {
    for (int u = 0; u < with_dropout.cols; ++u) {
      if (!std::isnan(with_dropout.at<float>(v, u))) {
        ASSERT_EQ(with_dropout.at<float>(v, u), without_dropout.at<float>(v, u));
      }
    }
  }
}

TEST(Sensor, ShadowHasTheWidthOfTheBaselinesParallax) {
  // f B (1 / z_near - 1 / z_far) = 35 px, left of the box: the second viewpoint is to the right.
  const Scene scene = loadScene(std::string(SYNTHETIC_DEPTH_SCENES) + "/shadow.yaml");
  cv::Mat ids;
  const cv::Mat exact = renderDepth(scene, 0, &ids);
  const cv::Mat depth = applySensor(scene, 0, exact);
  const double expected = scene.camera.fx_px * scene.sensor.baseline_m * (1.0 / 0.6 - 1.0 / 1.2);
  int num_rows = 0;
  for (int v = 0; v < depth.rows; ++v) {
    int first_box = -1;
    for (int u = 0; u < depth.cols && first_box < 0; ++u) {
      first_box = ids.at<int>(v, u) == 0 ? u : -1;
    }
    int num_shadowed = 0;
    for (int u = 0; u < depth.cols; ++u) {
      if (std::isnan(depth.at<float>(v, u))) {
        ++num_shadowed;
        EXPECT_LT(u, first_box);
        EXPECT_GE(u, first_box - expected - 1.0);
      } else {
        EXPECT_EQ(depth.at<float>(v, u), exact.at<float>(v, u));
      }
    }
    if (first_box >= 0) {
      ++num_rows;
      EXPECT_NEAR(num_shadowed, expected, 1.0) << "row " << v;  // whole pixels
    } else {
      EXPECT_EQ(num_shadowed, 0) << "row " << v;
    }
  }
  EXPECT_NEAR(num_rows, 525.0 * 0.2 / 0.6, 1.0);
}

TEST(Sensor, ShadowIsExactlyWhatTheSecondViewpointCannotSee) {
  Scene scene = test::makeRandomScene(5, 10, true);
  scene.sensor.baseline_m = 0.3;
  scene.sensor.has_shadows = true;
  const cv::Mat depth = measureDepth(scene, 0);
  const cv::Mat exact = renderDepth(scene, 0);
  const Eigen::Isometry3d& T_scene_camera = scene.T_scene_camera[0];
  const Eigen::Vector3d second_eye = T_scene_camera * Eigen::Vector3d(0.3, 0.0, 0.0);
  int num_shadowed = 0;
  int num_doubtful = 0;
  for (int v = 0; v < depth.rows; v += 2) {
    for (int u = 0; u < depth.cols; u += 2) {
      const double z = exact.at<float>(v, u);
      if (!std::isfinite(z)) {
        continue;
      }
      const Eigen::Vector3d p = T_scene_camera * Eigen::Vector3d((u - scene.camera.cx_px) / scene.camera.fx_px * z,
                                                                 (v - scene.camera.cy_px) / scene.camera.fy_px * z, z);
      // March along the line of sight and look for solid matter; nothing of the renderer is used.
      bool is_blocked = false;
      for (double t = 0.0; t < 1.0 - 1e-3 && !is_blocked; t += 5e-4) {
        const Eigen::Vector3d q = second_eye + t * (p - second_eye);
        for (const Box& box : scene.boxes) {
          is_blocked =
              is_blocked ||
              ((box.T_scene_box.inverse(Eigen::Isometry) * q).cwiseAbs().array() < box.half_extents_m.array()).all();
        }
      }
      const bool is_shadowed = std::isnan(depth.at<float>(v, u));
      num_shadowed += is_shadowed ? 1 : 0;
      num_doubtful += is_shadowed != is_blocked ? 1 : 0;  // blocked over less than a step, or at its very end
    }
  }
  EXPECT_GT(num_shadowed, 100);
  EXPECT_LT(num_doubtful, 0.03 * num_shadowed);
}

TEST(Sensor, FlyingPixelsStandBetweenTheDepthsOfAnEdgeAndOnlyThere) {
  Scene scene = lookDown(1.0);
  scene.boxes.push_back(makeBox(0, {0.0, 0.0, 0.2}, {0.1, 0.1, 0.2}));
  const cv::Mat exact = renderDepth(scene, 0);
  scene.sensor.edge_mixing_fraction = 0.5;
  scene.sensor.edge_threshold_m = 0.05;
  const cv::Mat depth = measureDepth(scene, 0);
  int num_edge = 0;
  int num_flying = 0;
  for (int v = 1; v + 1 < depth.rows; ++v) {
    for (int u = 1; u + 1 < depth.cols; ++u) {
      float low = exact.at<float>(v, u);
      float high = low;
      for (const auto& [dv, du] : {std::pair<int, int>{0, 1}, {0, -1}, {1, 0}, {-1, 0}}) {
        low = std::min(low, exact.at<float>(v + dv, u + du));
        high = std::max(high, exact.at<float>(v + dv, u + du));
      }
      const float z = depth.at<float>(v, u);
      if (high - low <= 0.05F) {
        ASSERT_EQ(z, exact.at<float>(v, u));
      } else {
        ++num_edge;
        num_flying += z != exact.at<float>(v, u) ? 1 : 0;
        EXPECT_GE(z, low);
        EXPECT_LE(z, high);
      }
    }
  }
  ASSERT_GT(num_edge, 200);
  EXPECT_NEAR(num_flying / static_cast<double>(num_edge), 0.5, 5.0 * 0.5 / std::sqrt(num_edge));
}

TEST(Sensor, DropoutLosesTheStatedShare) {
  Scene scene = lookDown(1.0);
  scene.sensor.dropout_probability = 0.1;
  const cv::Mat depth = measureDepth(scene, 0);
  int num_lost = 0;
  for (auto z = depth.begin<float>(); z != depth.end<float>(); ++z) {
    num_lost += std::isnan(*z) ? 1 : 0;
  }
  const double count = static_cast<double>(depth.total());
  EXPECT_NEAR(num_lost / count, 0.1, 5.0 * std::sqrt(0.09 / count));
}

TEST(Sensor, LateralJitterMovesTheRayByTheStatedPixels) {
  // On a plane of slope 1 against the optical axis, shifting the ray by du changes the depth by a known amount.
  Scene scene = makeScene({-1.0, 0.0, 1.0}, {0.0, 0.0, 0.0});
  const cv::Mat exact = renderDepth(scene, 0);
  scene.sensor.lateral_jitter_px = 0.5;
  const cv::Mat depth = measureDepth(scene, 0);
  const auto row = static_cast<int>(std::lround(scene.camera.cy_px));
  double sum_of_squares = 0.0;
  for (int u = 0; u < depth.cols; ++u) {
    const double per_pixel = 0.5 * (exact.at<float>(row + 1, u) - exact.at<float>(row - 1, u));
    sum_of_squares += std::pow((depth.at<float>(row, u) - exact.at<float>(row, u)) / per_pixel, 2);
  }
  const double sigma_px = std::sqrt(sum_of_squares / depth.cols);
  EXPECT_NEAR(sigma_px, 0.5, 5.0 * 0.5 / std::sqrt(2.0 * depth.cols));
}

TEST(Sensor, DepthTakesWholeDisparitySteps) {
  Scene scene = makeScene({-1.0, 0.0, 1.0}, {0.0, 0.0, 0.0});
  scene.sensor.baseline_m = 0.05;
  scene.sensor.disparity_step_px = 0.125;
  const cv::Mat exact = renderDepth(scene, 0);
  const cv::Mat depth = applySensor(scene, 0, exact);
  std::set<long> steps;
  for (int v = 0; v < depth.rows; ++v) {
    for (int u = 0; u < depth.cols; ++u) {
      if (!std::isfinite(depth.at<float>(v, u))) {
        continue;
      }
      const double disparity = scene.camera.fx_px * 0.05 / depth.at<float>(v, u);
      const double in_steps = disparity / 0.125;
      ASSERT_NEAR(in_steps, std::round(in_steps), 1e-4);
      ASSERT_LE(std::abs(disparity - scene.camera.fx_px * 0.05 / exact.at<float>(v, u)), 0.5 * 0.125 + 1e-4);
      steps.insert(std::lround(in_steps));
    }
  }
  EXPECT_GT(steps.size(), 10U);
}

TEST(Sensor, RangeLimitsGiveSignedInfinities) {
  Scene scene = lookDown(1.0);
  scene.boxes.push_back(makeBox(0, {0.0, 0.0, 0.4}, {0.1, 0.1, 0.4}));
  scene.sensor.min_range_m = 0.3;
  scene.sensor.max_range_m = 0.9;
  cv::Mat ids;
  renderDepth(scene, 0, &ids);
  const cv::Mat depth = measureDepth(scene, 0);
  EXPECT_EQ(cv::countNonZero(depth == -kInfinity), cv::countNonZero((ids == 0) & (renderDepth(scene, 0) < 0.3F)));
  EXPECT_EQ(cv::countNonZero(depth == kInfinity), cv::countNonZero(ids == kGroundId));
  EXPECT_GT(cv::countNonZero(depth == -kInfinity), 0);
  EXPECT_GT(cv::countNonZero(depth == kInfinity), 0);
}

TEST(Sensor, AnImageWithItsShadowsGivesWhatItsSceneGives) {
  Scene scene = loadScene(std::string(SYNTHETIC_DEPTH_SCENES) + "/demo_pile.yaml");
  scene.sensor = SensorModel{0.4, 2.0, 0.001, 0.0002, 0.0015, 0.06, true, 0.1, 0.3, 0.05, 0.02, 0.0};
  const cv::Mat exact = renderDepth(scene, 5);
  const cv::Mat expected = applySensor(scene, 5, exact);
  SensorModel shadows_only;
  shadows_only.has_shadows = true;
  shadows_only.baseline_m = 0.06;
  Scene shadowed = scene;
  shadowed.sensor = shadows_only;
  const cv::Mat shadowed_m = applySensor(shadowed, 5, exact);
  cv::Mat mask(exact.size(), CV_8UC1);
  std::transform(shadowed_m.begin<float>(), shadowed_m.end<float>(), mask.begin<unsigned char>(),
                 [](float z) { return std::isnan(z) ? 255 : 0; });
  ASSERT_GT(cv::countNonZero(mask), 100);
  EXPECT_TRUE(isSame(applySensor(scene.camera, scene.sensor, scene.seed, 5, exact, mask), expected));
  EXPECT_FALSE(isSame(applySensor(scene.camera, scene.sensor, scene.seed, 5, exact, cv::Mat()), expected));
}

TEST(Sensor, JitteredRaysIntoAnImageMeetThePlanesTheyMeetInTheScene) {
  // A plane tilted in both directions fills the image; at the image's border there is no neighbour to interpolate with.
  Scene scene = makeScene({-0.3, 0.0, 1.0}, {0.0, 0.0, 0.0});
  scene.T_scene_camera[0] = scene.T_scene_camera[0] * Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitZ());
  scene.sensor.lateral_jitter_px = 0.5;
  const cv::Mat exact = renderDepth(scene, 0);
  const cv::Mat expected = applySensor(scene, 0, exact);
  const cv::Mat measured = applySensor(scene.camera, scene.sensor, scene.seed, 0, exact, cv::Mat());
  cv::Mat difference;
  const cv::Rect inner(5, 5, exact.cols - 10, exact.rows - 10);
  cv::absdiff(measured(inner), expected(inner), difference);
  double largest = 0.0;
  cv::minMaxLoc(difference, nullptr, &largest);
  EXPECT_LT(largest, 1e-5);  // float depth at the four corners
  EXPECT_FALSE(isSame(measured, exact));
}

TEST(Sensor, RefusesAnImageOfAnotherSizeOrType) {
  const Scene scene = lookDown(1.0);
  EXPECT_THROW(applySensor(scene, 0, cv::Mat(10, 10, CV_32FC1)), std::invalid_argument);
  EXPECT_THROW(applySensor(scene, 0, cv::Mat(scene.camera.height_px, scene.camera.width_px, CV_16UC1)),
               std::invalid_argument);
  const cv::Mat exact = renderDepth(scene, 0);
  EXPECT_THROW(applySensor(scene.camera, scene.sensor, 1, 0, cv::Mat(10, 10, CV_32FC1), cv::Mat()),
               std::invalid_argument);
  EXPECT_THROW(applySensor(scene.camera, scene.sensor, 1, 0, exact, exact), std::invalid_argument);
}

TEST(DepthEncoding, RoundsToUnitsAndMakesInvalidZero) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const cv::Mat depth = (cv::Mat_<float>(1, 7) << 1.0F, 0.00011F, nan, kInfinity, -kInfinity, -1.0F, 13.2F);
  const cv::Mat units = encodeDepth16(depth, 5000.0);
  const cv::Mat expected =
      (cv::Mat_<std::uint16_t>(1, 7) << 5000, 1, 0, 0, 0, 0, 0);  // 13.2 m is more than 16 bits hold
  EXPECT_EQ(cv::countNonZero(units != expected), 0);
  const cv::Mat decoded = decodeDepth16(units, 5000.0);
  EXPECT_FLOAT_EQ(decoded.at<float>(0, 0), 1.0F);
  EXPECT_FLOAT_EQ(decoded.at<float>(0, 1), 0.0002F);
  EXPECT_TRUE(std::isnan(decoded.at<float>(0, 2)));
}

}  // namespace
}  // namespace synthetic_depth
