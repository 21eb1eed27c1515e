// SPDX-License-Identifier: BSD-3-Clause
// What the map makes of filtered images: no arm in it, and nothing forgotten behind the arm.
#include <cmath>
#include <cstdio>

#include <gpis_mapping/gpis_map.h>
#include <gtest/gtest.h>

#include "robot_before_camera.h"
#include "synthetic_depth/sensor.h"

namespace simulated_world {
namespace {

using depth_camera::DepthImage;
using depth_self_filter::RobotMask;
using depth_self_filter::RobotMaskConfig;
using gpis_mapping::GpisConfig;
using gpis_mapping::GpisMap;
using gpis_mapping::SurfacePoint;

constexpr ArmAngles kStowed = {0.0, -2.5, 2.4, -1.5, -1.57, 0.0};
constexpr ArmAngles kOverPile = {0.2, -0.9, 1.2, -1.9, -1.57, 0.0};
constexpr ArmAngles kBesideIt = {0.5, -0.9, 1.2, -1.9, -1.57, 0.0};

GpisConfig mapConfig() {
  GpisConfig config;
  config.threads = 1;
  // config/cameras/realsense.yaml
  config.sensor.min_range_m = 0.3;
  config.sensor.max_range_m = 3.0;
  config.sensor.baseline_m = 0.05;
  config.sensor.noise = {0.0005, 0.0, 0.0038};
  return config;
}

class SelfFilterMap : public testing::TestWithParam<bool> {
 protected:
  SelfFilterMap() : map_(mapConfig()) {}

  static void SetUpTestSuite() { robot_ = new RobotBeforeCamera("one_heap", -1.5); }
  static void TearDownTestSuite() {
    delete robot_;
    robot_ = nullptr;
  }

  bool is16Bit() const { return GetParam(); }

  /// Feeds one image, filtered by `mask` if it is given. Returns what the map was fed.
  DepthImage feed(RobotMask* mask) {
    const cv::Mat measured = robot_->measure(++frame_);
    DepthImage image = is16Bit() ? toDepthImage16(measured) : toDepthImage(measured);
    if (mask != nullptr) robot_->filter(mask, &image);
    map_.update(image, robot_->camera(), robot_->T_map_camera(), 10.0 + 0.2 * static_cast<double>(frame_));
    return image;
  }

  int pointsOnArm() {
    int count = 0;
    for (const SurfacePoint& point : map_.contents().points) {
      // Noise at the arm's distance, 1 m, is 4 mm; three times that.
      count += robot_->distanceToArm(robot_->T_map_root().inverse() * point.position_map) < 0.012 ? 1 : 0;
    }
    return count;
  }

  static RobotBeforeCamera* robot_;
  GpisMap map_;
  std::uint64_t frame_{0};
};

RobotBeforeCamera* SelfFilterMap::robot_ = nullptr;

TEST_P(SelfFilterMap, TheArmIsNotInIt) {
  RobotMask mask(robot_->robot(), realsenseMask());
  for (const ArmAngles& arm_rad : {kOverPile, kBesideIt}) {
    robot_->pose(arm_rad, RobotBeforeCamera::brickOnMagnet(0.0));
    for (int i = 0; i < 2; ++i) feed(&mask);
    EXPECT_EQ(pointsOnArm(), 0);
  }
  EXPECT_GT(map_.contents().points.size(), 1000U);  // of pile and ground
  // Without the filter it is.
  feed(nullptr);
  EXPECT_GT(pointsOnArm(), 100);
}

/// Points of `before` that the map no longer has within `reach_m`.
std::vector<SurfacePoint> lost(const std::vector<SurfacePoint>& before, const std::vector<SurfacePoint>& after) {
  constexpr double kReach_m = 0.02;  // the least distance of two points: where one was thinned out, another is
  std::unordered_map<gpis_mapping::LatticeKey, std::vector<Eigen::Vector3d>, gpis_mapping::LatticeKeyHash> grid;
  for (const SurfacePoint& point : after) {
    grid[gpis_mapping::LatticeKey::of(point.position_map, kReach_m)].push_back(point.position_map);
  }
  std::vector<SurfacePoint> result;
  for (const SurfacePoint& point : before) {
    bool is_there = false;
    const auto center = gpis_mapping::LatticeKey::of(point.position_map, kReach_m);
    for (int d = 0; d < 27 && !is_there; ++d) {
      const auto found = grid.find(center.offset(d % 3 - 1, d / 3 % 3 - 1, d / 9 - 1));
      if (found == grid.end()) continue;
      for (const Eigen::Vector3d& p : found->second) {
        is_there = is_there || (p - point.position_map).norm() < kReach_m;
      }
    }
    if (!is_there) result.push_back(point);
  }
  return result;
}

TEST_P(SelfFilterMap, NothingIsForgottenBehindTheArm) {
  RobotMask mask(robot_->robot(), realsenseMask());
  robot_->pose(kStowed, std::nullopt);
  for (int i = 0; i < 6; ++i) feed(&mask);
  const std::vector<SurfacePoint> before = map_.contents().points;
  robot_->pose(kOverPile, RobotBeforeCamera::brickOnMagnet(0.0));
  DepthImage image;
  for (int i = 0; i < 6; ++i) image = feed(&mask);
  const std::vector<SurfacePoint> gone = lost(before, map_.contents().points);
  // Where the robot's pixels are, or its shadow's: all that is NaN now.
  const auto countHidden = [&](const std::vector<SurfacePoint>& points) {
    int hidden = 0;
    const depth_camera::CameraModel camera = robot_->camera();
    for (const SurfacePoint& point : points) {
      const Eigen::Vector3d p = robot_->T_map_camera().inverse() * point.position_map;
      const int u = static_cast<int>(std::lround(camera.fx * p.x() / p.z() + camera.cx));
      const int v = static_cast<int>(std::lround(camera.fy * p.y() / p.z() + camera.cy));
      if (p.z() <= 0.0 || u < 0 || u >= camera.width || v < 0 || v >= camera.height) continue;
      hidden += std::isnan(image.at(u, v)) ? 1 : 0;
    }
    return hidden;
  };
  std::printf("%zu points, %d of them behind the arm; gone: %zu, %d of them behind the arm\n", before.size(),
              countHidden(before), gone.size(), countHidden(gone));
  EXPECT_GT(countHidden(before), 300);
  EXPECT_EQ(countHidden(gone), 0);
}

INSTANTIATE_TEST_SUITE_P(Encodings, SelfFilterMap, testing::Values(false, true),
                         [](const testing::TestParamInfo<bool>& encoding) {
                           return encoding.param ? "16UC1" : "32FC1";
                         });

}  // namespace
}  // namespace simulated_world
