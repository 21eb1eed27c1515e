// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/depth_plane.h"

#include <cmath>
#include <functional>
#include <limits>

#include <gmock/gmock.h>

#include "support/brick_scene.h"

namespace brick_detection {
namespace {

using testing::HasSubstr;
using testing::SizeIs;
using Quad = std::array<Eigen::Vector2d, 4>;

constexpr float kNothing = 0.0f;

Quad square(const Eigen::Vector2d& middle_px, double side_px) {
  const double h = 0.5 * side_px;
  return {middle_px + Eigen::Vector2d(-h, -h), middle_px + Eigen::Vector2d(h, -h), middle_px + Eigen::Vector2d(h, h),
          middle_px + Eigen::Vector2d(-h, h)};
}

/// A plane by its normal towards the camera and its depth at a pixel.
struct Truth {
  Eigen::Vector3d normal;
  double d_m;
};
Truth planeThrough(const Eigen::Vector2d& pixel, double depth_m, const Eigen::Vector3d& normal,
                   const CameraModel& camera) {
  return {normal.normalized(), -depth_m * normal.normalized().dot(camera.bearing(pixel).homogeneous())};
}

constexpr double kAll_px = 1e4;

/// Depth up to `reach_px` from the image's middle, and nothing elsewhere: to render all takes its time.
cv::Mat render(const CameraModel& camera, const std::function<double(const Eigen::Vector2d&, int, int)>& depth,
               double reach_px = kAll_px) {
  cv::Mat image(camera.height_px, camera.width_px, CV_32FC1, cv::Scalar(kNothing));
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      if (std::max(std::abs(u - 320), std::abs(v - 240)) > reach_px) continue;
      image.at<float>(v, u) = static_cast<float>(depth(camera.bearing(Eigen::Vector2d(u, v)), u, v));
    }
  }
  return image;
}

cv::Mat render(const CameraModel& camera, const Truth& plane, double reach_px = kAll_px) {
  const auto depth = [&plane](const Eigen::Vector2d& bearing, int, int) {
    return -plane.d_m / plane.normal.dot(bearing.homogeneous());
  };
  return render(camera, depth, reach_px);
}

double angleBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

/// The true plane against the fitted one, as its covariance has it.
Eigen::Vector3d errorOf(const DepthPlane& plane, const Truth& truth) {
  return {-truth.normal.dot(plane.axis_v), truth.normal.dot(plane.axis_u),
          -(truth.normal.dot(plane.middle) + truth.d_m) / truth.normal.dot(plane.normal)};
}

DepthPlaneFailure failureOf(const cv::Mat& depth_m, const CameraModel& camera, const Quad& quad) {
  DepthPlaneFailure failure = DepthPlaneFailure::kNone;
  const bool has_plane = fitDepthPlane(depth_m, camera, quad, DepthPlaneConfig(), &failure).has_value();
  EXPECT_EQ(has_plane, failure == DepthPlaneFailure::kNone);
  return failure;
}

TEST(DepthPlane, IsExactForExactDepth) {
  const CameraModel camera = testCamera();
  for (const double depth_m : {0.4, 1.0, 2.5}) {
    for (const double side_px : {20.0, 60.0, 200.0}) {
      for (const double tilt : {0.0, 0.8, 2.5}) {  // tangent of the angle to the optical axis
        const Eigen::Vector2d middle_px(310.3, 260.7);
        const Truth truth = planeThrough(middle_px, depth_m, {tilt, -0.3 * tilt, -1.0}, camera);
        const auto plane = fitDepthPlane(render(camera, truth, 30.0 + side_px), camera, square(middle_px, side_px), {});
        ASSERT_TRUE(plane) << depth_m << " m, " << side_px << " px, " << tilt;
        // Floats hold depth to 6e-8; the quadrangle's size takes a share of it.
        EXPECT_LT(angleBetween(plane->normal, truth.normal), 1e-5);
        EXPECT_NEAR(plane->d_m, truth.d_m, 1e-6 * depth_m);
        EXPECT_NEAR(plane->normal.dot(plane->middle) + plane->d_m, 0.0, 1e-9);
        EXPECT_LT((plane->middle.hnormalized() - camera.bearing(middle_px)).norm(), 1e-6);
        EXPECT_NEAR(plane->normal.norm(), 1.0, 1e-12);
        EXPECT_GT(plane->d_m, 0.0);
        EXPECT_LT((plane->axis_u.cross(plane->axis_v) - plane->normal).norm(), 1e-12);
        EXPECT_LT(plane->rms_m, 1e-6 * depth_m);
      }
    }
  }
}

