// SPDX-License-Identifier: BSD-3-Clause
// What a frame costs on one core: the arm, with a brick, in the middle of the view of the mast's camera.
#include <benchmark/benchmark.h>

#include "depth_self_filter_ros/conversions.h"
#include "support/robots.h"

namespace depth_self_filter {
namespace {

struct Setup {
  std::shared_ptr<const test::RobotModel> robot{test::shippedRobot()};
  Eigen::VectorXd positions_rad{test::positions(*robot, test::kArmInView)};
  Eigen::Isometry3d T_root_camera{robot->framePose(mp700_ur5e_description::kDepthFrame, positions_rad)};
  depth_camera::CameraModel camera{640, 480, 525.0, 525.0, 319.5, 239.5};
  std::optional<HeldBrick> brick;
  RobotMask mask{robot, RobotMaskConfig()};

  Setup() {
    brick = HeldBrick{mp700_ur5e_description::kToolFrame, Eigen::Isometry3d::Identity(), {0.3, 0.2, 0.2}};
    brick->T_frame_brick.translation().z() = 0.2;
  }
};

void report(benchmark::State& state, const MaskStatistics& statistics) {
  state.counters["masked_px"] = static_cast<double>(statistics.masked_px);
}

void BM_Mask(benchmark::State& state) {
  Setup setup;
  const depth_camera::DepthImage image = test::constantImage(setup.camera, 1.8F);
  depth_camera::DepthImage masked = image;
  MaskStatistics statistics;
  for (auto _ : state) {
    state.PauseTiming();
    masked.depth_m = image.depth_m;
    state.ResumeTiming();
    statistics = setup.mask.apply(setup.camera, setup.T_root_camera, setup.positions_rad, setup.brick, &masked);
    benchmark::DoNotOptimize(masked.depth_m.data());
  }
  report(state, statistics);
}
BENCHMARK(BM_Mask)->Unit(benchmark::kMillisecond);

/// From message to message. Argument: 16UC1 or 32FC1.
void BM_Frame(benchmark::State& state, const char* encoding) {
  Setup setup;
  sensor_msgs::Image message = *depth_self_filter_ros::toMessage(test::constantImage(setup.camera, 1.8F));
  if (std::string(encoding) == "16UC1") {
    message.encoding = encoding;
    message.step = 640 * 2;
    message.data.clear();
    for (int i = 0; i < 640 * 480; ++i) message.data.insert(message.data.end(), {0x08, 0x07});  // 1800 mm
  }
  MaskStatistics statistics;
  depth_camera_ros::Refusal refusal;
  for (auto _ : state) {
    auto image = depth_camera_ros::toDepthImage(message, 1000.0, &refusal);
    statistics = setup.mask.apply(setup.camera, setup.T_root_camera, setup.positions_rad, setup.brick, &*image);
    benchmark::DoNotOptimize(depth_self_filter_ros::toMessage(*image));
  }
  report(state, statistics);
}
BENCHMARK_CAPTURE(BM_Frame, 16UC1, "16UC1")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(BM_Frame, 32FC1, "32FC1")->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace depth_self_filter
