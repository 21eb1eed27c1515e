// SPDX-License-Identifier: BSD-3-Clause
#include "depth_self_filter_ros/depth_self_filter_params.h"

#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <interactive_mapping_common/testing/shipped_file.h>
#include <ros/ros.h>

#include "gpis_mapping/gpis_config.h"

namespace depth_self_filter_ros {
namespace {

using interactive_mapping::toYaml;
using testing::HasSubstr;

const std::string kPackage = DEPTH_SELF_FILTER_DIR;

TEST(DepthSelfFilterParams, ShippedFileIsWhatTheFieldsSay) {
  test_support::expectShippedFile<DepthSelfFilterParams>(kPackage + "/config/depth_self_filter.yaml");
}

TEST(DepthSelfFilterParams, ShippedFileLoadsAsTheDefaults) {
  EXPECT_EQ(toYaml(loadDepthSelfFilterParams(ros::NodeHandle("~shipped"))), toYaml(DepthSelfFilterParams()));
}

TEST(DepthSelfFilterParams, CamerasAreThoseThatTheMapKnows) {
  for (const char* name : {"generic", "realsense", "azure_kinect"}) {
    const DepthSelfFilterParams params = loadDepthSelfFilterParams(ros::NodeHandle(std::string("~") + name));
    DepthSelfFilterParams others = params;
    others.mask.baseline_m = DepthSelfFilterParams().mask.baseline_m;
    others.mask.noise = DepthSelfFilterParams().mask.noise;
    EXPECT_EQ(toYaml(others), toYaml(DepthSelfFilterParams())) << name;
    if (std::string(name) == "generic") continue;
    const auto of_map =
        gpis_mapping::loadGpisConfig(kPackage + "/../gpis_mapping/config/cameras/" + name + ".yaml").sensor;
    EXPECT_EQ(params.mask.baseline_m, of_map.baseline_m) << name;
    EXPECT_EQ(params.mask.noise.a_m, of_map.noise.a_m) << name;
    EXPECT_EQ(params.mask.noise.b, of_map.noise.b) << name;
    EXPECT_EQ(params.mask.noise.c_per_m, of_map.noise.c_per_m) << name;
  }
  EXPECT_EQ(DepthSelfFilterParams().mask.baseline_m, gpis_mapping::GpisConfig().sensor.baseline_m);
}

TEST(DepthSelfFilterParams, OneMessageNamesEveryProblemWithValueAndRange) {
  ros::NodeHandle nh("~wrong");
  nh.setParam("input/camera_frame", "/eye");
  nh.setParam("input/wait_s", "soon");
  nh.setParam("input/depth_units_per_metre", 0.0);
  nh.setParam("input/image_transport", "");
  nh.setParam("joints/max_gap_s", 20.0);
  nh.setParam("mask/edge_px", 2.5);
  nh.setParam("mask/noise/b", -1.0);
  nh.setParam("mask/padding", 0.02);
  const std::string message = test_support::messageOf<std::invalid_argument>([&] { loadDepthSelfFilterParams(nh); });
  EXPECT_THAT(message, HasSubstr("/wrong/input/camera_frame = '/eye', must be a tf2 frame"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/wait_s"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/depth_units_per_metre = 0 1/m, must be in [1, 1.0e+06] 1/m"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/image_transport = '', must name a transport"));
  EXPECT_THAT(message, HasSubstr("/wrong/joints/max_gap_s = 20 s, must be in [0, 10] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/mask/edge_px"));
  EXPECT_THAT(message, HasSubstr("/wrong/mask/noise/b = -1, must be in [0, 0.1]"));
  EXPECT_THAT(message, HasSubstr("/wrong/mask/padding is unknown"));
}

TEST(DepthSelfFilterParams, SettingsOfLibrariesAreNotUnknown) {
  ros::NodeHandle nh("~libraries");
  nh.setParam("diagnostic_period", 0.5);
  nh.setParam("image_transport", "raw");
  nh.setParam("image_rect/compressedDepth/png_level", 5);
  EXPECT_NO_THROW(loadDepthSelfFilterParams(nh));
}

}  // namespace
}  // namespace depth_self_filter_ros
