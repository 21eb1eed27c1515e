// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/rgbd_camera.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

#include "mjcf_of_scene.h"
#include "simulated_world/mujoco_model.h"
#include "synthetic_depth/depth_renderer.h"
#include "synthetic_depth/testing/random_scene.h"

namespace simulated_world {
namespace {

using test_support::messageOf;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// A scene in MuJoCo, ready to be looked at.
struct World {
  explicit World(const std::string& mjcf) : model(compileModel(mjcf)), data(makeData(*model)), renderer(*model) {
    mj_forward(model.get(), data.get());
  }

  ModelPtr model;
  DataPtr data;
  OffscreenRenderer renderer;
};

bool isSame(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && std::equal(a.datastart, a.dataend, b.datastart, b.dataend);
}

/// Random boxes seen from all around, up to 4 m away, through a lens whose centre is not the image's.
synthetic_depth::Scene sceneWithManyViews(std::uint64_t seed) {
  synthetic_depth::Scene scene = synthetic_depth::test::makeRandomScene(seed, 12, true);
  scene.camera = {320, 240, 260.0, 260.0, 153.25, 124.75};
  const Eigen::Vector3d target(0.0, 0.0, 0.15);
  scene.T_scene_camera = {
      synthetic_depth::lookAt({1.2, 0.3, 0.9}, target), synthetic_depth::lookAt({-0.9, 1.5, 1.3}, target),
      synthetic_depth::lookAt({0.0, 0.0, 2.5}, target), synthetic_depth::lookAt({2.2, -2.6, 1.9}, target)};
  // Any roll, too.
  scene.T_scene_camera[1] = scene.T_scene_camera[1] * Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitZ());
  return scene;
}

TEST(RgbdCamera, DepthAgreesWithTheAnalyticScene) {
  int num_surface = 0;
  int num_wrong = 0;
  std::vector<double> errors_m;
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    const synthetic_depth::Scene scene = sceneWithManyViews(seed);
    World world(test::mjcfOf(scene));
    for (int frame = 0; frame < scene.numFrames(); ++frame) {
      RgbdCameraConfig config;
      config.camera = scene.camera;
      RgbdCamera camera(world.renderer, "camera_" + std::to_string(frame), config);
      const cv::Mat rendered = camera.capture(*world.data, 0).exact_depth_m;
      cv::Mat ids;
      const cv::Mat exact = synthetic_depth::renderDepth(scene, frame, &ids);
      for (int v = 1; v + 1 < exact.rows; ++v) {
        for (int u = 1; u + 1 < exact.cols; ++u) {
          const cv::Rect around(u - 1, v - 1, 3, 3);
          const double z = rendered.at<float>(v, u);
          double low = 0.0;
          double high = 0.0;
          cv::minMaxLoc(exact(around), &low, &high);
          // Silhouettes within a pixel: no depth but what the scene has within a pixel, and nothing beyond far_m.
          const double tolerance_m = 0.001 + 2.0 * z * z / config.render.near_m / 0x1p24;  // steps of the depth buffer
          high = high > config.render.far_m ? kInfinity : high;
          num_wrong += z < low - tolerance_m || z > high + tolerance_m ? 1 : 0;
          const bool is_surface = cv::countNonZero(ids(around) == ids.at<int>(v, u)) == 9;
          if (is_surface && exact.at<float>(v, u) <= 4.0F) {
            ++num_surface;
            errors_m.push_back(std::abs(z - exact.at<float>(v, u)));
          }
        }
      }
    }
  }
  std::sort(errors_m.begin(), errors_m.end());
  const auto quantile = [&errors_m](double share) {
    return errors_m[static_cast<std::size_t>(share * static_cast<double>(errors_m.size() - 1))];
  };
  std::printf("%d pixels: median %.4f mm, 99.9 %% %.4f mm, largest %.4f mm; %d outside their neighbourhood\n",
              num_surface, 1e3 * quantile(0.5), 1e3 * quantile(0.999), 1e3 * quantile(1.0), num_wrong);
  ASSERT_GT(num_surface, 500000);
  // A step of the depth buffer is 0.1 mm at 4 m; on a surface at a grazing angle the rounding of its corners adds as much.
  EXPECT_LT(quantile(0.5), 0.00005);
  EXPECT_LT(quantile(1.0), 0.0005);
  EXPECT_EQ(num_wrong, 0);
}

