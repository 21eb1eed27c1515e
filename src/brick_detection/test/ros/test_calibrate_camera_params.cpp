// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/camera_calibrator_params.h"

#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ros/ros.h>

#include <interactive_mapping_common_ros/testing/params_contract.h>
#include "brick_detection_ros/camera_calibrator.h"

namespace brick_detection_ros {
namespace {

using params_contract::messageOf;
using testing::HasSubstr;
using testing::Not;
using Values = params_contract::Values;

const std::string kPackage = BRICK_DETECTION_DIR;

Values flattened(const CameraCalibratorParams& params) {
  return params_contract::flattened(toYaml(params));
}

const params_contract::Contract kContract = {
    kPackage,
    "config/calibrate_camera.yaml",
    toYaml(CameraCalibratorParams()),
    [](const ros::NodeHandle& nh) { return toYaml(loadCameraCalibratorParams(nh)); },
    {},
    {}};

TEST(CalibrateCameraParams, ShippedFileHasEveryKeyWithItsDefault) {
  params_contract::expectShippedFileHasEveryDefault(kContract);
}

TEST(CalibrateCameraParams, ShippedFileLoadsOnceThereIsATarget) {
  ros::NodeHandle nh("~shipped");
  EXPECT_THAT(messageOf(kContract, nh), HasSubstr("must be one id of what the arm holds"));
  nh.setParam("target/tag_id", 5);
  CameraCalibratorParams expected;
  expected.target.tag_id = 5;
  EXPECT_EQ(toYaml(loadCameraCalibratorParams(nh)), toYaml(expected));
}

TEST(CalibrateCameraParams, EveryKeyIsReadIntoItsOwnField) {
  ros::NodeHandle nh("~changed");
  const Values texts = {{"base_frame", "chassis"},    {"tool_frame", "flange"},    {"parent_frame", "mast"},
                        {"child_frame", "housing"},   {"camera_frame", "eye"},     {"bricks_file", "/bricks.yaml"},
                        {"output_file", "/out.yaml"}, {"target/family", "tag25h9"}};
  Values expected;
  for (const auto& [key, value] : flattened(CameraCalibratorParams())) {
    expected[key] = value;
    if (key == "target/tag_id") continue;  // there is one target only
    if (texts.count(key) > 0) {
      expected[key] = texts.at(key);
      nh.setParam(key, texts.at(key));
    } else if (value == "true" || value == "false") {
      expected[key] = value == "true" ? "false" : "true";
      nh.setParam(key, value == "false");
    } else if (key == "target/brick_id" || key == "hand_eye/min_samples") {
      expected[key] = std::to_string(std::stod(value) + 4.0);
      nh.setParam(key, std::stoi(value) + 4);
    } else {
      expected[key] = std::to_string(0.75 * std::stod(value));
      nh.setParam(key, 0.75 * std::stod(value));
    }
  }
  EXPECT_EQ(flattened(loadCameraCalibratorParams(nh)), expected);
}

TEST(CalibrateCameraParams, EverythingWrongIsListed) {
  ros::NodeHandle nh("~wrong");
  nh.setParam("target/brick_id", 1);
  nh.setParam("target/tag_id", 2);
  nh.setParam("still_s", "long");
  nh.setParam("tool_frame", "/ur5e_tool0");
  nh.setParam("output_file", "relative.yaml");
  nh.setParam("hand_eye/min_samples", 2);
  nh.setParam("samples/still_m", -1.0);
  nh.setParam("speed", 1.0);
  const std::string message = messageOf(kContract, nh);
  for (const char* part : {"target/brick_id = 1 and target/tag_id = 2", "still_s", "tool_frame = '/ur5e_tool0'",
                           "output_file = 'relative.yaml', must be an absolute path", "hand_eye/min_samples = 2",
                           "samples/still_m = -1", "speed"}) {
    EXPECT_THAT(message, HasSubstr(part));
  }
  EXPECT_THAT(message, Not(HasSubstr("tf_timeout_s"))) << "nothing wrong with it";
}

TEST(CalibrateCameraParams, NodeRefusesTargetsThatAreNotThere) {
  CameraCalibratorParams params;
  params.target.tag_id = 5000;
  EXPECT_THROW(CameraCalibrator(ros::NodeHandle(), ros::NodeHandle("~node"), params), std::invalid_argument);
  params.target.tag_id = -1;
  params.target.brick_id = 0;
  params.bricks_file = "/there/is/no/bricks.yaml";
  EXPECT_THROW(CameraCalibrator(ros::NodeHandle(), ros::NodeHandle("~node"), params), std::invalid_argument);
}

}  // namespace
}  // namespace brick_detection_ros

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  ros::init(argc, argv, "test_calibrate_camera_params");
  const ros::NodeHandle nh;
  return RUN_ALL_TESTS();
}
