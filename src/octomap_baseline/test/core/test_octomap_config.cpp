// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline/octomap_config.h"

#include <fstream>
#include <set>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

namespace octomap_baseline {
namespace {

using testing::HasSubstr;

const std::string kConfigDir = OCTOMAP_CONFIG_DIR;

std::string readText(const std::string& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

std::set<std::string> keysOf(const std::string& yaml_text) {
  std::set<std::string> keys;
  for (const auto& entry : YAML::Load(yaml_text)) {
    const auto section = entry.first.as<std::string>();
    if (!entry.second.IsMap()) {
      keys.insert(section);
      continue;
    }
    for (const auto& item : entry.second) keys.insert(section + "/" + item.first.as<std::string>());
  }
  return keys;
}

std::string refusalOf(const std::string& yaml_text) {
  try {
    parseOctomapConfig(yaml_text, "here.yaml");
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

TEST(OctomapConfig, DefaultsAreValid) {
  EXPECT_THAT(OctomapConfig{}.validate(), testing::IsEmpty());
}

TEST(OctomapConfig, ShippedFileHasEveryKeyWithItsDefault) {
  const std::string path = kConfigDir + "/octomap_baseline.yaml";
  EXPECT_EQ(toYaml(loadOctomapConfig(path)), toYaml(OctomapConfig{}));
  EXPECT_EQ(keysOf(readText(path)), keysOf(toYaml(OctomapConfig{})));
}

TEST(OctomapConfig, ReadmeTableHasEveryKeyWithItsDefault) {
  const std::string readme = readText(kConfigDir + "/../README.md");
  const YAML::Node root = YAML::Load(toYaml(OctomapConfig{}));
  int rows = 0;
  const auto check = [&](const std::string& key, const YAML::Node& value) {
    std::string text;
    if (value.IsSequence()) {
      for (const auto& item : value) text += (text.empty() ? "[" : ", ") + item.Scalar();
      text += "]";
    } else {
      text = value.Scalar();
    }
    EXPECT_THAT(readme, HasSubstr("| `" + key + "` | " + text + " |"));
    ++rows;
  };
  for (const auto& entry : root) {
    const auto section = entry.first.as<std::string>();
    if (section == "sensor") continue;  // gpis_mapping's README has them
    if (!entry.second.IsMap()) {
      check(section, entry.second);
      continue;
    }
    for (const auto& item : entry.second) check(section + "/" + item.first.as<std::string>(), item.second);
  }
  EXPECT_GT(rows, 12);
}

TEST(OctomapConfig, YamlRoundTripKeepsEveryValue) {
  OctomapConfig config;
  config.resolution_m = 1.0 / 30.0;  // not a short decimal
  config.sensor.max_range_m = 2.5;
  config.sensor.hole_policy = gpis_mapping::HolePolicy::kWall;
  config.occupancy = {0.8, 0.3, 0.2, 0.9, 0.6};
  config.dynamic.enabled = false;
  config.dynamic.virtual_wall = false;
  config.dynamic.policy = ForgetPolicy::kOdds;
  config.dynamic.tolerance_sigmas = 1.5;
  config.dynamic.min_tolerance_m = 0.005;
  config.dynamic.least_share = 0.7;
  config.region.min_m = Eigen::Vector3d(-0.1, -1e7 / 3.0, 0.3);
  config.region.max_m = Eigen::Vector3d(0.1, 2.0, 0.4);
  config.threads = 3;
  const OctomapConfig parsed = parseOctomapConfig(toYaml(config), "round trip");
  EXPECT_EQ(toYaml(parsed), toYaml(config));
  EXPECT_EQ(parsed.resolution_m, config.resolution_m);
  EXPECT_EQ(parsed.sensor.max_range_m, 2.5);
  EXPECT_EQ(parsed.sensor.hole_policy, gpis_mapping::HolePolicy::kWall);
  EXPECT_EQ(parsed.occupancy.prob_miss, 0.3);
  EXPECT_EQ(parsed.dynamic.policy, ForgetPolicy::kOdds);
  EXPECT_FALSE(parsed.dynamic.enabled);
  EXPECT_EQ(parsed.region.min_m, config.region.min_m);
  EXPECT_EQ(parsed.threads, 3);
}

TEST(OctomapConfig, EmptyTextGivesTheDefaults) {
  EXPECT_EQ(toYaml(parseOctomapConfig("", "")), toYaml(OctomapConfig{}));
}

TEST(OctomapConfig, NoisePresetStandsForItsCoefficients) {
  const OctomapConfig config = parseOctomapConfig("sensor: {noise_preset: kinect_v2}", "");
  EXPECT_EQ(config.sensor.noise.a_m, gpis_mapping::DepthNoiseModel::preset("kinect_v2").a_m);
}

TEST(OctomapConfig, RefusesAllProblemsInOneMessage) {
  const std::string refusal = refusalOf(
      "resolution_m: fine\nresolutoin_m: 0.1\nsensor: {max_range_m: -1, min_rnage_m: 2}\noccupancy: {prob_hit: 0.4, "
      "clamp_min: 0.3, clamp_min: 0.3}\ndynamic: {policy: maybe, enabled: 3, tolerance: 1}\nregion: {min_m: [1, 2]}\n");
  for (const char* problem :
       {"here.yaml: refused:", "resolution_m = 'fine', must be a number", "unknown key resolutoin_m",
        "sensor/max_range_m = -1 m, must be in [0.1, 50] m", "unknown key sensor/min_rnage_m",
        "occupancy/prob_hit = 0.4, must be in [0.501, 0.999]", "key occupancy/clamp_min is given twice",
        "dynamic/policy = 'maybe', must be one of odds, seen_through", "dynamic/enabled = '3', must be true or false",
        "unknown key dynamic/tolerance", "region/min_m has 2 numbers, must have 3"}) {
    EXPECT_THAT(refusal, HasSubstr(problem));
  }
}

TEST(OctomapConfig, RefusesValuesThatContradictEachOther) {
  EXPECT_THAT(refusalOf("occupancy: {threshold: 0.98}"), HasSubstr("between occupancy/clamp_min"));
  EXPECT_THAT(refusalOf("region: {min_m: [0, 0, 0], max_m: [1, 0, 1]}"), HasSubstr("region/min_m must be below"));
  EXPECT_THAT(refusalOf("sensor: {min_range_m: 5}"), HasSubstr("sensor/min_range_m must be below"));
  EXPECT_THAT(refusalOf("resolution_m: .nan"), HasSubstr("resolution_m = nan m"));
}

TEST(OctomapConfig, RefusesWhatIsNoMapOfKeys) {
  EXPECT_THAT(refusalOf("- 1\n- 2"), HasSubstr("must be a map of keys"));
  EXPECT_THAT(refusalOf("a: [1"), HasSubstr("not YAML"));
  EXPECT_THAT(refusalOf("occupancy: 3"), HasSubstr("occupancy must be a section with keys"));
  EXPECT_THAT(refusalOf("sensor: 3"), HasSubstr("sensor must be a section with keys"));
  EXPECT_THROW(loadOctomapConfig("/nowhere.yaml"), std::invalid_argument);
}

TEST(OctomapConfig, AcceptsEveryRangeThatTheSensorMayHave) {
  EXPECT_EQ(parseOctomapConfig("sensor: {max_range_m: 50}", "").sensor.max_range_m, 50.0);
}

}  // namespace
}  // namespace octomap_baseline