TEST(RgbdCamera, ReportsThePoseOfItsOpticalFrame) {
  const synthetic_depth::Scene scene = sceneWithManyViews(1);
  World world(test::mjcfOf(scene));
  const RgbdCamera camera(world.renderer, "camera_1", {});
  EXPECT_TRUE(camera.opticalPose(*world.data).isApprox(scene.T_scene_camera[1], 1e-12));  // rounding
}

/// Red and green box before a background without returns, looked at from above; image up is +x, image right is -y.
constexpr const char* kTwoColours = R"(
<mujoco>
  <worldbody>
    <light pos="0 0 5" dir="0 0 -1"/>
    <geom type="box" size="0.1 0.1 0.1" pos="0.2 0.2 0.1" rgba="1 0 0 1" group="2"/>
    <geom type="box" size="0.1 0.1 0.1" pos="0.2 -0.2 0.1" rgba="0 1 0 1" group="2"/>
    <geom type="box" size="0.1 0.1 0.1" pos="-0.2 0 0.1" group="3"/>
    <body pos="0 0 1.2"><camera name="down" euler="0 0 -90"/></body>
  </worldbody>
</mujoco>)";

RgbdCameraConfig smallCamera() {
  RgbdCameraConfig config;
  config.camera = {160, 120, 150.0, 150.0, 79.5, 59.5};
  return config;
}

TEST(RgbdCamera, ShowsColoursAndDepthAtTheSamePixels) {
  World world(kTwoColours);
  RgbdCamera camera(world.renderer, "down", smallCamera());
  const RgbdCamera::Frame frame = camera.capture(*world.data, 0);
  // x right of the image is -y, up is +x: (0.2, 0.2) is left of and above the middle by 150 px/m * 0.2 m.
  const cv::Vec3b red = frame.rgb.at<cv::Vec3b>(30, 50);
  const cv::Vec3b green = frame.rgb.at<cv::Vec3b>(30, 110);
  EXPECT_GT(red[0], 100);
  EXPECT_LT(red[1], red[0] / 2);  // the rest is white highlight
  EXPECT_LT(red[2], red[0] / 2);
  EXPECT_LT(green[0], green[1] / 2);
  EXPECT_GT(green[1], 100);
  EXPECT_LT(green[2], green[1] / 2);
  for (int v = 0; v < frame.rgb.rows; ++v) {
    for (int u = 0; u < frame.rgb.cols; ++u) {
      ASSERT_EQ(frame.rgb.at<cv::Vec3b>(v, u) != cv::Vec3b(0, 0, 0),
                std::isfinite(frame.exact_depth_m.at<float>(v, u)));
    }
  }
}

TEST(RgbdCamera, HidesCollisionGeomsUnlessAsked) {
  World world(kTwoColours);
  RgbdCameraConfig config = smallCamera();
  const int v = 89;  // the middle of the box in group 3
  const int u = 79;
  EXPECT_EQ(RgbdCamera(world.renderer, "down", config).capture(*world.data, 0).depth_m.at<float>(v, u), kInfinity);
  config.render.shows_geom_group[3] = true;
  EXPECT_NEAR(RgbdCamera(world.renderer, "down", config).capture(*world.data, 0).depth_m.at<float>(v, u), 1.0, 1e-4);
}

TEST(RgbdCamera, NoiseIsFixedBySeedAndFrameNumber) {
  World world(kTwoColours);
  RgbdCameraConfig config = smallCamera();
  config.rgb_noise_std_grey = 3.0;
  config.sensor.axial_noise_a_m = 0.001;
  RgbdCamera camera(world.renderer, "down", config);
  const RgbdCamera::Frame first = camera.capture(*world.data, 7);
  const RgbdCamera::Frame other = camera.capture(*world.data, 8);
  const RgbdCamera::Frame again = camera.capture(*world.data, 7);
  EXPECT_TRUE(isSame(first.rgb, again.rgb));
  EXPECT_TRUE(isSame(first.depth_m, again.depth_m));
  EXPECT_FALSE(isSame(first.rgb, other.rgb));
  EXPECT_FALSE(isSame(first.depth_m, other.depth_m));
  EXPECT_TRUE(isSame(first.exact_depth_m, other.exact_depth_m));
  config.seed = 2;
  const RgbdCamera::Frame other_seed = RgbdCamera(world.renderer, "down", config).capture(*world.data, 7);
  EXPECT_FALSE(isSame(first.rgb, other_seed.rgb));
  EXPECT_FALSE(isSame(first.depth_m, other_seed.depth_m));
}

