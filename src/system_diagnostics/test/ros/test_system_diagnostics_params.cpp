// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics_ros/system_diagnostics_params.h"

#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/shipped_file.h>
#include <ros/ros.h>

namespace system_diagnostics_ros {
namespace {

using interactive_mapping::toYaml;
using testing::HasSubstr;

std::string messageOf(const ros::NodeHandle& nh) {
  return test_support::messageOf<std::invalid_argument>([&] { loadSystemDiagnosticsParams(nh); });
}

TEST(SystemDiagnosticsParams, ShippedFileIsWhatTheFieldsSay) {
  test_support::expectShippedFile<SystemDiagnosticsParams>(SYSTEM_DIAGNOSTICS_DIR "/config/system_diagnostics.yaml");
}

TEST(SystemDiagnosticsParams, ShippedFileLoadsAsTheDefaults) {
  EXPECT_EQ(toYaml(loadSystemDiagnosticsParams(ros::NodeHandle("~shipped"))), toYaml(SystemDiagnosticsParams()));
}

TEST(SystemDiagnosticsParams, AFurtherTransformIsWatchedAndOthersMayBeLeftOut) {
  ros::NodeHandle nh("~further");
  nh.setParam("window_s", 20.0);
  nh.setParam("tf/watched", "odometry scanner");
  nh.setParam("tf/scanner/target", "base_link");
  nh.setParam("tf/scanner/source", "lidar_1_link");
  nh.setParam("tf/tool/target", "base_link");  // of one that is not watched
  const SystemDiagnosticsParams params = loadSystemDiagnosticsParams(nh);
  ASSERT_EQ(params.tf.transforms.size(), 2u);
  EXPECT_EQ(params.tf.transforms.at("scanner").source, "lidar_1_link");
  EXPECT_EQ(params.tf.transforms.at("scanner").limits.window_s, 20.0);
  EXPECT_EQ(params.tf.transforms.at("odometry").limits.min_rate_hz, 20.0);
  EXPECT_EQ(params.arrival.window_s, 20.0);
  nh.setParam("tf/watched", "odometry scanner odometry");
  EXPECT_EQ(messageOf(nh), "refused parameters:\n  " + nh.getNamespace() +
                               "/tf/watched = 'odometry scanner odometry', must name each once");
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
  const std::string message = messageOf(nh);
  EXPECT_THAT(message, HasSubstr("/wrong/colour is unknown"));
  EXPECT_THAT(message, HasSubstr("/wrong/window_s = 0 s"));
  EXPECT_THAT(message, HasSubstr("/wrong/tf/scanner/target = '/base_link', must be a tf2 frame"));
  EXPECT_THAT(message, HasSubstr("/wrong/tf/scanner/source = '', must be a tf2 frame"));
  EXPECT_THAT(message, HasSubstr("/wrong/tf/odometry/step_m = -1 m"));
  EXPECT_THAT(message, HasSubstr("/wrong/tf/odometry/min_rate_hz"));
  EXPECT_THAT(message, HasSubstr("/wrong/tf/nobody is unknown"));
  EXPECT_THAT(message, HasSubstr("/wrong/arrival/timeout_s = 0 s"));
  EXPECT_THAT(message, HasSubstr("/wrong/motion/error_offset_s = 0.05 s, must be in [0.5, 10] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/motion/min_images"));
  EXPECT_THAT(message, HasSubstr("/wrong/motion/image_width_px = 1 px"));
}

}  // namespace
}  // namespace system_diagnostics_ros