TEST(DepthPlane, TakesTheLensIntoAccount) {
  CameraModel camera = testCamera();
  camera.distortion = Distortion::kPlumbBob;
  camera.coefficients = {0.25, -0.3, 0.002, -0.001, 0.0};
  const Eigen::Vector2d middle_px(530.3, 390.7);  // where the lens bends most
  for (const double side_px : {20.0, 60.0, 120.0}) {
    const Truth truth = planeThrough(middle_px, 1.0, {1.0, -0.3, -1.0}, camera);
    const double reach_px = 0.6 * side_px + 2.0;
    cv::Mat depth_m(camera.height_px, camera.width_px, CV_32FC1, cv::Scalar(kNothing));
    for (int v = static_cast<int>(middle_px.y() - reach_px); v < middle_px.y() + reach_px && v < depth_m.rows; ++v) {
      for (int u = static_cast<int>(middle_px.x() - reach_px); u < middle_px.x() + reach_px && u < depth_m.cols; ++u) {
        depth_m.at<float>(v, u) =
            static_cast<float>(-truth.d_m / truth.normal.dot(camera.bearing(Eigen::Vector2d(u, v)).homogeneous()));
      }
    }
    const auto plane = fitDepthPlane(depth_m, camera, square(middle_px, side_px), {});
    ASSERT_TRUE(plane) << side_px;
    // A tenth of a pixel of interpolation over the tag's side at most; taken for a pinhole's, it is 0.05 rad and more.
    EXPECT_LT(angleBetween(plane->normal, truth.normal), 2e-3) << side_px;
    EXPECT_LT(std::abs(errorOf(*plane, truth).z()), 1e-4) << side_px;
  }
}

TEST(DepthPlane, MiddleIsThatOfTheSquareAndNotOfTheImage) {
  // In perspective the square's middle is seen where the diagonals meet, away from the mean of the corners.
  const CameraModel camera = testCamera();
  const Eigen::Isometry3d T_camera_tag =
      makePose({0.05, 0.0, 0.5}, {M_PI, 0.0, 0.0}) * Eigen::AngleAxisd(1.0, Eigen::Vector3d::UnitY());
  const auto corners = observe(0, 0.12, T_camera_tag, camera).corners_px;
  const Eigen::Vector3d normal = T_camera_tag.linear().col(2);
  const Truth truth{normal, -normal.dot(T_camera_tag.translation())};
  const auto plane = fitDepthPlane(render(camera, truth), camera, corners, {});
  ASSERT_TRUE(plane);
  EXPECT_LT((plane->middle - T_camera_tag.translation()).norm(), 1e-5);  // a float's depth
}

/// Mean squared error of the plane, normalised by the covariance, over many noisy images.
double meanNormalisedError(double side_px, double tilt, const DepthPlaneConfig& config, bool has_systematic) {
  const CameraModel camera = testCamera();
  const Eigen::Vector2d middle_px(300.0, 220.0);
  const Quad quad = square(middle_px, side_px);
  constexpr double kDepth_m = 1.2;
  std::mt19937 engine(11);
  std::normal_distribution<double> normal;
  double sum = 0.0;
  constexpr int kTrials = 200;
  const Truth truth = planeThrough(middle_px, kDepth_m, {tilt, 0.2, -1.0}, camera);
  for (int i = 0; i < kTrials; ++i) {
    Truth shown = truth;
    if (has_systematic) {
      const Eigen::Vector3d u = truth.normal.unitOrthogonal();
      const Eigen::Vector3d n =
          truth.normal + config.systematic_rad * (normal(engine) * u + normal(engine) * truth.normal.cross(u));
      shown = planeThrough(middle_px, kDepth_m * (1.0 + config.systematic_m * normal(engine)), n, camera);
    }
    cv::Mat depth_m = render(camera, shown, 30.0 + 0.6 * side_px);
    addDepthNoise(config.inverse_depth_std, static_cast<int>(config.correlation_px), 1.0, engine, &depth_m);
    const auto plane = fitDepthPlane(depth_m, camera, quad, config);
    if (!plane) {
      ADD_FAILURE() << "no plane in trial " << i;
      return 0.0;
    }
    const Eigen::Vector3d error = errorOf(*plane, truth);
    sum += error.dot(plane->covariance.ldlt().solve(error));
  }
  return sum / kTrials;
}

