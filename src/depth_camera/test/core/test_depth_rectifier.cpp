// SPDX-License-Identifier: BSD-3-Clause
#include "depth_camera/depth_rectifier.h"

#include <cmath>
#include <functional>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/calib3d.hpp>

#include <interactive_mapping_common/testing/temporary_folder.h>

namespace depth_camera {
namespace {

using test_support::messageOf;
using testing::HasSubstr;

constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

const CameraModel kRaw{160, 120, 120.0, 118.0, 81.3, 58.6};

struct Lens {
  const char* name;
  LensDistortion distortion;
};

const std::vector<Lens>& lenses() {
  static const std::vector<Lens> kLenses = {
      {"barrel", {"plumb_bob", {-0.25, 0.06, 0.001, -0.0005, 0.0}}},
      {"pincushion, four coefficients", {"plumb_bob", {0.12, -0.03, -0.002, 0.001}}},
      {"Azure Kinect colour",
       {"rational_polynomial",
        {0.5463702, -2.6014142, 0.00084511, -0.00037217, 1.46846509, 0.42450839, -2.43036604, 1.40019464}}},
      {"thin prism", {"rational_polynomial", {0.1, -0.05, 0.0, 0.0, 0.01, 0.2, -0.02, 0.0, 0.002, 0.0, -0.001, 0.0}}},
      {"tilted sensor",
       {"rational_polynomial", {0.1, -0.05, 0.0, 0.0, 0.01, 0.2, -0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.01, -0.02}}},
      {"equidistant", {"equidistant", {0.02, -0.004, 0.001, -0.0002}}},
      {"fisheye", {"fisheye", {-0.05, 0.01, 0.0, 0.0}}},
  };
  return kLenses;
}

/// What the lens sees at a pixel of its raw image: OpenCV's inverse, far tighter than by default.
Eigen::Vector3d rawRay(const CameraModel& raw, const LensDistortion& distortion, double u, double v) {
  const cv::Matx33d K(raw.fx, 0.0, raw.cx, 0.0, raw.fy, raw.cy, 0.0, 0.0, 1.0);
  const std::vector<cv::Point2d> pixel = {{u, v}};
  std::vector<cv::Point2d> ray;
  if (distortion.coefficients.size() == 4 && distortion.model != "plumb_bob") {
    cv::fisheye::undistortPoints(pixel, ray, K, distortion.coefficients);
  } else {
    cv::undistortPoints(pixel, ray, K, distortion.coefficients, cv::noArray(), cv::noArray(),
                        cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 500, 1e-12));
  }
  return {ray[0].x, ray[0].y, 1.0};
}

DepthImage render(const CameraModel& raw, const LensDistortion& distortion,
                  const std::function<double(const Eigen::Vector3d&)>& depth) {
  DepthImage image{raw.width, raw.height, {}};
  for (int v = 0; v < raw.height; ++v) {
    for (int u = 0; u < raw.width; ++u) {
      image.depth_m.push_back(static_cast<float>(depth(rawRay(raw, distortion, u, v))));
    }
  }
  return image;
}

TEST(DepthRectifier, ShowsAPlaneAsThePinholeSeesIt) {
  const Eigen::Vector3d n = Eigen::Vector3d(0.3, -0.4, 1.0).normalized();
  const auto plane = [&n](const Eigen::Vector3d& ray) { return 1.5 / n.dot(ray); };
  for (const Lens& lens : lenses()) {
    SCOPED_TRACE(lens.name);
    const DepthRectifier rectifier(kRaw, lens.distortion);
    const CameraModel& camera = rectifier.camera();
    EXPECT_EQ(camera.fx, kRaw.fx);
    EXPECT_EQ(camera.fy, kRaw.fy);
    const DepthImage image = rectifier.rectify(render(kRaw, lens.distortion, plane));
    ASSERT_EQ(image.width, camera.width);
    ASSERT_EQ(image.height, camera.height);
    std::size_t seen = 0;
    double worst = 0.0;
    for (int v = 0; v < image.height; ++v) {
      for (int u = 0; u < image.width; ++u) {
        if (std::isnan(image.at(u, v))) continue;
        ++seen;
        worst = std::max(worst, std::abs(image.at(u, v) / plane(camera.ray(u, v)) - 1.0));
      }
    }
    EXPECT_LT(worst, 2e-4);  // the curvature of distortion and perspective within a pixel
    EXPECT_GT(seen, 0.9 * kRaw.width * kRaw.height);
  }
}

TEST(DepthRectifier, CoversEverythingThatTheRawImageSees) {
  for (const Lens& lens : lenses()) {
    SCOPED_TRACE(lens.name);
    const DepthRectifier rectifier(kRaw, lens.distortion);
    const CameraModel& camera = rectifier.camera();
    const DepthImage image = rectifier.rectify(render(kRaw, lens.distortion, [](const auto&) { return 1.0; }));
    for (int v = 1; v < kRaw.height - 1; ++v) {
      for (int u = 1; u < kRaw.width - 1; ++u) {
        const Eigen::Vector3d ray = rawRay(kRaw, lens.distortion, u, v);
        const int at_u = static_cast<int>(std::lround(ray.x() * camera.fx + camera.cx));
        const int at_v = static_cast<int>(std::lround(ray.y() * camera.fy + camera.cy));
        ASSERT_TRUE(at_u >= 0 && at_u < camera.width && at_v >= 0 && at_v < camera.height) << u << " " << v;
        ASSERT_EQ(image.at(at_u, at_v), 1.0f) << u << " " << v;
      }
    }
  }
}

TEST(DepthRectifier, NoDistortionHandsTheImageThrough) {
  for (const LensDistortion& none : {LensDistortion{}, LensDistortion{"plumb_bob", std::vector<double>(5, 0.0)},
                                     LensDistortion{"some driver's name", {0.0, 0.0}}}) {
    const DepthRectifier rectifier(kRaw, none);
    EXPECT_EQ(rectifier.camera(), kRaw);
    DepthImage image{kRaw.width, kRaw.height, std::vector<float>(kRaw.width * kRaw.height, 1.25f)};
    image.depth_m[7] = 0.0f;
    const std::vector<float> before = image.depth_m;
    const float* pixels = image.depth_m.data();
    const DepthImage rectified = rectifier.rectify(std::move(image));
    EXPECT_EQ(rectified.depth_m, before);
    EXPECT_EQ(rectified.depth_m.data(), pixels) << "copied";
  }
}

TEST(DepthRectifier, NeverBlendsAcrossAnEdgeOrWithWhatIsNoDepth) {
  const LensDistortion& lens = lenses()[0].distortion;
  const DepthRectifier rectifier(kRaw, lens);
  for (const float other : {0.0f, kNan, kInf, -kInf, 1.1f, 4.0f, -1.0f}) {
    DepthImage raw{kRaw.width, kRaw.height, {}};
    for (int v = 0; v < kRaw.height; ++v) {
      for (int u = 0; u < kRaw.width; ++u) raw.depth_m.push_back((u / 3 + v / 5) % 2 == 0 ? 1.0f : other);
    }
    const DepthImage image = rectifier.rectify(raw);
    std::size_t one = 0;
    std::size_t two = 0;
    for (const float z : image.depth_m) {
      if (std::abs(z - 1.0f) < 1e-6f) {
        ++one;
      } else if (z == other || std::abs(z - other) < 1e-6f) {
        ++two;
      } else {
        ASSERT_TRUE(std::isnan(z)) << z << " beside " << other;
      }
    }
    EXPECT_GT(one, raw.depth_m.size() / 3);
    if (!std::isnan(other)) {
      EXPECT_GT(two, raw.depth_m.size() / 3);
    }
  }
}

TEST(DepthRectifier, BlendsWithinTheNoiseOfASurface) {
  const DepthRectifier rectifier(kRaw, lenses()[0].distortion);
  DepthImage raw{kRaw.width, kRaw.height, {}};
  for (int i = 0; i < kRaw.width * kRaw.height; ++i) raw.depth_m.push_back(i % 2 == 0 ? 1.0f : 1.01f);
  const DepthImage image = rectifier.rectify(raw);
  std::size_t between = 0;
  for (const float z : image.depth_m) between += z > 1.001f && z < 1.009f;
  EXPECT_GT(between, raw.depth_m.size() / 2);
}

TEST(DepthRectifier, StaysBlindWhereAPolynomialTurnsBack) {
  // Turns back at r = sqrt(1 / 1.5) = 0.82, 39 degrees: outside this image, whose corners are at 0.77 raw.
  const CameraModel raw{120, 90, 140.0, 140.0, 59.5, 44.5};
  const LensDistortion lens{"plumb_bob", {-0.5, 0.0, 0.0, 0.0}};
  const DepthRectifier rectifier(raw, lens);
  const CameraModel& camera = rectifier.camera();
  const DepthImage image = rectifier.rectify(
      DepthImage{raw.width, raw.height, std::vector<float>(static_cast<std::size_t>(raw.width) * raw.height, 1.0f)});
  for (int v = 0; v < image.height; ++v) {
    for (int u = 0; u < image.width; ++u) {
      if (std::isnan(image.at(u, v))) continue;
      ASSERT_LT(camera.ray(u, v).head<2>().norm(), 0.8165) << u << " " << v;
    }
  }
}

TEST(DepthRectifier, LooksNoFurtherThan68Degrees) {
  const CameraModel raw{400, 400, 110.0, 110.0, 199.5, 199.5};  // to 104 degrees on each side
  const DepthRectifier rectifier(raw, {"equidistant", {0.001, 0.0, 0.0, 0.0}});
  const CameraModel& camera = rectifier.camera();
  EXPECT_LE(camera.width, 2 * raw.width);
  EXPECT_LE(camera.height, 2 * raw.height);
  EXPECT_NEAR((camera.width - 1) / 2.0 / camera.fx, 2.475, 0.01);
}

TEST(DepthRectifier, RectifiesACutOutBesideTheOpticalAxis) {
  const CameraModel cut{40, 30, kRaw.fx, kRaw.fy, kRaw.cx - 110.0, kRaw.cy - 80.0};
  const LensDistortion& lens = lenses()[0].distortion;
  const Eigen::Vector3d n = Eigen::Vector3d(0.3, -0.4, 1.0).normalized();
  const auto plane = [&n](const Eigen::Vector3d& ray) { return 1.5 / n.dot(ray); };
  const DepthRectifier rectifier(cut, lens);
  const DepthImage image = rectifier.rectify(render(cut, lens, plane));
  std::size_t seen = 0;
  for (int v = 0; v < image.height; ++v) {
    for (int u = 0; u < image.width; ++u) {
      if (std::isnan(image.at(u, v))) continue;
      ++seen;
      ASSERT_NEAR(image.at(u, v), plane(rectifier.camera().ray(u, v)), 0.006);
    }
  }
  EXPECT_GT(seen, 1000u);
}

std::string refusalOf(const LensDistortion& distortion, const CameraModel& raw = kRaw) {
  return messageOf<std::invalid_argument>([&] { DepthRectifier(raw, distortion); });
}

TEST(DepthRectifier, RefusesWhatItCannotInvert) {
  EXPECT_THAT(refusalOf({"fancy", {0.1}}), HasSubstr("'fancy' with D other than 0, must be plumb_bob, rational"));
  EXPECT_THAT(refusalOf({"", {0.1}}), HasSubstr("''"));
  EXPECT_THAT(refusalOf({"plumb_bob", {0.1, 0.0, 0.0}}), HasSubstr("3 coefficients, must have 4 or 5 for plumb_bob"));
  EXPECT_THAT(refusalOf({"plumb_bob", std::vector<double>(8, 0.01)}), HasSubstr("8 coefficients"));
  EXPECT_THAT(refusalOf({"rational_polynomial", std::vector<double>(5, 0.01)}), HasSubstr("must have 8 or 12 or 14"));
  EXPECT_THAT(refusalOf({"equidistant", std::vector<double>(5, 0.01)}), HasSubstr("must have 4"));
  EXPECT_THAT(refusalOf({"plumb_bob", {0.1, std::nan(""), 0.0, 0.0, 0.0}}), HasSubstr("D is not finite"));
  EXPECT_THAT(refusalOf({"plumb_bob", {kInf, 0.0, 0.0, 0.0, 0.0}}), HasSubstr("D is not finite"));
  // Turns back at r = 0.58, 30 degrees; this image reaches 40.
  EXPECT_THAT(refusalOf({"plumb_bob", {-1.0, 0.0, 0.0, 0.0}}),
              HasSubstr("turns back 30.1 deg from the axis, at pixel"));
  EXPECT_THAT(refusalOf({"rational_polynomial", {0.0, 0.0, 0.0, 0.0, 0.0, -3.0, 0.0, 0.0}}), testing::IsEmpty())
      << "a pole beyond the image";
  CameraModel wide = kRaw;
  wide.fx = 1.0;
  EXPECT_THAT(refusalOf({"plumb_bob", {0.1, 0.0, 0.0, 0.0}}, wide), HasSubstr("fx"));
  CameraModel aside = kRaw;
  aside.cx = -1000.0;
  EXPECT_THAT(refusalOf({"plumb_bob", {-0.01, 0.0, 0.0, 0.0}}, aside), HasSubstr("rectified with D, camera width = 0"));
}

TEST(DepthRectifier, RefusesAnImageOfAnotherSize) {
  const DepthRectifier rectifier(kRaw, {});
  const std::string message = messageOf<std::invalid_argument>([&] {
    rectifier.rectify(DepthImage{2, 1, {1.0f, 1.0f}});
  });
  EXPECT_THAT(message, HasSubstr("2 x 1 px, must be 160 x 120 px"));
}

}  // namespace
}  // namespace depth_camera