TEST(RgbdCamera, ColourNoiseHasTheStatedSigmaInEachChannel) {
  World world(R"(<mujoco><visual><headlight ambient="0.5 0.5 0.5" diffuse="0 0 0"/></visual><worldbody>
    <geom type="plane" size="0 0 1" rgba="1 0.8 0.6 1"/><camera name="down" pos="0 0 1"/></worldbody></mujoco>)");
  RgbdCameraConfig config = smallCamera();
  config.rgb_noise_std_grey = 4.0;
  RgbdCamera noisy(world.renderer, "down", config);
  config.rgb_noise_std_grey = 0.0;
  RgbdCamera clean(world.renderer, "down", config);
  cv::Mat difference;
  cv::subtract(noisy.capture(*world.data, 3).rgb, clean.capture(*world.data, 3).rgb, difference, cv::noArray(), CV_32F);
  cv::Scalar mean;
  cv::Scalar sigma;
  cv::meanStdDev(difference, mean, sigma);
  // Rounding to whole grey levels adds 1/12 to the variance; five standard errors over 19200 pixels.
  const double expected = std::sqrt(16.0 + 1.0 / 12.0);
  for (int channel = 0; channel < 3; ++channel) {
    EXPECT_NEAR(mean[channel], 0.0, 5.0 * expected / std::sqrt(19200.0));
    EXPECT_NEAR(sigma[channel], expected, 5.0 * expected / std::sqrt(2.0 * 19200.0));
  }
}

TEST(RgbdCamera, ExposureMultipliesAllColoursOfAnImage) {
  World world(R"(<mujoco><visual><headlight ambient="0.3 0.3 0.3" diffuse="0 0 0"/></visual><worldbody>
    <geom type="plane" size="0 0 1" rgba="1 0.8 0.6 1"/><camera name="down" pos="0 0 1"/></worldbody></mujoco>)");
  RgbdCameraConfig config = smallCamera();
  const cv::Scalar plain = cv::mean(RgbdCamera(world.renderer, "down", config).capture(*world.data, 0).rgb);
  config.exposure_std_stops = 0.3;
  RgbdCamera camera(world.renderer, "down", config);
  double sum = 0.0;
  double square = 0.0;
  constexpr int kImages = 200;
  for (int frame = 0; frame < kImages; ++frame) {
    const cv::Scalar mean = cv::mean(camera.capture(*world.data, static_cast<std::uint64_t>(frame)).rgb);
    const double stops = std::log2(mean[1] / plain[1]);
    EXPECT_NEAR(std::log2(mean[0] / plain[0]), stops, 0.05);  // a grey level of some 60 is 0.02 stops
    sum += stops;
    square += stops * stops;
  }
  // Four standard errors.
  EXPECT_NEAR(sum / kImages, 0.0, 4.0 * 0.3 / std::sqrt(kImages));
  EXPECT_NEAR(std::sqrt(square / kImages), 0.3, 4.0 * 0.3 / std::sqrt(2.0 * kImages));
  EXPECT_TRUE(isSame(camera.capture(*world.data, 7).rgb, camera.capture(*world.data, 7).rgb));
}

TEST(RgbdCamera, BlurWidensAnEdgeByItsDeviation) {
  World world(kTwoColours);
  RgbdCameraConfig config = smallCamera();
  const cv::Mat sharp = RgbdCamera(world.renderer, "down", config).capture(*world.data, 0).rgb;
  config.rgb_blur_px = 2.0;
  const RgbdCamera::Frame blurred = RgbdCamera(world.renderer, "down", config).capture(*world.data, 0);
  const auto steepest = [](const cv::Mat& rgb) {
    int most = 0;
    for (int v = 0; v < rgb.rows; ++v) {
      for (int u = 0; u + 1 < rgb.cols; ++u) {
        most = std::max(most, std::abs(rgb.at<cv::Vec3b>(v, u)[0] - rgb.at<cv::Vec3b>(v, u + 1)[0]));
      }
    }
    return most;
  };
  // Of a step blurred by a Gaussian, the steepest pixel has 1 / (sqrt(2 pi) sigma) of it.
  EXPECT_NEAR(steepest(blurred.rgb), steepest(sharp) / (std::sqrt(2.0 * M_PI) * 2.0), 0.02 * steepest(sharp));
}

