// SPDX-License-Identifier: BSD-3-Clause
// Detector and poses on one rendered pile of twelve bricks, 640 x 480. One thread throughout.
#include <string>

#include <benchmark/benchmark.h>

#include "brick_detection/annotated_image.h"
#include "brick_detection/brick_pose.h"
#include "brick_detection/tag_detector.h"
#include "support/tag_renderer.h"

namespace brick_detection {
namespace {

const mp700_ur5e_description::BrickCatalogue& catalogue() {
  static const auto kCatalogue = mp700_ur5e_description::loadBrickTypes(BRICKS_YAML);
  return kCatalogue;
}

RenderScene pile(const std::string& family) {
  RenderScene scene;
  scene.family = family;
  scene.camera = {640, 480, 525.0, 525.0, 319.5, 239.5, Distortion::kNone, {}};
  scene.T_camera_ground = poseSeenAt(scene.camera, {320.0, 260.0}, 1.7, 0.8, CV_PI, 0.0);
  for (int i = 0; i < 12; ++i) {
    Eigen::Isometry3d T_camera_brick = *scene.T_camera_ground;
    T_camera_brick.translate(Eigen::Vector3d(0.35 * (i % 3) - 0.35, 0.3 * (i / 3 % 2) - 0.15, 0.1 + 0.22 * (i / 6)));
    T_camera_brick.rotate(Eigen::AngleAxisd(0.5 * i, Eigen::Vector3d::UnitZ()));
    scene.bricks.push_back(catalogueBrick(catalogue(), i, T_camera_brick));
  }
  return scene;
}

RenderedView view(const std::string& family) {
  cv::setNumThreads(1);
  RenderEffects effects;
  effects.noise_std = 2.5;
  effects.blur_sigma_px = 0.5;
  effects.depth_noise = 0.003;
  effects.depth_noise_px = 4.0;
  return render(pile(family), effects, 1);
}

void detect(const TagDetectorConfig& config, benchmark::State* state) {
  const RenderedView seen = view(config.family);
  const auto detector = makeTagDetector(config);
  std::size_t num_tags = 0;
  for (auto _ : *state) {
    num_tags = detector->detect(seen.grey).size();
    benchmark::DoNotOptimize(num_tags);
  }
  state->counters["tags"] = static_cast<double>(num_tags);
}

void BM_DetectAprilTags(benchmark::State& state) {
  TagDetectorConfig config;
  config.decimate = static_cast<double>(state.range(0));
  detect(config, &state);
}
BENCHMARK(BM_DetectAprilTags)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);

void BM_DetectArucoTags(benchmark::State& state) {
  TagDetectorConfig config;
  config.family = "DICT_5X5_1000";
  detect(config, &state);
}
BENCHMARK(BM_DetectArucoTags)->Unit(benchmark::kMillisecond);

void BM_EstimatePoses(benchmark::State& state) {
  const RenderedView seen = view("tag36h11");
  const CameraModel camera = pile("tag36h11").camera;
  const std::vector<TagObservation> tags = makeTagDetector({})->detect(seen.grey);
  const BrickPoseEstimator estimator(catalogue(), {});
  const cv::Mat depth_m = state.range(0) != 0 ? seen.depth_m : cv::Mat();
  std::size_t num_bricks = 0;
  for (auto _ : state) {
    num_bricks = estimator.estimate(tags, camera, depth_m, seen.grey).bricks.size();
    benchmark::DoNotOptimize(num_bricks);
  }
  state.counters["bricks"] = static_cast<double>(num_bricks);
}
BENCHMARK(BM_EstimatePoses)->ArgName("depth")->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);

void BM_DrawDetections(benchmark::State& state) {
  const RenderedView seen = view("tag36h11");
  const CameraModel camera = pile("tag36h11").camera;
  const auto result =
      BrickPoseEstimator(catalogue(), {}).estimate(makeTagDetector({})->detect(seen.grey), camera, seen.depth_m);
  for (auto _ : state) benchmark::DoNotOptimize(drawDetections(seen.color, camera, result, catalogue()));
}
BENCHMARK(BM_DrawDetections)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace brick_detection