// A mean over 200 of chi-squares with three degrees of freedom has a standard deviation of sqrt(6 / 200) = 0.17: four of
// them upwards. A small quadrangle cuts most of the noise's patches, which makes it less alike than the covariance takes
// it for: a quarter less error, hence the lower bound.
constexpr double kLeastError = 2.0;
constexpr double kMostError = 3.7;

TEST(DepthPlane, CovarianceIsHonestAboutNoise) {
  DepthPlaneConfig config;
  config.systematic_m = 1e-6;
  config.systematic_rad = 1e-6;
  for (const double side_px : {30.0, 60.0, 200.0}) {
    for (const double tilt : {0.0, 1.0}) {
      const double error = meanNormalisedError(side_px, tilt, config, false);
      EXPECT_GT(error, kLeastError) << side_px << " px, " << tilt;
      EXPECT_LT(error, kMostError) << side_px << " px, " << tilt;
    }
  }
}

TEST(DepthPlane, CovarianceIsHonestAboutNoiseAndWhatNoAveragingRemoves) {
  for (const double side_px : {30.0, 200.0}) {
    for (const double tilt : {0.0, 1.0}) {
      const double error = meanNormalisedError(side_px, tilt, DepthPlaneConfig(), true);
      EXPECT_GT(error, kLeastError) << side_px << " px, " << tilt;
      EXPECT_LT(error, kMostError) << side_px << " px, " << tilt;
    }
  }
}

TEST(DepthPlane, NoNumberOfPixelsRemovesTheSystematicPart) {
  const CameraModel camera = testCamera();
  const Eigen::Vector2d middle_px(320.0, 240.0);
  const Truth truth = planeThrough(middle_px, 2.0, {0.0, 0.0, -1.0}, camera);
  const DepthPlaneConfig config;
  const auto plane = fitDepthPlane(render(camera, truth), camera, square(middle_px, 400.0), config);
  ASSERT_TRUE(plane);
  EXPECT_NEAR(plane->shared_offset_m, 2.0 * config.systematic_m, 1e-5);
  EXPECT_GE(plane->covariance(2, 2), std::pow(plane->shared_offset_m, 2));
  EXPECT_GE(plane->covariance(0, 0), std::pow(config.systematic_rad, 2));
  EXPECT_GE(plane->covariance(1, 1), std::pow(config.systematic_rad, 2));
}

TEST(DepthPlane, IsBelievedLessWhenThePixelsScatterMoreThanTheConfigSays) {
  const CameraModel camera = testCamera();
  const Quad quad = square({320.0, 240.0}, 40.0);
  DepthPlaneConfig config;
  config.systematic_m = 1e-6;
  const Truth truth = planeThrough({320.0, 240.0}, 1.0, {0.0, 0.0, -1.0}, camera);
  const auto varianceAt = [&](double noise) {
    std::mt19937 engine(4);
    cv::Mat depth_m = render(camera, truth);
    addDepthNoise(noise, 1, 1.0, engine, &depth_m);
    const auto plane = fitDepthPlane(depth_m, camera, quad, config);
    EXPECT_TRUE(plane) << noise;
    return plane ? plane->covariance(2, 2) : 0.0;
  };
  // 1.69 as much, less what is beyond three standard deviations and left out.
  EXPECT_GT(varianceAt(1.3 * config.inverse_depth_std), 1.2 * varianceAt(0.1 * config.inverse_depth_std));
}

TEST(DepthPlane, LeavesOutMixedPixelsAtTheBorder) {
  // Round the tag's plate the wall behind begins, with a ring of depths in between.
  const CameraModel camera = testCamera();
  const Eigen::Vector2d middle_px(320.0, 240.0);
  const Truth truth = planeThrough(middle_px, 1.0, {0.4, 0.2, -1.0}, camera);
  std::mt19937 engine(6);
  std::uniform_real_distribution<double> mix(0.0, 1.0);
  cv::Mat depth_m = render(camera, [&](const Eigen::Vector2d& bearing, int u, int v) {
    const double on_plane = -truth.d_m / truth.normal.dot(bearing.homogeneous());
    const double off_px = std::max(std::abs(u - middle_px.x()), std::abs(v - middle_px.y()));
    if (off_px < 30.0) return on_plane;
    return off_px < 33.0 ? on_plane + mix(engine) * (2.0 - on_plane) : 2.0;
  });
  const auto plane = fitDepthPlane(depth_m, camera, square(middle_px, 60.0), {});  // grown to 69 px
  ASSERT_TRUE(plane);
  // Mixed pixels nearer than three standard deviations (9 mm of 1 m) stay in: one percent of all at most.
  EXPECT_LT(angleBetween(plane->normal, truth.normal), 0.01);
  EXPECT_LT(std::abs(errorOf(*plane, truth).z()), 0.0005);
}

