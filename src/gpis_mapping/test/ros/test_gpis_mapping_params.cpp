// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/gpis_mapping_params.h"

#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ros/ros.h>
#include <yaml-cpp/yaml.h>

#include <interactive_mapping_common/testing/temporary_folder.h>
#include <interactive_mapping_common_ros/testing/params_contract.h>

namespace gpis_mapping_ros {
namespace {

using test_support::messageOf;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

const std::string kConfigDir = GPIS_CONFIG_DIR;
const params_contract::Contract kContract = {
    kConfigDir + "/..",
    "config/gpis_mapping_node.yaml",
    toYaml(GpisMappingParams()),
    [](const ros::NodeHandle& nh) { return toYaml(loadGpisMappingParams(nh)); },
    {"input/pose_limits/settle_frames"},
    {{"input/map_frame", "odom"},
     {"input/camera_frame", "eye"},
     {"input/image_transport", "compressedDepth"},
     {"output/mesh_color", "uncertainty"},
     {"storage/autosave_file", "/map.gpis"}}};

TEST(GpisMappingParams, ShippedFileHasEveryKeyWithItsDefault) {
  params_contract::expectShippedFileHasEveryDefault(kContract);
}

TEST(GpisMappingParams, ShippedFilesLoadAsTheDefaults) {
  const GpisMappingParams params = loadGpisMappingParams(ros::NodeHandle("~shipped"));
  EXPECT_EQ(toYaml(params), toYaml(GpisMappingParams()));
  EXPECT_EQ(gpis_mapping::toYaml(params.map), gpis_mapping::toYaml(gpis_mapping::GpisConfig()));
}

TEST(GpisMappingParams, EveryKeyIsReadIntoItsOwnField) {
  params_contract::expectEveryKeyIsReadIntoItsOwnField(kContract, ros::NodeHandle("~changed"));
}

TEST(GpisMappingParams, ReadmeTableHasEveryKeyWithItsDefault) {
  params_contract::expectReadmeTableHasEveryDefault(kContract);
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
  const std::string message = messageOf<std::invalid_argument>([&] { loadGpisMappingParams(nh); });
  EXPECT_THAT(message, HasSubstr("/wrong/output/rate_hz = 100 Hz, must be in [0.05, 30] Hz"));
  EXPECT_THAT(message, HasSubstr("/wrong/output/mesh_colour is unknown"));
  EXPECT_THAT(message, HasSubstr("mesh_color = 'pink', must be uncertainty or height"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/tf_timeout_s"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/pose_limits/settle_frames"));
  EXPECT_THAT(message, HasSubstr("storage/autosave_file = 'map.gpis', must be an absolute path"));
  EXPECT_THAT(message, HasSubstr("sensor/max_range_m = -1 m, must be in [0.1, 50] m"));
}

}  // namespace
}  // namespace gpis_mapping_ros

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  ros::init(argc, argv, "test_gpis_mapping_params");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
