// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics_ros/system_diagnostics_params.h"

#include <gmock/gmock.h>
#include <ros/ros.h>

#include <interactive_mapping_common_ros/testing/params_contract.h>

namespace system_diagnostics_ros {
namespace {

using params_contract::messageOf;
using testing::HasSubstr;

const params_contract::Contract kContract = {
    SYSTEM_DIAGNOSTICS_DIR,
    "config/system_diagnostics.yaml",
    toYaml(SystemDiagnosticsParams()),
    [](const ros::NodeHandle& nh) { return toYaml(loadSystemDiagnosticsParams(nh)); },
    {"motion/min_images", "motion/image_width_px"},
    {{"tf/watched", "tool camera odometry localisation"},
     {"tf/localisation/target", "world"},
     {"tf/localisation/source", "wheels"},
     {"tf/odometry/target", "wheels"},
     {"tf/odometry/source", "platform"},
     {"tf/camera/target", "platform"},
     {"tf/camera/source", "eye"},
     {"tf/tool/target", "platform_2"},
     {"tf/tool/source", "hand"},
     // Above the warnings' values whatever those are changed to.
     {"arrival/error_ahead_s", 0.06},
     {"motion/error_offset_s", 0.07}}};

TEST(SystemDiagnosticsParams, ShippedFileHasEveryKeyWithItsDefault) {
  params_contract::expectShippedFileHasEveryDefault(kContract);
}

TEST(SystemDiagnosticsParams, ShippedFileLoadsAsTheDefaults) {
  EXPECT_EQ(toYaml(loadSystemDiagnosticsParams(ros::NodeHandle("~shipped"))), toYaml(SystemDiagnosticsParams()));
}

TEST(SystemDiagnosticsParams, EveryKeyIsReadIntoItsOwnField) {
  params_contract::expectEveryKeyIsReadIntoItsOwnField(kContract, ros::NodeHandle("~changed"));
}

TEST(SystemDiagnosticsParams, ReadmeTableHasEveryKeyWithItsDefault) {
  params_contract::expectReadmeTableHasEveryDefault(kContract);
}

TEST(SystemDiagnosticsParams, AFurtherTransformIsWatchedAndOthersMayBeLeftOut) {
  ros::NodeHandle nh("~further");
  nh.setParam("window_s", 20.0);
  nh.setParam("tf/watched", "odometry scanner");
  nh.setParam("tf/scanner/target", "base_link");
  nh.setParam("tf/scanner/source", "lidar_1_link");
  nh.setParam("tf/tool/target", "base_link");  // of one that is not watched
  const SystemDiagnosticsParams params = loadSystemDiagnosticsParams(nh);
  ASSERT_EQ(params.transforms.size(), 2u);
  EXPECT_EQ(params.transforms.at("scanner").source, "lidar_1_link");
  EXPECT_EQ(params.transforms.at("scanner").limits.window_s, 20.0);
  EXPECT_EQ(params.transforms.at("odometry").limits.min_rate_hz, 20.0);
  EXPECT_EQ(params.arrival.window_s, 20.0);
}

TEST(SystemDiagnosticsParams, OneMessageNamesEveryProblemWithValueAndRange) {
  ros::NodeHandle nh("~wrong");
  nh.setParam("colour", true);
  nh.setParam("window_s", 0.0);
  nh.setParam("tf/watched", "odometry scanner");
  nh.setParam("tf/scanner/target", "/base_link");
  nh.setParam("tf/odometry/step_m", -1.0);
  nh.setParam("tf/odometry/min_rate_hz", "often");
  nh.setParam("tf/nobody/target", "map");
  nh.setParam("arrival/timeout_s", 0.0);
  nh.setParam("motion/warn_offset_s", 0.5);
  nh.setParam("motion/min_images", 1.5);
  nh.setParam("motion/image_width_px", 1);
  const std::string message = messageOf(kContract, nh);
  EXPECT_THAT(message, HasSubstr("/wrong/colour is unknown"));
  EXPECT_THAT(message, HasSubstr("/wrong/window_s = 0 s"));
  EXPECT_THAT(message, HasSubstr("/wrong/tf/scanner/target = '/base_link', must be a tf2 frame"));
  EXPECT_THAT(message, HasSubstr("/wrong/tf/scanner/source = '', must be a tf2 frame"));
  EXPECT_THAT(message, HasSubstr("/wrong/tf/odometry/step_m = -1 m"));
  EXPECT_THAT(message, HasSubstr("/wrong/tf/odometry/min_rate_hz"));
  EXPECT_THAT(message, HasSubstr("/wrong/tf/nobody"));
  EXPECT_THAT(message, HasSubstr("/wrong/arrival/timeout_s = 0 s"));
  EXPECT_THAT(message, HasSubstr("/wrong/motion/error_offset_s = 0.05 s, must be in [0.5, 10] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/motion/min_images"));
  EXPECT_THAT(message, HasSubstr("/wrong/motion/image_width_px = 1 px"));
}

}  // namespace
}  // namespace system_diagnostics_ros

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  ros::init(argc, argv, "test_system_diagnostics_params");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