TEST(DepthPlane, LeavesOutWhatStandsBeforeThePlane) {
  const CameraModel camera = testCamera();
  const Eigen::Vector2d middle_px(320.0, 240.0);
  const Truth truth = planeThrough(middle_px, 1.0, {0.4, 0.2, -1.0}, camera);
  const auto withBar = [&](double share) {
    return render(camera, [&](const Eigen::Vector2d& bearing, int u, int) {
      const double left_px = middle_px.x() - 34.5;
      return u < left_px + share * 69.0 ? 0.7 : -truth.d_m / truth.normal.dot(bearing.homogeneous());
    });
  };
  const auto plane = fitDepthPlane(withBar(0.25), camera, square(middle_px, 60.0), {});
  ASSERT_TRUE(plane);
  EXPECT_LT(angleBetween(plane->normal, truth.normal), 1e-4);  // no bar pixel is within the tolerance
  EXPECT_EQ(failureOf(withBar(0.45), camera, square(middle_px, 60.0)), DepthPlaneFailure::kNotFlat);
}

TEST(DepthPlane, FillsNoHoles) {
  const CameraModel camera = testCamera();
  const Eigen::Vector2d middle_px(320.0, 240.0);
  const Quad quad = square(middle_px, 60.0);
  const Truth truth = planeThrough(middle_px, 1.0, {0.4, 0.2, -1.0}, camera);
  for (const float hole : {kNothing, -1.0f, std::numeric_limits<float>::quiet_NaN(),
                           std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity()}) {
    cv::Mat depth_m = render(camera, truth);
    depth_m(cv::Rect(280, 200, 30, 80)).setTo(hole);  // 25 of 70 columns
    const auto plane = fitDepthPlane(depth_m, camera, quad, {});
    ASSERT_TRUE(plane) << hole;
    EXPECT_LT(angleBetween(plane->normal, truth.normal), 1e-5) << hole;
    depth_m(cv::Rect(280, 200, 50, 80)).setTo(hole);  // 45 of 70
    EXPECT_EQ(failureOf(depth_m, camera, quad), DepthPlaneFailure::kTooFewPixels) << hole;
    depth_m.setTo(hole);
    EXPECT_EQ(failureOf(depth_m, camera, quad), DepthPlaneFailure::kNoDepth) << hole;
  }
  EXPECT_EQ(failureOf(cv::Mat(), camera, quad), DepthPlaneFailure::kNoDepth);
}

TEST(DepthPlane, IsNoneWhereTwoFacesMeet) {
  const CameraModel camera = testCamera();
  const Eigen::Vector2d middle_px(320.0, 240.0);
  for (const double noise : {0.0, 0.003}) {
    for (const double depth_m : {0.6, 1.0, 1.5}) {
      // A tag's 0.12 m, round the right angle between two faces, each seen at 45 degrees.
      cv::Mat image = render(camera, [&](const Eigen::Vector2d& bearing, int, int) {
        const double slope = bearing.x() > camera.bearing(middle_px).x() ? -1.0 : 1.0;
        return depth_m * (1.0 - slope * camera.bearing(middle_px).x()) / (1.0 + slope * bearing.x());
      });
      std::mt19937 engine(7);
      if (noise > 0.0) addDepthNoise(noise, 4, 1.0, engine, &image);
      EXPECT_EQ(failureOf(image, camera, square(middle_px, 0.12 * camera.fx_px / depth_m)), DepthPlaneFailure::kNotFlat)
          << depth_m << " m, noise " << noise;
    }
  }
}

TEST(DepthPlane, IsNoneOnAPipe) {
  const CameraModel camera = testCamera();
  const Eigen::Vector2d middle_px(camera.cx_px, camera.cy_px);
  constexpr double kRadius_m = 0.08;
  constexpr double kMiddle_m = 1.0;
  const cv::Mat image = render(camera, [&](const Eigen::Vector2d& bearing, int, int) {
    // (z x)^2 + (z - middle)^2 = radius^2
    const double a = 1.0 + bearing.x() * bearing.x();
    const double root = kMiddle_m * kMiddle_m - a * (kMiddle_m * kMiddle_m - kRadius_m * kRadius_m);
    return root > 0.0 ? (kMiddle_m - std::sqrt(root)) / a : 0.0;
  });
  EXPECT_EQ(failureOf(image, camera, square(middle_px, 70.0)), DepthPlaneFailure::kNotFlat);
}

