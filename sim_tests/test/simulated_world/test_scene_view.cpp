// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/scene_view.h"

#include <cmath>
#include <stdexcept>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "simulated_world/mujoco_model.h"

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

TEST(SceneView, RefusesAnImpossibleView) {
  Box box;
  const Eigen::Vector3d here(0.0, 0.0, 1.0);
  EXPECT_THROW(renderView(box.renderer, *box.data, here, here, 0.6, 320, 240), std::invalid_argument);
  EXPECT_THROW(renderView(box.renderer, *box.data, here, {0.0, 0.0, 0.0}, 3.2, 320, 240), std::invalid_argument);
  EXPECT_THROW(renderView(box.renderer, *box.data, here, {0.0, 0.0, 0.0}, 0.6, 1000, 240), std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
