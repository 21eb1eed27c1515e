// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/gpis_mapping_params.h"

#include <map>
#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ros/ros.h>
#include <yaml-cpp/yaml.h>

#include "../support/temporary_folder.h"

namespace gpis_mapping_ros {
namespace {

using test_support::messageOf;
using test_support::readText;
using testing::HasSubstr;

const std::string kConfigDir = GPIS_CONFIG_DIR;
using Values = std::map<std::string, std::string>;

/// "input/pose_limits/max_step_m" -> "0.3". Numbers that are equal are the same text.
void flatten(const YAML::Node& node, const std::string& prefix, Values* values) {
  for (const auto& entry : node) {
    const std::string key = prefix + entry.first.as<std::string>();
    double number = 0.0;
    if (entry.second.IsMap()) {
      flatten(entry.second, key + "/", values);
    } else if (YAML::convert<double>::decode(entry.second, number)) {
      (*values)[key] = std::to_string(number);
    } else {
      (*values)[key] = entry.second.as<std::string>();
    }
  }
}

Values flattened(const std::string& yaml_text) {
  Values values;
  flatten(YAML::Load(yaml_text), "", &values);
  return values;
}

const Values kDefaults = flattened(toYaml(GpisMappingParams()));

/// A value that is allowed, but not the default.
XmlRpc::XmlRpcValue otherThan(const std::string& key, const std::string& value) {
  static const Values other_texts = {{"input/map_frame", "odom"},
                                     {"input/camera_frame", "eye"},
                                     {"input/image_transport", "compressedDepth"},
                                     {"output/mesh_color", "height"},
                                     {"storage/autosave_file", "/map.gpis"}};
  const auto text = other_texts.find(key);
  if (text != other_texts.end()) return text->second;
  if (value == "true" || value == "false") return value == "false";
  if (key == "input/pose_limits/settle_frames") return std::stoi(value) + 1;
  return 0.75 * std::stod(value);
}

TEST(GpisMappingParams, ShippedFileHasEveryKeyWithItsDefault) {
  EXPECT_EQ(flattened(readText(kConfigDir + "/gpis_mapping_node.yaml")), kDefaults);
}

TEST(GpisMappingParams, ShippedFilesLoadAsTheDefaults) {
  const GpisMappingParams params = loadGpisMappingParams(ros::NodeHandle("~shipped"));
  EXPECT_EQ(toYaml(params), toYaml(GpisMappingParams()));
  EXPECT_EQ(gpis_mapping::toYaml(params.map), gpis_mapping::toYaml(gpis_mapping::GpisConfig()));
}

TEST(GpisMappingParams, EveryKeyIsReadIntoItsOwnField) {
  ros::NodeHandle nh("~changed");
  Values expected;
  for (const auto& [key, value] : kDefaults) {
    const XmlRpc::XmlRpcValue other = otherThan(key, value);
    nh.setParam(key, other);
    YAML::Node parsed;
    XmlRpc::XmlRpcValue copy = other;
    if (copy.getType() == XmlRpc::XmlRpcValue::TypeDouble) {
      parsed[key] = static_cast<double>(copy);
    } else if (copy.getType() == XmlRpc::XmlRpcValue::TypeInt) {
      parsed[key] = static_cast<int>(copy);
    } else if (copy.getType() == XmlRpc::XmlRpcValue::TypeBoolean) {
      parsed[key] = static_cast<bool>(copy);
    } else {
      parsed[key] = static_cast<std::string>(copy);
    }
    flatten(parsed, "", &expected);
    EXPECT_NE(expected[key], value) << key;
  }
  EXPECT_EQ(flattened(toYaml(loadGpisMappingParams(nh))), expected);
}

TEST(GpisMappingParams, ReadmeTableHasEveryKeyWithItsDefault) {
  const std::string readme = readText(kConfigDir + "/../README.md");
  const YAML::Node shipped = YAML::LoadFile(kConfigDir + "/gpis_mapping_node.yaml");
  int rows = 0;
  const auto expectRow = [&](const std::string& key, const std::string& value) {
    const std::string row = "| `" + key + "` | " + (value.empty() ? "\"\"" : value) + " |";
    EXPECT_NE(readme.find(row), std::string::npos) << row;
    ++rows;
  };
  for (const auto& section : shipped) {
    for (const auto& entry : section.second) {
      const std::string key = section.first.as<std::string>() + "/" + entry.first.as<std::string>();
      if (!entry.second.IsMap()) {
        expectRow(key, entry.second.Scalar());
        continue;
      }
      for (const auto& deep : entry.second) expectRow(key + "/" + deep.first.as<std::string>(), deep.second.Scalar());
    }
  }
  EXPECT_EQ(rows, static_cast<int>(kDefaults.size()));
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
