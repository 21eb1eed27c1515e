// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning_ros/motion_planning_params.h"

#include <fstream>
#include <functional>
#include <map>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ros/ros.h>
#include <yaml-cpp/yaml.h>

namespace motion_planning_ros {
namespace {

using testing::HasSubstr;

const std::string kPackage = MOTION_PLANNING_DIR;
using Values = std::map<std::string, std::string>;

std::string readText(const std::string& path) {
  std::ifstream in(path);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

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

const Values kDefaults = flattened(toYaml(MotionPlanningParams()));

bool isWhole(const std::string& key) {
  static const std::set<std::string> kWhole = {"input/pose_limits/settle_frames",
                                               "detector/threads",
                                               "detector/max_hamming",
                                               "pose/max_hamming",
                                               "pose/depth/min_pixels",
                                               "tracker/looks_per_standpoint",
                                               "tracker/moved_looks",
                                               "tracker/inside_samples"};
  return kWhole.count(key) > 0;
}

/// A value that is allowed, but not the default.
XmlRpc::XmlRpcValue otherThan(const std::string& key, const std::string& value) {
  static const Values kOtherTexts = {{"bricks_file", "/bricks.yaml"},
                                     {"input/map_frame", "odom"},
                                     {"input/camera_frame", "eye"},
                                     {"input/image_transport", "compressed"},
                                     {"input/depth_transport", "compressedDepth"}};
  const auto text = kOtherTexts.find(key);
  if (text != kOtherTexts.end()) return text->second;
  if (value == "true" || value == "false") return value == "false";
  if (key == "detector/decimate") return 2.0;
  if (key == "pose/depth/grow") return 1.1;     // not below 1
  if (key == "detector/max_hamming") return 1;  // not above 2
  if (isWhole(key)) return std::stoi(value) + 1;
  return 0.75 * std::stod(value);
}

std::string messageOf(const ros::NodeHandle& nh) {
  try {
    loadMotionPlanningParams(nh);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(MotionPlanningParams, ShippedFileHasEveryKeyWithItsDefault) {
  EXPECT_EQ(flattened(readText(kPackage + "/config/motion_planning.yaml")), kDefaults);
}

TEST(MotionPlanningParams, ShippedFileLoadsAsTheDefaults) {
  MotionPlanningParams expected;
  expected.bricks_file = "/bricks.yaml";  // what a launch file has to give
  EXPECT_EQ(toYaml(loadMotionPlanningParams(ros::NodeHandle("~shipped"))), toYaml(expected));
}

TEST(MotionPlanningParams, ShippedCamerasChangeNothingButTheDepthsNoise) {
  for (const char* camera : {"generic", "realsense", "azure_kinect"}) {
    ros::NodeHandle nh(std::string("~") + camera);
    nh.setParam("bricks_file", "/bricks.yaml");
    for (const auto& [key, value] : flattened(toYaml(loadMotionPlanningParams(nh)))) {
      if (key == "bricks_file" || key.rfind("pose/depth/", 0) == 0) continue;
      EXPECT_EQ(value, kDefaults.at(key)) << camera << " " << key;
    }
  }
  EXPECT_DOUBLE_EQ(loadMotionPlanningParams(ros::NodeHandle("~realsense")).detection.pose.depth.inverse_depth_std,
                   0.0038);
}

TEST(MotionPlanningParams, EveryKeyIsReadIntoItsOwnField) {
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
  EXPECT_EQ(flattened(toYaml(loadMotionPlanningParams(nh))), expected);
}

TEST(MotionPlanningParams, ReadmeTableHasEveryKeyWithItsDefault) {
  const std::string readme = readText(kPackage + "/README.md");
  Values shipped;
  const std::function<void(const YAML::Node&, const std::string&)> collect = [&](const YAML::Node& node,
                                                                                 const std::string& prefix) {
    for (const auto& entry : node) {
      const std::string key = prefix + entry.first.as<std::string>();
      if (entry.second.IsMap()) {
        collect(entry.second, key + "/");
      } else {
        shipped[key] = entry.second.Scalar();
      }
    }
  };
  collect(YAML::LoadFile(kPackage + "/config/motion_planning.yaml"), "");
  ASSERT_EQ(shipped.size(), kDefaults.size());
  for (const auto& [key, value] : shipped) {
    const std::string row = "| `" + key + "` | " + (value.empty() ? "\"\"" : value) + " |";
    EXPECT_NE(readme.find(row), std::string::npos) << row;
  }
}

TEST(MotionPlanningParams, OneMessageNamesEveryProblemWithValueAndRange) {
  ros::NodeHandle nh("~wrong");
  nh.setParam("bricks_file", "bricks.yaml");
  nh.setParam("colour", true);
  nh.setParam("detect/timeout_s", 0.0);
  nh.setParam("input/depth_timeout_s", "soon");
  nh.setParam("input/max_depth_offset_s", 2.0);
  nh.setParam("tracker/moved_looks", 1.5);
  nh.setParam("access/min_clear", 2.0);
  nh.setParam("alvar/position_std_m", -0.01);
  const std::string message = messageOf(nh);
  EXPECT_THAT(message, HasSubstr("/wrong/bricks_file = 'bricks.yaml', must be the absolute path"));
  EXPECT_THAT(message, HasSubstr("/wrong/colour is unknown"));
  EXPECT_THAT(message, HasSubstr("/wrong/detect/timeout_s = 0 s, must be in [0.01, 600] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/depth_timeout_s"));
  EXPECT_THAT(message, HasSubstr("/wrong/input/max_depth_offset_s = 2 s, must be in [0, 1] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/tracker/moved_looks"));
  EXPECT_THAT(message, HasSubstr("/wrong/access/min_clear = 2, must be in [0, 1]"));
  EXPECT_THAT(message, HasSubstr("/wrong/alvar/position_std_m = -0.01 m, must be in [1e-05, 1] m"));
}

TEST(MotionPlanningParams, SettingsOfLibrariesAreNotUnknown) {
  ros::NodeHandle nh("~libraries");
  nh.setParam("bricks_file", "/bricks.yaml");
  nh.setParam("diagnostic_period", 0.5);
  nh.setParam("image_transport", "raw");
  nh.setParam("image/compressed/jpeg_quality", 80);  // left by image_transport's publisher of an earlier run
  EXPECT_EQ(messageOf(nh), "");
}

}  // namespace
}  // namespace motion_planning_ros

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  ros::init(argc, argv, "test_motion_planning_params");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
