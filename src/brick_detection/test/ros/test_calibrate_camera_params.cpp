// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/camera_calibrator_params.h"

#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <interactive_mapping_common/testing/shipped_file.h>
#include <ros/ros.h>

#include "brick_detection_ros/camera_calibrator.h"

namespace brick_detection_ros {
namespace {

using interactive_mapping::toYaml;
using testing::HasSubstr;
using testing::Not;

std::string messageOf(const ros::NodeHandle& nh) {
  return test_support::messageOf<std::invalid_argument>([&] { loadCameraCalibratorParams(nh); });
}

TEST(CalibrateCameraParams, ShippedFileIsWhatTheFieldsSay) {
  test_support::expectShippedFile<CameraCalibratorParams>(BRICK_DETECTION_DIR "/config/calibrate_camera.yaml");
}

TEST(CalibrateCameraParams, ShippedFileLoadsOnceThereIsATarget) {
  ros::NodeHandle nh("~shipped");
  EXPECT_THAT(messageOf(nh), HasSubstr("must be one id of what the arm holds"));
  nh.setParam("target/tag_id", 5);
  CameraCalibratorParams expected;
  expected.target.tag_id = 5;
  EXPECT_EQ(toYaml(loadCameraCalibratorParams(nh)), toYaml(expected));
}

TEST(CalibrateCameraParams, EverythingWrongIsListed) {
  ros::NodeHandle nh("~wrong");
  nh.setParam("target/brick_id", 1);
  nh.setParam("target/tag_id", 2);
  nh.setParam("still_s", "long");
  nh.setParam("tool_frame", "/ur5e_tool0");
  nh.setParam("output_file", "relative.yaml");
  nh.setParam("hand_eye/min_samples", 2);
  nh.setParam("pose/min_side_px", 0.0);
  nh.setParam("speed", 1.0);
  const std::string message = messageOf(nh);
  for (const char* part : {"target/brick_id = 1 and target/tag_id = 2", "still_s", "tool_frame = '/ur5e_tool0'",
                           "output_file = 'relative.yaml', must be an absolute path", "hand_eye/min_samples = 2",
                           "pose/min_side_px = 0 px", "speed is unknown"}) {
    EXPECT_THAT(message, HasSubstr(part));
  }
  EXPECT_THAT(message, Not(HasSubstr("tf_timeout_s ="))) << "nothing wrong with it";
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
