// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/offscreen_renderer.h"

#include <future>
#include <limits>
#include <map>
#include <stdexcept>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

#include "mjcf_of_scene.h"
#include "simulated_world/mujoco_model.h"
#include "synthetic_depth/depth_renderer.h"
#include "synthetic_depth/scene.h"
#include "synthetic_depth/testing/random_scene.h"

namespace simulated_world {
namespace {

using test_support::messageOf;
using ::testing::AllOf;
using ::testing::HasSubstr;

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
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { OffscreenRenderer renderer(*model, bad_config); }),
              AllOf(HasSubstr("max_width_px = 0 px"), HasSubstr("samples = -1")));
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

TEST(OffscreenRenderer, SegmentationAgreesWithTheAnalyticScene) {
  synthetic_depth::Scene scene = synthetic_depth::test::makeRandomScene(4, 12, true);
  scene.camera = {320, 240, 260.0, 260.0, 153.25, 124.75};
  scene.T_scene_camera = {synthetic_depth::lookAt({1.2, 0.3, 0.9}, {0.0, 0.0, 0.15}),
                          synthetic_depth::lookAt({-0.9, 1.5, 1.3}, {0.0, 0.0, 0.15})};
  const ModelPtr model = compileModel(test::mjcfOf(scene));
  const DataPtr data = stateOf(model);
  OffscreenRenderer renderer(*model);
  std::map<int, int> geom_of_box = {{synthetic_depth::kNoReturnId, -1}, {synthetic_depth::kGroundId, 0}};
  for (const synthetic_depth::Box& box : scene.boxesAt(0)) {
    const int index = static_cast<int>(geom_of_box.size()) - 1;
    geom_of_box[box.id] = index;  // after the ground, in the order of mjcfOf()
  }
  int compared = 0;
  int wrong = 0;
  for (int frame = 0; frame < scene.numFrames(); ++frame) {
    cv::Mat geom_ids;
    RenderOptions options;
    options.has_shadows = options.has_skybox = options.has_reflections = true;  // must not colour the numbers
    renderer.segmentation(*data, scene.T_scene_camera[static_cast<std::size_t>(frame)], scene.camera, options,
                          &geom_ids);
    ASSERT_EQ(geom_ids.type(), CV_32SC1);
    cv::Mat box_ids;
    synthetic_depth::renderDepth(scene, frame, &box_ids);
    for (int v = 1; v + 1 < box_ids.rows; ++v) {
      for (int u = 1; u + 1 < box_ids.cols; ++u) {
        const int box = box_ids.at<int>(v, u);
        if (cv::countNonZero(box_ids(cv::Rect(u - 1, v - 1, 3, 3)) == box) != 9) {
          continue;  // silhouettes within a pixel
        }
        ++compared;
        wrong += geom_ids.at<int>(v, u) == geom_of_box.at(box) ? 0 : 1;
      }
    }
  }
  EXPECT_GT(compared, 320 * 240);
  EXPECT_EQ(wrong, 0);
}

TEST(OffscreenRenderer, AnImageAfterASegmentationHasItsColoursAgain) {
  const ModelPtr model = boxOfHeight(0.2);
  const DataPtr data = stateOf(model);
  OffscreenRenderer renderer(*model);
  cv::Mat first;
  cv::Mat again;
  cv::Mat geom_ids;
  renderer.render(*data, kDown, kCamera, {}, &first, nullptr);
  renderer.segmentation(*data, kDown, kCamera, {}, &geom_ids);
  renderer.render(*data, kDown, kCamera, {}, &again, nullptr);
  EXPECT_EQ(cv::norm(first, again, cv::NORM_INF), 0);
  EXPECT_EQ(cv::countNonZero(geom_ids != 0), 0);  // the box fills the view
}

TEST(OffscreenRenderer, SegmentationRefusesSeveralSamplesPerPixel) {
  const ModelPtr model = boxOfHeight(0.2);
  RendererConfig config;
  config.samples = 4;
  OffscreenRenderer renderer(*model, config);
  cv::Mat geom_ids;
  EXPECT_THROW(renderer.segmentation(*stateOf(model), kDown, kCamera, {}, &geom_ids), std::invalid_argument);
  synthetic_depth::CameraModel camera = kCamera;
  camera.width_px = 641;
  OffscreenRenderer single(*model);
  EXPECT_THROW(single.segmentation(*stateOf(model), kDown, camera, {}, &geom_ids), std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
