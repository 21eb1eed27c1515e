// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/brick_detection_params.h"

#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <interactive_mapping_common/testing/shipped_file.h>
#include <ros/ros.h>

namespace brick_detection_ros {
namespace {

using interactive_mapping::toYaml;
using testing::HasSubstr;

std::string messageOf(const ros::NodeHandle& nh) {
  return test_support::messageOf<std::invalid_argument>([&] { loadBrickDetectionParams(nh); });
}

TEST(BrickDetectionParams, ShippedFileIsWhatTheFieldsSay) {
  test_support::expectShippedFile<BrickDetectionParams>(BRICK_DETECTION_DIR "/config/brick_detection.yaml");
}

TEST(BrickDetectionParams, ShippedFileLoadsAsTheDefaults) {
  BrickDetectionParams expected;
  expected.bricks_file = "/bricks.yaml";  // what a launch file has to give
  EXPECT_EQ(toYaml(loadBrickDetectionParams(ros::NodeHandle("~shipped"))), toYaml(expected));
}

TEST(BrickDetectionParams, ShippedCamerasChangeNothingButTheDepthsNoise) {
  for (const char* camera : {"generic", "realsense", "azure_kinect"}) {
    ros::NodeHandle nh(std::string("~") + camera);
    nh.setParam("bricks_file", "/bricks.yaml");
    BrickDetectionParams params = loadBrickDetectionParams(nh);
    params.bricks_file.clear();
    params.detection.pose.depth = brick_detection::DepthPlaneConfig();
    EXPECT_EQ(toYaml(params), toYaml(BrickDetectionParams())) << camera;
  }
  EXPECT_DOUBLE_EQ(loadBrickDetectionParams(ros::NodeHandle("~realsense")).detection.pose.depth.inverse_depth_std,
                   0.0038);
}

TEST(BrickDetectionParams, OneMessageNamesEveryProblemWithValueAndRange) {
  ros::NodeHandle nh("~wrong");
  nh.setParam("bricks_file", "bricks.yaml");
  nh.setParam("colour", true);
  nh.setParam("detect/timeout_s", 0.0);
  nh.setParam("input/depth_timeout_s", "soon");
  nh.setParam("input/max_depth_offset_s", 2.0);
  nh.setParam("tracker/moved_looks", 1.5);
  nh.setParam("access/min_clear", 2.0);
  nh.setParam("alvar/position_std_m", -0.01);
  const std::string message = messageOf(nh);
  EXPECT_THAT(message, HasSubstr("/wrong/bricks_file = 'bricks.yaml', must be the absolute path"));
  EXPECT_THAT(message, HasSubstr("/wrong/colour is unknown"));
  EXPECT_THAT(message, HasSubstr("/wrong/detect/timeout_s = 0 s, must be in [0.01, 600] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/depth_timeout_s"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/max_depth_offset_s = 2 s, must be in [0, 1] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/tracker/moved_looks"));
  EXPECT_THAT(message, HasSubstr("/wrong/access/min_clear = 2, must be in [0, 1]"));
  EXPECT_THAT(message, HasSubstr("/wrong/alvar/position_std_m = -0.01 m, must be in [1.0e-05, 1] m"));
}

TEST(BrickDetectionParams, SettingsOfLibrariesAreNotUnknown) {
  ros::NodeHandle nh("~libraries");
  nh.setParam("bricks_file", "/bricks.yaml");
  nh.setParam("diagnostic_period", 0.5);
  nh.setParam("image_transport", "raw");
  nh.setParam("image/compressed/jpeg_quality", 80);  // left by image_transport's publisher of an earlier run
  EXPECT_EQ(messageOf(nh), "");
}

}  // namespace
}  // namespace brick_detection_ros
