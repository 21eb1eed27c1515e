// SPDX-License-Identifier: BSD-3-Clause
#include "depth_self_filter_ros/depth_self_filter_params.h"

#include <fstream>
#include <functional>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ros/ros.h>
#include <yaml-cpp/yaml.h>

#include "gpis_mapping/gpis_config.h"

namespace depth_self_filter_ros {
namespace {

using testing::HasSubstr;

const std::string kPackage = DEPTH_SELF_FILTER_DIR;
using Values = std::map<std::string, std::string>;

std::string readText(const std::string& path) {
  std::ifstream in(path);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// "mask/noise/a_m" -> "0.0005". With `as_written`, else numbers that are equal are the same text.
void flatten(const YAML::Node& node, const std::string& prefix, bool as_written, Values* values) {
  for (const auto& entry : node) {
    const std::string key = prefix + entry.first.as<std::string>();
    double number = 0.0;
    if (entry.second.IsMap()) {
      flatten(entry.second, key + "/", as_written, values);
    } else if (!as_written && YAML::convert<double>::decode(entry.second, number)) {
      (*values)[key] = std::to_string(number);
    } else {
      (*values)[key] = entry.second.as<std::string>();
    }
  }
}

Values flattened(const std::string& yaml_text, bool as_written = false) {
  Values values;
  flatten(YAML::Load(yaml_text), "", as_written, &values);
  return values;
}

const Values kDefaults = flattened(toYaml(DepthSelfFilterParams()));

TEST(DepthSelfFilterParams, ShippedFileHasEveryKeyWithItsDefault) {
  EXPECT_EQ(flattened(readText(kPackage + "/config/depth_self_filter.yaml")), kDefaults);
  EXPECT_EQ(toYaml(loadDepthSelfFilterParams(ros::NodeHandle("~shipped"))), toYaml(DepthSelfFilterParams()));
}

TEST(DepthSelfFilterParams, ReadmeTableHasEveryKeyWithItsDefault) {
  const std::string readme = readText(kPackage + "/README.md");
  const Values shipped = flattened(readText(kPackage + "/config/depth_self_filter.yaml"), true);
  ASSERT_EQ(shipped.size(), kDefaults.size());
  for (const auto& [key, value] : shipped) {
    const std::string row = "| `" + key + "` | " + (value.empty() ? "\"\"" : value) + " |";
    EXPECT_NE(readme.find(row), std::string::npos) << row;
  }
}

TEST(DepthSelfFilterParams, CamerasAreThoseThatTheMapKnows) {
  for (const char* name : {"generic", "realsense", "azure_kinect"}) {
    const DepthSelfFilterParams params = loadDepthSelfFilterParams(ros::NodeHandle(std::string("~") + name));
    for (const auto& [key, value] : flattened(toYaml(params))) {
      if (key == "mask/baseline_m" || key.rfind("mask/noise/", 0) == 0) continue;
      EXPECT_EQ(value, kDefaults.at(key)) << name << " " << key;
    }
    if (std::string(name) == "generic") continue;
    const YAML::Node of_map = YAML::LoadFile(kPackage + "/../gpis_mapping/config/cameras/" + name + ".yaml")["sensor"];
    EXPECT_EQ(params.mask.baseline_m, of_map["baseline_m"].as<double>()) << name;
    EXPECT_EQ(params.mask.noise.a_m, of_map["noise_a_m"].as<double>()) << name;
    EXPECT_EQ(params.mask.noise.b, of_map["noise_b"].as<double>()) << name;
    EXPECT_EQ(params.mask.noise.c_per_m, of_map["noise_c_per_m"].as<double>()) << name;
  }
  EXPECT_EQ(DepthSelfFilterParams().mask.baseline_m, gpis_mapping::GpisConfig().sensor.baseline_m);
}

TEST(DepthSelfFilterParams, EveryKeyIsReadIntoItsOwnField) {
  ros::NodeHandle nh("~changed");
  Values expected;
  for (const auto& [key, value] : kDefaults) {
    if (key == "input/camera_frame" || key == "input/image_transport") {
      nh.setParam(key, "other");
      expected[key] = "other";
    } else if (key == "mask/edge_px") {
      nh.setParam(key, 3);
      expected[key] = std::to_string(3.0);
    } else {
      // Apart for each key, and below every upper limit.
      const double other = 0.55 * std::stod(value) + 0.00001 * static_cast<double>(expected.size() + 1);
      nh.setParam(key, other);
      expected[key] = std::to_string(other);
    }
    EXPECT_NE(expected[key], value) << key;
  }
  EXPECT_EQ(flattened(toYaml(loadDepthSelfFilterParams(nh))), expected);
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
  std::string message;
  try {
    loadDepthSelfFilterParams(nh);
  } catch (const std::invalid_argument& error) {
    message = error.what();
  }
  EXPECT_THAT(message, HasSubstr("/wrong/input/camera_frame = '/eye', must be a tf2 frame"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/wait_s"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/depth_units_per_metre = 0 1/m, must be in [1, 1e+06] 1/m"));
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

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  ros::init(argc, argv, "test_depth_self_filter_params");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