TEST(RgbdCamera, MarksWhatItsSensorCannotMeasure) {
  World world(kTwoColours);
  RgbdCameraConfig config = smallCamera();
  config.sensor.min_range_m = 1.05;
  EXPECT_EQ(RgbdCamera(world.renderer, "down", config).capture(*world.data, 0).depth_m.at<float>(30, 50), -kInfinity);
  config.sensor.min_range_m = 0.3;
  config.sensor.max_range_m = 0.9;
  EXPECT_EQ(RgbdCamera(world.renderer, "down", config).capture(*world.data, 0).depth_m.at<float>(30, 50), kInfinity);
  config.sensor.max_range_m = 3.0;
  EXPECT_NEAR(RgbdCamera(world.renderer, "down", config).capture(*world.data, 0).depth_m.at<float>(30, 50), 1.0, 1e-4);
  config.sensor.dropout_probability = 1.0;
  EXPECT_TRUE(std::isnan(RgbdCamera(world.renderer, "down", config).capture(*world.data, 0).depth_m.at<float>(30, 50)));
}

TEST(RgbdCamera, CastsShadowsToTheLeftOfNearThings) {
  synthetic_depth::Scene scene = synthetic_depth::test::makeScene({0.0, 0.0, 1.2}, {0.0, 0.0, 0.0});
  scene.boxes.push_back(synthetic_depth::test::makeBox(0, {0.0, 0.0, 0.3}, {0.15, 0.15, 0.3}));
  World world(test::mjcfOf(scene));
  RgbdCameraConfig config = smallCamera();
  config.sensor.baseline_m = 0.1;
  config.sensor.has_shadows = true;
  RgbdCamera camera(world.renderer, "camera_0", config);
  const RgbdCamera::Frame frame = camera.capture(*world.data, 0);
  // The top's left border is at 79.5 - 150 * 0.15 / 0.6 = 42 px; the shadow is f B (1 / 0.6 - 1 / 1.2) = 12.5 px wide.
  int num_shadowed = 0;
  for (int u = 0; u < frame.depth_m.cols; ++u) {
    if (std::isnan(frame.depth_m.at<float>(60, u))) {
      ++num_shadowed;
      EXPECT_GE(u, 42 - 13);
      EXPECT_LE(u, 42);
    }
  }
  EXPECT_NEAR(num_shadowed, 12.5, 1.0);  // whole pixels
}

TEST(RgbdCamera, LosesGeomsOfDarkColourOrMaterial) {
  World world(R"(<mujoco><asset><material name="black" rgba="0.05 0.05 0.05 1"/></asset><worldbody>
    <geom type="box" size="0.1 0.1 0.1" pos="0 0.3 0.1" rgba="1 1 1 1" material="black"/>
    <geom type="box" size="0.1 0.1 0.1" pos="0 0 0.1" rgba="0.05 0.05 0.05 1"/>
    <geom type="box" size="0.1 0.1 0.1" pos="0 -0.3 0.1" material="black"/>
    <body pos="0 0 1.2"><camera name="down" euler="0 0 -90"/></body></worldbody></mujoco>)");
  RgbdCameraConfig config = smallCamera();
  config.sensor.min_return_per_m2 = 0.1;  // 1 m away: 1 and 0.05
  const cv::Mat depth = RgbdCamera(world.renderer, "down", config).capture(*world.data, 0).depth_m;
  // 150 px/m; the image's right is -y.
  EXPECT_NEAR(depth.at<float>(60, 80 - 45), 1.0, 1e-4);
  EXPECT_TRUE(std::isnan(depth.at<float>(60, 80)));
  EXPECT_TRUE(std::isnan(depth.at<float>(60, 80 + 45)));
  EXPECT_EQ(depth.at<float>(5, 80), kInfinity);
}

TEST(RgbdCamera, RefusesAnImpossibleConfig) {
  World world(kTwoColours);
  RgbdCameraConfig config = smallCamera();
  config.camera.fy_px = 151.0;
  config.sensor.max_range_m = -1.0;
  config.sensor.has_shadows = true;
  config.sensor.border_left_px = 80;
  config.sensor.edge_loss_px = -1.0;
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { RgbdCamera(world.renderer, "down", config); }),
              AllOf(HasSubstr("down"), HasSubstr("camera/fy_px = 151"), HasSubstr("sensor/max_range_m = -1"),
                    HasSubstr("sensor/baseline_m must be above 0"),
                    HasSubstr("sensor/border_left_px = 80 px, must be in [0, 79] px"),
                    HasSubstr("sensor/edge_loss_px = -1 px")));
  EXPECT_THROW(RgbdCamera(world.renderer, "no such camera", smallCamera()), std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
