// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/offscreen_renderer.h"

#include <future>
#include <limits>
#include <stdexcept>

#include <gtest/gtest.h>

#include "simulated_world/mujoco_model.h"
#include "synthetic_depth/scene.h"

namespace simulated_world {
namespace {

const synthetic_depth::CameraModel kCamera{160, 120, 150.0, 150.0, 79.5, 59.5};
const Eigen::Isometry3d kDown = synthetic_depth::lookAt({0.0, 0.0, 1.0}, {0.0, 0.0, 0.0});

ModelPtr boxOfHeight(double height_m) {
  return compileModel("<mujoco><worldbody><geom type='box' size='1 1 " + std::to_string(0.5 * height_m) +
                      "' pos='0 0 " + std::to_string(0.5 * height_m) + "'/></worldbody></mujoco>");
}

DataPtr stateOf(const ModelPtr& model) {
  DataPtr data = makeData(*model);
  mj_forward(model.get(), data.get());
  return data;
}

TEST(OffscreenRenderer, SeveralLiveInOneThread) {
  const ModelPtr low = boxOfHeight(0.2);
  const ModelPtr high = boxOfHeight(0.4);
  const DataPtr low_data = stateOf(low);
  const DataPtr high_data = stateOf(high);
  auto first = std::make_unique<OffscreenRenderer>(*low);
  OffscreenRenderer second(*high);
  cv::Mat depth_m;
  for (int turn = 0; turn < 2; ++turn) {
    first->render(*low_data, kDown, kCamera, {}, nullptr, &depth_m);
    EXPECT_NEAR(depth_m.at<float>(60, 80), 0.8, 1e-4);
    second.render(*high_data, kDown, kCamera, {}, nullptr, &depth_m);
    EXPECT_NEAR(depth_m.at<float>(60, 80), 0.6, 1e-4);
  }
  first.reset();  // must not take the display, or the other's context, away
  second.render(*high_data, kDown, kCamera, {}, nullptr, &depth_m);
  EXPECT_NEAR(depth_m.at<float>(60, 80), 0.6, 1e-4);
}

TEST(OffscreenRenderer, LeavesTheModelAsItWas) {
  const ModelPtr model = boxOfHeight(0.2);
  const int width = model->vis.global.offwidth;
  RendererConfig config;
  config.max_width_px = width + 100;
  const OffscreenRenderer renderer(*model, config);
  EXPECT_EQ(model->vis.global.offwidth, width);
}

TEST(OffscreenRenderer, ShowsNothingBeyondTheFarPlane) {
  const ModelPtr model = boxOfHeight(0.2);
  OffscreenRenderer renderer(*model);
  RenderOptions options;
  options.far_m = 0.7;
  cv::Mat rgb;
  cv::Mat depth_m;
  renderer.render(*stateOf(model), kDown, kCamera, options, &rgb, &depth_m);
  EXPECT_EQ(cv::countNonZero(depth_m == std::numeric_limits<float>::infinity()), 160 * 120);
  EXPECT_EQ(cv::countNonZero(rgb.reshape(1)), 0);
}

TEST(OffscreenRenderer, RefusesAnotherThread) {
  const ModelPtr model = boxOfHeight(0.2);
  const DataPtr data = stateOf(model);
  OffscreenRenderer renderer(*model);
  cv::Mat depth_m;
  auto elsewhere =
      std::async(std::launch::async, [&] { renderer.render(*data, kDown, kCamera, {}, nullptr, &depth_m); });
  EXPECT_THROW(elsewhere.get(), std::logic_error);
}

TEST(OffscreenRenderer, WorksInAThreadOfItsOwn) {
  const ModelPtr model = boxOfHeight(0.2);
  const DataPtr data = stateOf(model);
  const OffscreenRenderer here(*model);
  auto elsewhere = std::async(std::launch::async, [&] {
    OffscreenRenderer renderer(*model);
    cv::Mat depth_m;
    renderer.render(*data, kDown, kCamera, {}, nullptr, &depth_m);
    return depth_m.at<float>(60, 80);
  });
  EXPECT_NEAR(elsewhere.get(), 0.8, 1e-4);
}

TEST(OffscreenRenderer, RefusesMoreTexturesThanFit) {
  std::string assets;
  for (int i = 0; i < 101; ++i) {
    assets += "<texture name='t" + std::to_string(i) + "' type='2d' builtin='flat' width='2' height='2'/>";
  }
  const ModelPtr model = compileModel("<mujoco><asset>" + assets + "</asset></mujoco>");
  if (model->ntex <= static_cast<int>(sizeof(mjrContext::texture) / sizeof(unsigned int))) {
    GTEST_SKIP() << "this MuJoCo holds more textures";
  }
  EXPECT_THROW(OffscreenRenderer{*model}, std::invalid_argument);
}

TEST(OffscreenRenderer, RefusesWhatItCannotDraw) {
  const ModelPtr model = boxOfHeight(0.2);
  const DataPtr data = stateOf(model);
  RendererConfig bad_config;
  bad_config.max_width_px = 0;
  bad_config.samples = -1;
  try {
    OffscreenRenderer renderer(*model, bad_config);
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("max_width_px = 0 px"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("samples = -1"), std::string::npos) << error.what();
  }
  OffscreenRenderer renderer(*model);
  cv::Mat depth_m;
  synthetic_depth::CameraModel camera = kCamera;
  camera.width_px = 641;
  EXPECT_THROW(renderer.render(*data, kDown, camera, {}, nullptr, &depth_m), std::invalid_argument);
  camera = kCamera;
  camera.fy_px = 140.0;
  EXPECT_THROW(renderer.render(*data, kDown, camera, {}, nullptr, &depth_m), std::invalid_argument);
  RenderOptions options;
  options.near_m = 0.0;
  EXPECT_THROW(renderer.render(*data, kDown, kCamera, options, nullptr, &depth_m), std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
