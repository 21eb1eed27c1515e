// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning_ros/motion_planning_params.h"

#include <fstream>
#include <functional>
#include <limits>
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

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::UnorderedElementsAre;

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
  static const std::set<std::string> kWhole = {
      "search/max_iterations", "search/shortcut_rounds", "search/smooth_rounds", "pick/yaw_samples",
      "pick/max_goals",        "view/samples",           "output/arm_markers"};
  return kWhole.count(key) > 0;
}

/// A value that is allowed, but not the default.
XmlRpc::XmlRpcValue otherThan(const std::string& key, const std::string& value) {
  static const Values kOtherTexts = {{"map_frame", "odom"},
                                     {"bricks_file", "/bricks.yaml"},
                                     {"sectors_file", "/sectors.yaml"},
                                     {"postures_dir", "/postures"},
                                     {"stow", "stowed"},
                                     {"inspect_posture", "aside"},
                                     {"view/camera_frame", "eye"}};
  const auto text = kOtherTexts.find(key);
  if (text != kOtherTexts.end()) return text->second;
  if (isWhole(key)) return std::stoi(value) + 1;
  if (std::stod(value) == 0.0) return 0.002;  // allowed for all lengths
  return 0.9 * std::stod(value);
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
  expected.sectors_file = "/sectors.yaml";
  expected.postures_dir = "/postures";
  EXPECT_EQ(toYaml(loadMotionPlanningParams(ros::NodeHandle("~shipped"))), toYaml(expected));
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
  nh.setParam("state/max_joint_age_s", 0.0);
  nh.setParam("search/max_iterations", 1.5);
  nh.setParam("scene/sigmas", -1.0);
  nh.setParam("pick/approach_m", "far");
  nh.setParam("motion/velocity_scale", 2.0);
  nh.setParam("monitor/rate_hz", 1000.0);
  const std::string message = messageOf(nh);
  EXPECT_THAT(message, HasSubstr("/wrong/bricks_file = 'bricks.yaml', must be the absolute path"));
  EXPECT_THAT(message, HasSubstr("/wrong/sectors_file = '', must be the absolute path"));
  EXPECT_THAT(message, HasSubstr("/wrong/colour is unknown"));
  EXPECT_THAT(message, HasSubstr("/wrong/state/max_joint_age_s = 0 s, must be in [0.01, 60] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/search/max_iterations"));
  EXPECT_THAT(message, HasSubstr("/wrong/scene/sigmas = -1"));
  EXPECT_THAT(message, HasSubstr("/wrong/pick/approach_m"));
  EXPECT_THAT(message, HasSubstr("/wrong/motion/velocity_scale = 2"));
  EXPECT_THAT(message, HasSubstr("/wrong/monitor/rate_hz = 1000 Hz, must be in [0.5, 100] Hz"));
}

// What is watched may have no more margin than what is planned with; who is wrong about the one is not told of the other.
TEST(MotionPlanningParams, AnImpossibleMarginIsOneProblemNotTwo) {
  MotionPlanningParams params;
  params.bricks_file = params.sectors_file = params.postures_dir = "/a";
  EXPECT_THAT(params.validate(), IsEmpty());
  params.scene.sigmas = -1.0;
  EXPECT_THAT(params.validate(), ElementsAre(HasSubstr("scene/sigmas = -1, must be in [0, 10]")));
  params.scene.sigmas = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(params.validate(), ElementsAre(HasSubstr("scene/sigmas = nan")));
  params.scene.sigmas = 20.0;
  EXPECT_THAT(params.validate(), ElementsAre(HasSubstr("scene/sigmas = 20")));
  params.monitor.sigmas = -0.5;  // impossible itself
  EXPECT_THAT(params.validate(), UnorderedElementsAre(HasSubstr("scene/sigmas = 20"),
                                                      HasSubstr("monitor/sigmas = -0.5, must be in [0, 10]")));
  params.scene.sigmas = 1.5;
  params.monitor.sigmas = 1.6;
  EXPECT_THAT(params.validate(), ElementsAre(HasSubstr("monitor/sigmas = 1.6, must be in [0, 1.5]")));
  params.monitor.sigmas = 1.5;
  params.scene.margin_m = -0.01;
  params.monitor.margin_m = 0.005;
  EXPECT_THAT(params.validate(), ElementsAre(HasSubstr("scene/margin_m = -0.01 m")));
  params.scene.margin_m = 0.01;
  params.planner.collision.self_padding_m = -0.01;
  params.monitor.self_padding_m = 0.005;
  EXPECT_THAT(params.validate(), ElementsAre(HasSubstr("collision/self_padding_m = -0.01 m")));
}

}  // namespace
}  // namespace motion_planning_ros

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  ros::init(argc, argv, "test_motion_planning_params");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
