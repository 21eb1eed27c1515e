// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/camera_model.h"

#include <cmath>
#include <limits>
#include <random>

#include <Eigen/Geometry>
#include <gmock/gmock.h>
#include <opencv2/calib3d.hpp>

namespace brick_detection {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

CameraModel camera(Distortion distortion, std::vector<double> coefficients) {
  CameraModel model;
  model.width_px = 640;
  model.height_px = 480;
  model.fx_px = 525.0;
  model.fy_px = 520.0;
  model.cx_px = 322.5;
  model.cy_px = 236.0;
  model.distortion = distortion;
  model.coefficients = std::move(coefficients);
  return model;
}

std::vector<CameraModel> cameras() {
  return {camera(Distortion::kNone, {}),
          camera(Distortion::kPlumbBob, {0.0, 0.0, 0.0, 0.0, 0.0}),
          camera(Distortion::kPlumbBob, {-0.28, 0.09, 0.001, -0.0008}),
          camera(Distortion::kPlumbBob, {0.16, -0.49, 0.0006, 0.0002, 0.44}),
          camera(Distortion::kRationalPolynomial, {0.42, -2.5, 0.0007, -0.0003, 1.4, 0.3, -2.3, 1.35}),
          camera(Distortion::kRationalPolynomial,
                 {-0.2, 0.05, 0.0007, -0.0003, 0.0, 0.0, 0.0, 0.0, 0.001, 0.0004, -0.001, 0.0002, 0.01, -0.005}),
          camera(Distortion::kEquidistant, {-0.02, 0.01, -0.004, 0.0008}),
          camera(Distortion::kEquidistant, {0.0, 0.0, 0.0, 0.0})};
}

TEST(CameraModel, BearingIsTheInverseOfProjectOverTheWholeImage) {
  for (const CameraModel& model : cameras()) {
    for (double v = 0.0; v < model.height_px; v += 47.9) {
      for (double u = 0.0; u < model.width_px; u += 63.9) {
        const Eigen::Vector2d bearing = model.bearing({u, v});
        // OpenCV's iterations end below 1e-8 px; the equidistant one at 1e-8 rad, 5e-6 px.
        EXPECT_LT((model.project(3.0 * bearing.homogeneous()) - Eigen::Vector2d(u, v)).norm(), 1e-4)
            << "model " << static_cast<int>(model.distortion) << " at " << u << " " << v;
      }
    }
  }
}

TEST(CameraModel, PinholeProjectsByItsDefinition) {
  const CameraModel model = camera(Distortion::kNone, {});
  const Eigen::Vector2d pixel = model.project({0.3, -0.2, 2.0});
  EXPECT_NEAR(pixel.x(), 525.0 * 0.15 + 322.5, 1e-12);
  EXPECT_NEAR(pixel.y(), 520.0 * -0.1 + 236.0, 1e-12);
}

/// The formulas of OpenCV's documentation, written out once more.
TEST(CameraModel, DistortionFollowsTheDocumentedFormulas) {
  const Eigen::Vector3d p(0.35, -0.28, 1.1);
  const double x = p.x() / p.z();
  const double y = p.y() / p.z();
  const double r2 = x * x + y * y;
  const auto pixelOf = [](double a, double b) { return Eigen::Vector2d(525.0 * a + 322.5, 520.0 * b + 236.0); };
  {
    const double k1 = 0.16, k2 = -0.49, p1 = 0.006, p2 = 0.002, k3 = 0.44;
    const double radial = 1.0 + k1 * r2 + k2 * r2 * r2 + k3 * r2 * r2 * r2;
    const Eigen::Vector2d expected = pixelOf(x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                                             y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y);
    const Eigen::Vector2d pixel = camera(Distortion::kPlumbBob, {k1, k2, p1, p2, k3}).project(p);
    EXPECT_LT((pixel - expected).norm(), 1e-9);
  }
  {
    const double k1 = -0.2, k2 = 0.05, p1 = 0.001, p2 = -0.002, k3 = 0.01, k4 = 0.03, k5 = 0.02, k6 = -0.01;
    const double radial =
        (1.0 + k1 * r2 + k2 * r2 * r2 + k3 * r2 * r2 * r2) / (1.0 + k4 * r2 + k5 * r2 * r2 + k6 * r2 * r2 * r2);
    const Eigen::Vector2d expected = pixelOf(x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                                             y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y);
    const Eigen::Vector2d pixel = camera(Distortion::kRationalPolynomial, {k1, k2, p1, p2, k3, k4, k5, k6}).project(p);
    EXPECT_LT((pixel - expected).norm(), 1e-9);
  }
  {
    const double theta = std::atan(std::sqrt(r2));
    const double t2 = theta * theta;
    const double k1 = -0.02, k2 = 0.01, k3 = -0.004, k4 = 0.0008;
    const double bent = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
    const Eigen::Vector2d expected = pixelOf(x * bent / std::sqrt(r2), y * bent / std::sqrt(r2));
    EXPECT_LT((camera(Distortion::kEquidistant, {k1, k2, k3, k4}).project(p) - expected).norm(), 1e-9);
  }
}

TEST(CameraModel, EquidistantSeesTheMiddleInTheMiddle) {
  const CameraModel model = camera(Distortion::kEquidistant, {-0.02, 0.01, -0.004, 0.0008});
  EXPECT_LT((model.project({0.0, 0.0, 1.0}) - Eigen::Vector2d(322.5, 236.0)).norm(), 1e-9);
  EXPECT_LT(model.bearing({322.5, 236.0}).norm(), 1e-9);
}

TEST(CameraModel, EquidistantWithoutCoefficientsIsNoPinhole) {
  const CameraModel model = camera(Distortion::kEquidistant, {0.0, 0.0, 0.0, 0.0});
  // At 45 degrees: the angle, not its tangent.
  EXPECT_NEAR(model.project({1.0, 0.0, 1.0}).x(), 525.0 * std::atan(1.0) + 322.5, 1e-9);
}

TEST(CameraModel, PointsThatAreNotInFrontHaveNoPixel) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const CameraModel& model : cameras()) {
    EXPECT_FALSE(model.project({0.1, 0.1, 0.0}).allFinite());
    EXPECT_FALSE(model.project({0.1, 0.1, -1.0}).allFinite());
    EXPECT_FALSE(model.project({nan, 0.1, 1.0}).allFinite());
    EXPECT_FALSE(model.project({0.1, 0.1, nan}).allFinite());
    EXPECT_FALSE(model.bearing({nan, 10.0}).allFinite());
  }
}

