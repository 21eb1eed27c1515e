// SPDX-License-Identifier: BSD-3-Clause
// What real registered depth images lack is no proof that a surface has gone; an empty background behind a taken box is.
#include <cstdio>

#include <gtest/gtest.h>

#include "support/real_defects.h"

namespace synthetic_depth {
namespace test {
namespace {

constexpr int kStep_px = 4;
constexpr double kReach_m = 0.03;  // 3 sigma of the noise at 2.6 m, the room's far corner

class MapOnRealDefects : public testing::TestWithParam<const char*> {};

TEST_P(MapOnRealDefects, TurningCameraKeepsTheRoom) {
  const Scene scene = turningCamera(GetParam());
  GpisMap map(mapConfig(scene));
  std::vector<Eigen::Vector3d> measured_map;
  std::vector<Eigen::Vector3d> dark_map;
  for (int frame = 0; frame < scene.numFrames(); ++frame) {
    const MeasuredFrame measured = measureFrame(scene, frame, kStep_px);
    feed(&map, scene, frame, measured.image);
    measured_map.insert(measured_map.end(), measured.points_map.begin(), measured.points_map.end());
    const std::vector<Eigen::Vector3d> dark = measureFrame(scene, frame, kStep_px, &kDarkBox).points_map;
    dark_map.insert(dark_map.end(), dark.begin(), dark.end());
  }
  ASSERT_GT(measured_map.size(), 50000U);
  ASSERT_GT(dark_map.size(), 1000U);
  const double share = static_cast<double>(numOnSurface(map, measured_map, kReach_m)) / measured_map.size();
  const double dark_share = static_cast<double>(numOnSurface(map, dark_map, kReach_m)) / dark_map.size();
  std::printf("%s: %.2f %% of what was measured, %.2f %% of the dark box\n", GetParam(), 100.0 * share,
              100.0 * dark_share);
  EXPECT_GE(share, 0.97);
  EXPECT_GE(dark_share, 0.97);
}

TEST_P(MapOnRealDefects, BoxTakenBeforeNothingIsGoneAfterOneFrame) {
  const Scene scene = boxTakenBeforeNothing(GetParam());
  GpisMap map(mapConfig(scene));
  // The foot of the box is the table's, too.
  const SceneDistance remains(scene, kTakenAtFrame);
  std::vector<Eigen::Vector3d> box_map;
  for (int frame = 0; frame < kTakenAtFrame; ++frame) {
    feed(&map, scene, frame, measureFrame(scene, frame, kStep_px).image);
    for (const Eigen::Vector3d& p_map : measureFrame(scene, frame, kStep_px, &kTakenBox).points_map) {
      if (distanceAt(remains, p_map) > 2.0 * kReach_m) box_map.push_back(p_map);
    }
  }
  const Eigen::Index before = numOnSurface(map, box_map, kReach_m);
  ASSERT_GT(before, 0.97 * static_cast<double>(box_map.size()));
  ASSERT_GT(before, 1000);
  feed(&map, scene, kTakenAtFrame, measureFrame(scene, kTakenAtFrame, kStep_px).image);
  const Eigen::Index after = numOnSurface(map, box_map, kReach_m);
  std::printf("%s: %ld of %ld on the map's surface before, %ld one frame after\n", GetParam(),
              static_cast<long>(before), static_cast<long>(box_map.size()), static_cast<long>(after));
  EXPECT_EQ(after, 0);
}

INSTANTIATE_TEST_SUITE_P(DefectSets, MapOnRealDefects, testing::ValuesIn(kDefectSets),
                         [](const auto& set) { return std::string(set.param); });

}  // namespace
}  // namespace test
}  // namespace synthetic_depth
