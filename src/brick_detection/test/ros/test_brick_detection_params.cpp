// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/brick_detection_params.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ros/ros.h>

#include <interactive_mapping_common_ros/testing/params_contract.h>

namespace brick_detection_ros {
namespace {

using params_contract::flattened;
using params_contract::messageOf;
using testing::HasSubstr;

const params_contract::Contract kContract = {
    BRICK_DETECTION_DIR,
    "config/brick_detection.yaml",
    toYaml(BrickDetectionParams()),
    [](const ros::NodeHandle& nh) { return toYaml(loadBrickDetectionParams(nh)); },
    {"input/pose_limits/settle_frames", "detector/threads", "pose/max_hamming", "pose/depth/min_pixels",
     "tracker/looks_per_standpoint", "tracker/moved_looks", "tracker/inside_samples"},
    {{"bricks_file", "/bricks.yaml"},
     {"input/map_frame", "odom"},
     {"input/camera_frame", "eye"},
     {"input/image_transport", "compressed"},
     {"input/depth_transport", "compressedDepth"},
     {"detector/decimate", 2.0},
     {"pose/depth/grow", 1.1},       // not below 1
     {"detector/max_hamming", 1}}};  // not above 2

TEST(BrickDetectionParams, ShippedFileHasEveryKeyWithItsDefault) {
  params_contract::expectShippedFileHasEveryDefault(kContract);
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
    for (const auto& [key, value] : flattened(toYaml(loadBrickDetectionParams(nh)))) {
      if (key == "bricks_file" || key.rfind("pose/depth/", 0) == 0) continue;
      EXPECT_EQ(value, flattened(kContract.default_yaml).at(key)) << camera << " " << key;
    }
  }
  EXPECT_DOUBLE_EQ(loadBrickDetectionParams(ros::NodeHandle("~realsense")).detection.pose.depth.inverse_depth_std,
                   0.0038);
}

TEST(BrickDetectionParams, EveryKeyIsReadIntoItsOwnField) {
  params_contract::expectEveryKeyIsReadIntoItsOwnField(kContract, ros::NodeHandle("~changed"));
}

TEST(BrickDetectionParams, ReadmeTableHasEveryKeyWithItsDefault) {
  params_contract::expectReadmeTableHasEveryDefault(kContract);
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
  const std::string message = messageOf(kContract, nh);
  EXPECT_THAT(message, HasSubstr("/wrong/bricks_file = 'bricks.yaml', must be the absolute path"));
  EXPECT_THAT(message, HasSubstr("/wrong/colour is unknown"));
  EXPECT_THAT(message, HasSubstr("/wrong/detect/timeout_s = 0 s, must be in [0.01, 600] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/depth_timeout_s"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/max_depth_offset_s = 2 s, must be in [0, 1] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/tracker/moved_looks"));
  EXPECT_THAT(message, HasSubstr("/wrong/access/min_clear = 2, must be in [0, 1]"));
  EXPECT_THAT(message, HasSubstr("/wrong/alvar/position_std_m = -0.01 m, must be in [1e-05, 1] m"));
}

TEST(BrickDetectionParams, SettingsOfLibrariesAreNotUnknown) {
  ros::NodeHandle nh("~libraries");
  nh.setParam("bricks_file", "/bricks.yaml");
  nh.setParam("diagnostic_period", 0.5);
  nh.setParam("image_transport", "raw");
  nh.setParam("image/compressed/jpeg_quality", 80);  // left by image_transport's publisher of an earlier run
  EXPECT_EQ(messageOf(kContract, nh), "");
}

}  // namespace
}  // namespace brick_detection_ros

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  ros::init(argc, argv, "test_brick_detection_params");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