TEST(CameraModel, PixelsBeyondTheLensHaveNoBearing) {
  // With k1 = -0.28 alone the image of all directions ends at a radius of 525 * 0.73 px.
  const CameraModel model = camera(Distortion::kPlumbBob, {-0.28, 0.0, 0.0, 0.0});
  EXPECT_TRUE(model.bearing({322.5 + 360.0, 236.0}).allFinite());
  EXPECT_FALSE(model.bearing({322.5 + 600.0, 236.0}).allFinite());
}

TEST(CameraModel, AcceptsWhatDriversSend) {
  for (const CameraModel& model : cameras()) EXPECT_THAT(model.validate(), IsEmpty());
}

TEST(CameraModel, RefusesWhatCannotBeACamera) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto problemsOf = [](void (*spoil)(CameraModel*)) {
    CameraModel model = camera(Distortion::kPlumbBob, {0.0, 0.0, 0.0, 0.0, 0.0});
    spoil(&model);
    std::string text;
    for (const std::string& problem : model.validate()) text += problem + "\n";
    return text;
  };
  EXPECT_THAT(problemsOf([](CameraModel* m) { m->width_px = 0; }),
              HasSubstr("width_px = 0 px, must be in [1, 16384] px"));
  EXPECT_THAT(problemsOf([](CameraModel* m) { m->height_px = -480; }), HasSubstr("height_px = -480 px"));
  EXPECT_THAT(problemsOf([](CameraModel* m) { m->fx_px = 0.0; }), HasSubstr("fx_px = 0 px, must be in (0, "));
  EXPECT_THAT(problemsOf([](CameraModel* m) { m->fy_px = -1.0; }), HasSubstr("fy_px = -1 px"));
  EXPECT_THAT(problemsOf([](CameraModel* m) { m->cx_px = 1281.0; }),
              HasSubstr("cx_px = 1281 px, must be in [-640, 1280] px"));
  EXPECT_THAT(problemsOf([](CameraModel* m) { m->cy_px = -481.0; }), HasSubstr("cy_px = -481 px"));
  EXPECT_THAT(problemsOf([](CameraModel* m) { m->coefficients.resize(3); }),
              HasSubstr("coefficients: number = 3, must be 4 or 5"));
  EXPECT_THAT(problemsOf([](CameraModel* m) { m->distortion = Distortion::kRationalPolynomial; }),
              HasSubstr("coefficients: number = 5, must be 8 or 12 or 14"));
  EXPECT_THAT(problemsOf([](CameraModel* m) { m->distortion = Distortion::kEquidistant; }),
              HasSubstr("coefficients: number = 5, must be 4"));
  EXPECT_THAT(problemsOf([](CameraModel* m) { m->distortion = Distortion::kNone; }),
              HasSubstr("coefficients: number = 5, must be 0"));
  CameraModel model = camera(Distortion::kPlumbBob, {0.0, nan, 0.0, 0.0, 0.0});
  EXPECT_THAT(model.validate(), testing::ElementsAre(HasSubstr("coefficients: number 1 = nan, must be finite")));
  model = camera(Distortion::kNone, {});
  model.fx_px = nan;
  model.cy_px = nan;
  EXPECT_THAT(model.validate(), testing::ElementsAre(HasSubstr("fx_px = nan px"), HasSubstr("cy_px = nan px")));
}

}  // namespace
}  // namespace brick_detection
