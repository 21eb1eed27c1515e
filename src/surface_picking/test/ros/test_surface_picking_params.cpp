// SPDX-License-Identifier: BSD-3-Clause
#include "surface_picking_ros/surface_picking_params.h"

#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <interactive_mapping_common/testing/shipped_file.h>
#include <ros/ros.h>

namespace surface_picking_ros {
namespace {

using interactive_mapping::toYaml;
using testing::HasSubstr;

TEST(SurfacePickingParams, ShippedFileIsWhatTheFieldsSay) {
  test_support::expectShippedFile<SurfacePickingParams>(SURFACE_PICKING_DIR "/config/surface_picking.yaml");
}

TEST(SurfacePickingParams, ShippedFileLoadsAsTheDefaults) {
  SurfacePickingParams expected;
  expected.bricks_file = "/bricks.yaml";  // what a launch file has to give
  EXPECT_EQ(toYaml(loadSurfacePickingParams(ros::NodeHandle("~shipped"))), toYaml(expected));
}

TEST(SurfacePickingParams, OneMessageNamesEveryProblemWithValueAndRange) {
  ros::NodeHandle nh("~wrong");
  nh.setParam("bricks_file", "bricks.yaml");
  nh.setParam("map_frame", "/map");
  nh.setParam("tags", true);
  nh.setParam("region/min_m", std::vector<double>{6.0, 0.0, 0.0});
  nh.setParam("patches/distance_m", 0.0);
  nh.setParam("cuboids/min_edges", 2.5);
  nh.setParam("bodies/max_missed", -1);
  const std::string message = test_support::messageOf<std::invalid_argument>([&] { loadSurfacePickingParams(nh); });
  EXPECT_THAT(message, HasSubstr("/wrong/bricks_file = 'bricks.yaml', must be the absolute path"));
  EXPECT_THAT(message, HasSubstr("/wrong/map_frame = '/map', must be a tf2 frame"));
  EXPECT_THAT(message, HasSubstr("/wrong/tags is unknown"));
  EXPECT_THAT(message, HasSubstr("min_m must be below max_m"));
  EXPECT_THAT(message, HasSubstr("/wrong/patches/distance_m = 0 m, must be in [0.001, 0.05] m"));
  EXPECT_THAT(message, HasSubstr("/wrong/cuboids/min_edges"));
  EXPECT_THAT(message, HasSubstr("/wrong/bodies/max_missed = -1"));
}

}  // namespace
}  // namespace surface_picking_ros

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  ros::init(argc, argv, "test_surface_picking_params");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
