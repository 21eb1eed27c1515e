// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/scene_view.h"

#include <cmath>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "simulated_world/mujoco_model.h"
#include "synthetic_depth/seeded_random.h"

namespace simulated_world {
namespace {

/// A bright box on the ground, seen from the south: north is up in the picture, east to the right.
struct Box {
  Box()
      : model(compileModel("<mujoco><visual>" + surroundingsVisualXml() + "</visual><asset>" + surroundingsAssetsXml() +
                           "</asset><worldbody>" + surroundingsLightsXml() +
                           "<geom type='plane' size='0 0 1' material='ground'/>"
                           "<geom type='box' size='0.1 0.1 0.1' pos='0 0 0.1' rgba='1 0 0 1'/></worldbody></mujoco>")),
        data(makeData(*model)),
        renderer(*model) {
    mj_forward(model.get(), data.get());
  }
  ModelPtr model;
  DataPtr data;
  OffscreenRenderer renderer;
};

bool isRed(const cv::Vec3b& pixel) {
  return pixel[0] > 60 && pixel[0] > 2 * pixel[1] && pixel[0] > 2 * pixel[2];
}

TEST(SceneView, ShowsTheTargetInTheMiddleAtTheSizeOfTheFieldOfView) {
  Box box;
  const cv::Mat picture = renderView(box.renderer, *box.data, {0.0, -2.1, 0.1}, {0.0, 0.0, 0.1}, 0.4, 320, 240);
  int num_red = 0;
  for (int v = 0; v < picture.rows; ++v) {
    num_red += isRed(picture.at<cv::Vec3b>(v, 160)) ? 1 : 0;
  }
  // 0.2 m of height at 2 m, of 2 * 2 m * tan(0.2) that fit into 240 px; whole pixels.
  EXPECT_NEAR(num_red, 0.2 / (4.0 * std::tan(0.2)) * 240.0, 1.5);
  EXPECT_TRUE(isRed(picture.at<cv::Vec3b>(120, 160)));
  // Sky above, ground below.
  EXPECT_GT(picture.at<cv::Vec3b>(5, 160)[2], picture.at<cv::Vec3b>(5, 160)[0]);
  EXPECT_GE(picture.at<cv::Vec3b>(235, 160)[0], picture.at<cv::Vec3b>(235, 160)[2]);
}

TEST(SceneView, ShadowsMakeTheGroundDarkerBesideTheBoxOnly) {
  Box box;
  const Eigen::Vector3d eye(0.0, -1.5, 1.5);
  const cv::Mat with = renderView(box.renderer, *box.data, eye, {0.0, 0.0, 0.0}, 0.6, 320, 240, true);
  const cv::Mat without = renderView(box.renderer, *box.data, eye, {0.0, 0.0, 0.0}, 0.6, 320, 240, false);
  int num_darker = 0;
  int num_brighter = 0;
  for (int v = 0; v < with.rows; ++v) {
    for (int u = 0; u < with.cols; ++u) {
      const int difference = with.at<cv::Vec3b>(v, u)[1] - without.at<cv::Vec3b>(v, u)[1];
      num_darker += difference < -30 ? 1 : 0;
      num_brighter += difference > 10 ? 1 : 0;
    }
  }
  EXPECT_GT(num_darker, 200);
  EXPECT_LT(num_darker, 0.1 * static_cast<double>(with.total()));
  EXPECT_EQ(num_brighter, 0);
}

/// Where a point is in the picture, in shares of its half width and height: -1 left and below, 1 right and above.
Eigen::Vector2d inPicture(const Viewpoint& view, const Eigen::Vector3d& point_m, double fovy_rad, double aspect) {
  const Eigen::Vector3d z = (view.target_m - view.eye_m).normalized();
  const Eigen::Vector3d x = z.cross(Eigen::Vector3d::UnitZ()).normalized();
  const Eigen::Vector3d p = point_m - view.eye_m;
  const double tan_y = std::tan(0.5 * fovy_rad);
  return {p.dot(x) / (p.dot(z) * tan_y * aspect), p.dot(x.cross(z)) / (p.dot(z) * tan_y)};
}

TEST(SceneView, NearestViewpointHasAllPointsInThePictureAndSomeAtItsMargins) {
  synthetic_depth::SeededRandom random(7, 0, 0);
  const double fovy_rad = 0.5;
  const double aspect = 1.6;
  const double margin = 0.1;
  for (int round = 0; round < 200; ++round) {
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 2 + round % 20; ++i) {
      points.emplace_back(random.uniform(-3.0, 3.0), random.uniform(-2.0, 2.0), random.uniform(0.0, 1.5));
    }
    const Eigen::Vector3d forward(random.uniform(-1.0, 1.0), random.uniform(0.1, 1.0), random.uniform(-2.0, 0.5));
    const Viewpoint view = viewpointOf(points, forward, fovy_rad, aspect, margin);
    EXPECT_LT((view.target_m - view.eye_m).normalized().cross(forward.normalized()).norm(), 1e-9);
    double nearest_m = 1e9;
    Eigen::Array2d low(2.0, 2.0);
    Eigen::Array2d high(-2.0, -2.0);
    for (const Eigen::Vector3d& point : points) {
      nearest_m = std::min(nearest_m, (point - view.eye_m).dot(forward.normalized()));
      ASSERT_GT(nearest_m, 0.1 - 1e-9);
      low = low.min(inPicture(view, point, fovy_rad, aspect).array());
      high = high.max(inPicture(view, point, fovy_rad, aspect).array());
    }
    EXPECT_GT(low.minCoeff(), -1.0 + margin - 1e-9);
    EXPECT_LT(high.maxCoeff(), 1.0 - margin + 1e-9);
    // As near as it goes: along one of the axes both borders are touched, or a point is as near as the least.
    const Eigen::Array2d room = (low + 1.0 - margin).max(1.0 - margin - high);
    EXPECT_LT(std::min(room.minCoeff(), nearest_m - 0.1), 1e-9);
  }
}

TEST(SceneView, ViewpointOfASinglePointIsBeforeIt) {
  const Eigen::Vector3d point(1.0, 2.0, 0.3);
  const Viewpoint view = viewpointOf({point}, {1.0, 0.0, -0.5}, 0.5, 1.5, 0.0);
  EXPECT_GT((point - view.eye_m).dot(Eigen::Vector3d(1.0, 0.0, -0.5).normalized()), 0.1 - 1e-9);
  EXPECT_LT(inPicture(view, point, 0.5, 1.5).norm(), 1e-9);
}

TEST(SceneView, RefusesAViewpointThatCannotBe) {
  const Eigen::Vector3d ahead(1.0, 0.0, 0.0);
  EXPECT_THROW(viewpointOf({}, ahead, 0.5, 1.5, 0.0), std::invalid_argument);
  EXPECT_THROW(viewpointOf({ahead}, {0.0, 0.0, -1.0}, 0.5, 1.5, 0.0), std::invalid_argument);
  EXPECT_THROW(viewpointOf({ahead}, {0.0, 0.0, 0.0}, 0.5, 1.5, 0.0), std::invalid_argument);
  EXPECT_THROW(viewpointOf({ahead}, ahead, 3.2, 1.5, 0.0), std::invalid_argument);
  EXPECT_THROW(viewpointOf({ahead}, ahead, 0.5, 0.0, 0.0), std::invalid_argument);
  EXPECT_THROW(viewpointOf({ahead}, ahead, 0.5, 1.5, 1.0), std::invalid_argument);
}

TEST(SceneView, RefusesAnImpossibleView) {
  Box box;
  const Eigen::Vector3d here(0.0, 0.0, 1.0);
  EXPECT_THROW(renderView(box.renderer, *box.data, here, here, 0.6, 320, 240), std::invalid_argument);
  EXPECT_THROW(renderView(box.renderer, *box.data, here, {0.0, 0.0, 0.0}, 3.2, 320, 240), std::invalid_argument);
  EXPECT_THROW(renderView(box.renderer, *box.data, here, {0.0, 0.0, 0.0}, 0.6, 1000, 240), std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
