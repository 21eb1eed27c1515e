// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/gpis_mapping_params.h"

#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ros/ros.h>

#include <interactive_mapping_common/testing/shipped_file.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

namespace gpis_mapping_ros {
namespace {

using test_support::messageOf;
using testing::HasSubstr;

const std::string kConfigDir = GPIS_CONFIG_DIR;
TEST(GpisMappingParams, ShippedFileIsWhatTheFieldsSay) {
  test_support::expectShippedFile<GpisMappingParams>(kConfigDir + "/gpis_mapping_node.yaml");
}

TEST(GpisMappingParams, ShippedFilesLoadAsTheDefaults) {
  const GpisMappingParams params = loadGpisMappingParams(ros::NodeHandle("~shipped"));
  EXPECT_EQ(interactive_mapping::toYaml(params), interactive_mapping::toYaml(GpisMappingParams()));
  EXPECT_EQ(gpis_mapping::toYaml(params.map), gpis_mapping::toYaml(gpis_mapping::GpisConfig()));
}

TEST(GpisMappingParams, OneMessageNamesEveryProblemWithValueAndRange) {
  ros::NodeHandle nh("~wrong");
  nh.setParam("output/rate_hz", 100.0);
  nh.setParam("output/mesh_colour", "height");
  nh.setParam("output/mesh_color", "pink");
  nh.setParam("input/tf_timeout_s", "soon");
  nh.setParam("input/pose_limits/settle_frames", 2.5);
  nh.setParam("storage/autosave_file", "map.gpis");
  nh.setParam("map/sensor/max_range_m", -1.0);
  nh.setParam("more_depth_topics", std::vector<std::string>{"/a/image", "", "not a topic", "/a/image", "~b"});
  const std::string message = messageOf<std::invalid_argument>([&] { loadGpisMappingParams(nh); });
  EXPECT_THAT(message, HasSubstr("/wrong/output/rate_hz = 100 Hz, must be in [0.05, 30] Hz"));
  EXPECT_THAT(message, HasSubstr("/wrong/output/mesh_colour is unknown"));
  EXPECT_THAT(message, HasSubstr("/wrong/output/mesh_color = 'pink', must be one of uncertainty, height"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/tf_timeout_s"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/pose_limits/settle_frames"));
  EXPECT_THAT(message, HasSubstr("storage/autosave_file = 'map.gpis', must be an absolute path"));
  EXPECT_THAT(message, HasSubstr("more_depth_topics[0] = '/a/image', must be there once"));
  EXPECT_THAT(message, HasSubstr("more_depth_topics[1] = '', must be the name of a topic"));
  EXPECT_THAT(message, HasSubstr("more_depth_topics[2] = 'not a topic', must be the name of a topic"));
  EXPECT_THAT(message, HasSubstr("more_depth_topics[4] = '~b', must be the name of a topic"));
  EXPECT_THAT(message, HasSubstr("sensor/max_range_m = -1 m, must be in [0.1, 50] m"));
}

}  // namespace
}  // namespace gpis_mapping_ros