TEST(DepthPlane, NeedsEnoughPixelsInTheImage) {
  const CameraModel camera = testCamera();
  const cv::Mat depth_m = render(camera, planeThrough({320.0, 240.0}, 1.0, {0.0, 0.0, -1.0}, camera));
  EXPECT_EQ(failureOf(depth_m, camera, square({320.0, 240.0}, 6.0)), DepthPlaneFailure::kTooFewPixels);  // 7 x 7
  EXPECT_EQ(failureOf(depth_m, camera, square({-100.0, 240.0}, 60.0)), DepthPlaneFailure::kTooFewPixels);
  EXPECT_EQ(failureOf(depth_m, camera, square({1e6, -1e6}, 60.0)), DepthPlaneFailure::kTooFewPixels);
  EXPECT_EQ(failureOf(depth_m, camera, square({0.0, 240.0}, 60.0)), DepthPlaneFailure::kNone) << "half in the image";
  Quad bad = square({320.0, 240.0}, 60.0);
  bad[1].x() = std::nan("");
  EXPECT_EQ(failureOf(depth_m, camera, bad), DepthPlaneFailure::kTooFewPixels);
  const Quad bow_tie = {square({320.0, 240.0}, 60.0)[0], square({320.0, 240.0}, 60.0)[2],
                        square({320.0, 240.0}, 60.0)[1], square({320.0, 240.0}, 60.0)[3]};
  EXPECT_EQ(failureOf(depth_m, camera, bow_tie), DepthPlaneFailure::kTooFewPixels);
}

TEST(DepthPlane, LooksAtNoMorePixelsOfALargeTagThanItNeeds) {
  // What bounds the time; a tag that fills the image would cost 250 times as much as one of 30 px.
  const CameraModel camera = testCamera();
  const cv::Mat depth_m = render(camera, planeThrough({320.0, 240.0}, 1.0, {0.0, 0.0, -1.0}, camera));
  for (const double side_px : {30.0, 200.0, 450.0}) {
    const auto plane = fitDepthPlane(depth_m, camera, square({320.0, 240.0}, side_px), {});
    ASSERT_TRUE(plane);
    EXPECT_GT(plane->num_pixels, 280) << side_px;  // a stride of two takes a quarter of what is just too many
    EXPECT_LT(plane->num_pixels, 720) << side_px;  // 600 and what the border rounds up
  }
}

TEST(DepthPlane, LooksAtThePlateRoundTheTagToo) {
  const CameraModel camera = testCamera();
  const cv::Mat depth_m = render(camera, planeThrough({320.0, 240.0}, 1.0, {0.0, 0.0, -1.0}, camera));
  DepthPlaneConfig config;
  for (const double grow : {0.6, 1.0, 1.15}) {
    config.grow = grow;
    const auto plane = fitDepthPlane(depth_m, camera, square({320.0, 240.0}, 20.0), config);
    ASSERT_TRUE(plane);
    EXPECT_NEAR(plane->num_pixels, std::pow(20.0 * grow, 2), 50.0);  // a row and a column more or less
  }
}

TEST(DepthPlane, RefusesADepthImageOfAnotherTypeOrSize) {
  const CameraModel camera = testCamera();
  const Quad quad = square({320.0, 240.0}, 60.0);
  EXPECT_THROW(fitDepthPlane(cv::Mat(480, 640, CV_16UC1), camera, quad, {}), std::invalid_argument);
  EXPECT_THROW(fitDepthPlane(cv::Mat(480, 320, CV_32FC1), camera, quad, {}), std::invalid_argument);
}

TEST(DepthPlaneConfig, SaysWhatIsWrong) {
  EXPECT_THAT(interactive_mapping::problemsOf(DepthPlaneConfig()), SizeIs(0));
  DepthPlaneConfig config;
  config.inverse_depth_std = 0.0;
  config.min_coverage = std::nan("");
  config.min_pixels = 2;
  EXPECT_THAT(interactive_mapping::problemsOf(config),
              testing::ElementsAre(HasSubstr("inverse_depth_std = 0 1/m, must be in ["),
                                   HasSubstr("min_coverage = nan, must be in [0, 1]"),
                                   HasSubstr("min_pixels = 2 px, must be in [10")));
}

}  // namespace
}  // namespace brick_detection
