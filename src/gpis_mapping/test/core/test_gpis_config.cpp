// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/gpis_config.h"

#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <interactive_mapping_common/testing/temporary_folder.h>

namespace gpis_mapping {
namespace {

using test_support::messageOf;
using test_support::readText;
using test_support::splitLines;
using testing::HasSubstr;
using testing::Not;

const std::string kConfigDir = GPIS_CONFIG_DIR;

std::set<std::string> keysOf(const std::string& yaml_text) {
  std::set<std::string> keys;
  for (const auto& entry : YAML::Load(yaml_text)) {
    const auto section = entry.first.as<std::string>();
    if (!entry.second.IsMap()) keys.insert(section);
    if (!entry.second.IsMap()) continue;
    for (const auto& item : entry.second) keys.insert(section + "/" + item.first.as<std::string>());
  }
  return keys;
}

std::string refusalOf(const std::string& yaml_text) {
  return messageOf<std::invalid_argument>([&] { parseGpisConfig(yaml_text, "here.yaml"); });
}

TEST(GpisConfig, DefaultsAreValid) {
  EXPECT_THAT(GpisConfig{}.validate(), testing::IsEmpty());
}

TEST(GpisConfig, ShippedFileHasEveryKeyWithItsDefault) {
  const std::string path = kConfigDir + "/gpis_mapping.yaml";
  EXPECT_EQ(toYaml(loadGpisConfig(path)), toYaml(GpisConfig{}));
  EXPECT_EQ(keysOf(readText(path)), keysOf(toYaml(GpisConfig{})));
}

TEST(GpisConfig, ShippedFileExplainsEveryKey) {
  for (const std::string& line : splitLines(readText(kConfigDir + "/gpis_mapping.yaml"))) {
    const std::size_t colon = line.find(": ");
    if (colon == std::string::npos || line.find('#') < colon) continue;
    EXPECT_NE(line.find("# ", colon), std::string::npos) << line;
  }
}

TEST(GpisConfig, ReadmeTableHasEveryKeyWithItsDefault) {
  const std::string readme = readText(kConfigDir + "/../README.md");
  int rows = 0;
  for (const std::string& line : splitLines(readText(kConfigDir + "/gpis_mapping.yaml"))) {
    const std::size_t colon = line.find(": ");
    const std::size_t comment = line.find(" #");
    if (colon == std::string::npos || line.find('#') < colon) continue;
    const std::string key = line.substr(line.find_first_not_of(' '), colon - line.find_first_not_of(' '));
    std::string value = line.substr(colon + 2, comment - colon - 2);
    value.erase(value.find_last_not_of(' ') + 1);
    if (value.empty()) continue;
    const bool in_section = key.size() + 2 == colon && line[0] == ' ';
    EXPECT_THAT(readme, HasSubstr((in_section ? "/" : "`") + key + "` | " + value + " |"));
    ++rows;
  }
  EXPECT_GT(rows, 30);
}

TEST(GpisConfig, BenchmarkFileChangesRangeAndRegionOnly) {
  const GpisConfig bench = loadGpisConfig(kConfigDir + "/bench.yaml");
  GpisConfig expected;
  expected.sensor.max_range_m = 3.5;
  for (const int axis : {0, 1}) {
    expected.region.min_m[axis] = -1.6;
    expected.region.max_m[axis] = 1.6;
  }
  EXPECT_EQ(toYaml(bench), toYaml(expected));
}

TEST(GpisConfig, EmptyTextGivesTheDefaults) {
  EXPECT_EQ(toYaml(parseGpisConfig("", "")), toYaml(GpisConfig{}));
}

TEST(GpisConfig, YamlRoundTripKeepsEveryValue) {
  GpisConfig config;
  config.sensor.max_range_m = 1.0 / 3.0 + 3.0;  // not a short decimal
  config.sensor.noise.b = -1e-5;
  config.sensor.hole_policy = HolePolicy::kNoInformation;
  config.frame_map.tile_px = 11;
  config.dynamic.enabled = false;
  config.region.min_m = Eigen::Vector3d(-0.1, -1e7 / 3.0, 0.3);
  config.threads = 3;
  const GpisConfig parsed = parseGpisConfig(toYaml(config), "round trip");
  EXPECT_EQ(parsed.sensor.max_range_m, config.sensor.max_range_m);
  EXPECT_EQ(parsed.sensor.noise.b, config.sensor.noise.b);
  EXPECT_EQ(parsed.sensor.hole_policy, config.sensor.hole_policy);
  EXPECT_EQ(parsed.frame_map.tile_px, config.frame_map.tile_px);
  EXPECT_EQ(parsed.dynamic.enabled, config.dynamic.enabled);
  EXPECT_EQ(parsed.region.min_m, config.region.min_m);
  EXPECT_EQ(parsed.threads, config.threads);
  EXPECT_EQ(toYaml(parsed), toYaml(config));
}

TEST(GpisConfig, RefusesUnknownKeys) {
  EXPECT_THAT(refusalOf("sensor: {max_rnage_m: 3.0}"), HasSubstr("unknown key sensor/max_rnage_m"));
  EXPECT_THAT(refusalOf("sensors: {max_range_m: 3.0}"), HasSubstr("unknown key sensors"));
  EXPECT_THAT(refusalOf("max_range_m: 3.0"), HasSubstr("unknown key max_range_m"));
}

TEST(GpisConfig, RefusesWrongTypes) {
  EXPECT_THAT(refusalOf("sensor: {max_range_m: far}"), HasSubstr("sensor/max_range_m = 'far', must be a number"));
  EXPECT_THAT(refusalOf("frame_map: {tile_px: 8.5}"), HasSubstr("frame_map/tile_px = '8.5', must be a whole number"));
  EXPECT_THAT(refusalOf("dynamic: {enabled: 2}"), HasSubstr("dynamic/enabled"));
  EXPECT_THAT(refusalOf("sensor: {hole_policy: maybe}"), HasSubstr("must be one of auto, no_information, wall"));
  EXPECT_THAT(refusalOf("region: {min_m: [1, 2]}"), HasSubstr("region/min_m has 2 numbers, must have 3"));
  EXPECT_THAT(refusalOf("sensor: 3"), HasSubstr("sensor must be a section"));
  EXPECT_THAT(refusalOf("[1, 2]"), HasSubstr("must be a map of keys"));
  EXPECT_THAT(refusalOf("sensor: {"), HasSubstr("not YAML"));
}

TEST(GpisConfig, WholeNumbersAreNumbers) {
  EXPECT_EQ(parseGpisConfig("sensor: {max_range_m: 3}", "").sensor.max_range_m, 3.0);
}

TEST(GpisConfig, OneMessageListsEverythingThatIsWrong) {
  const std::string message = refusalOf(
      "sensor: {max_range_m: -1, min_range_m: .nan, baseline_m: wide}\n"
      "cells: {size_m: 7.5}\n"
      "threads: 257\n"
      "surfaces: 1\n");
  EXPECT_THAT(message, HasSubstr("here.yaml"));
  EXPECT_THAT(message, HasSubstr("sensor/max_range_m = -1 m, must be in [0.1, 50] m"));
  EXPECT_THAT(message, HasSubstr("sensor/min_range_m = nan m"));
  EXPECT_THAT(message, HasSubstr("sensor/baseline_m = 'wide'"));
  EXPECT_THAT(message, HasSubstr("cells/size_m = 7.5 m, must be in [0.02, 1] m"));
  EXPECT_THAT(message, HasSubstr("threads = 257"));
  EXPECT_THAT(message, HasSubstr("unknown key surfaces"));
}

TEST(GpisConfig, RefusesContradictions) {
  EXPECT_THAT(refusalOf("sensor: {min_range_m: 4.5}"), HasSubstr("sensor/min_range_m must be below"));
  EXPECT_THAT(refusalOf("region: {min_m: [0, 0, 5], max_m: [1, 1, 4]}"), HasSubstr("region/min_m must be below"));
  EXPECT_THAT(refusalOf("cells: {blend_margin_m: 0.05}"), HasSubstr("cells/blend_margin_m"));
  EXPECT_THAT(refusalOf("region: {min_m: [0, 0, .inf]}"), HasSubstr("region/min_m must be three finite numbers"));
}

TEST(GpisConfig, PresetsGiveNoiseThatGrowsWithDistance) {
  for (const std::string& name : DepthNoiseModel::presetNames()) {
    const GpisConfig config = parseGpisConfig("sensor: {noise_preset: " + name + "}", name);
    const DepthNoiseModel preset = DepthNoiseModel::preset(name);
    EXPECT_EQ(config.sensor.noise.a_m, preset.a_m) << name;
    EXPECT_EQ(config.sensor.noise.b, preset.b) << name;
    EXPECT_EQ(config.sensor.noise.c_per_m, preset.c_per_m) << name;
    EXPECT_GT(preset.sigma(4.0), preset.sigma(1.0)) << name;
  }
}

TEST(GpisConfig, CoefficientOverridesThePreset) {
  const GpisConfig config = parseGpisConfig("sensor: {noise_c_per_m: 0.005, noise_preset: kinect_v1}", "");
  EXPECT_EQ(config.sensor.noise.c_per_m, 0.005);
  EXPECT_EQ(config.sensor.noise.a_m, DepthNoiseModel::preset("kinect_v1").a_m);
}

TEST(GpisConfig, UnknownPresetNamesTheKnownOnes) {
  const std::string message = refusalOf("sensor: {noise_preset: kinect}");
  EXPECT_THAT(message, HasSubstr("'kinect'"));
  EXPECT_THAT(message, HasSubstr("azure_kinect, generic, kinect_v1"));
}

TEST(GpisConfig, AFolderIsNoConfiguration) {
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { loadGpisConfig(kConfigDir); }), HasSubstr(kConfigDir));
}

TEST(GpisConfig, AKeyGivenTwiceIsRefused) {
  EXPECT_THAT(refusalOf("sensor:\n  max_range_m: 3.0\n  max_range_m: 2.0\n"),
              HasSubstr("key sensor/max_range_m is given twice"));
  EXPECT_THAT(refusalOf("threads: 1\nthreads: 2\n"), HasSubstr("key threads is given twice"));
}

TEST(GpisConfig, ListsAndMapsAreNoKeys) {
  for (const std::string text : {"? [a, b]\n: 1\n", "sensor:\n  ? {a: b}\n  : 1\n", "[]: {}\n", "~: 1\n"}) {
    EXPECT_THAT(refusalOf(text), HasSubstr("unknown key")) << text;
  }
}

TEST(GpisConfig, WritesNumbersOfAnySize) {
  GpisConfig config;
  config.sensor.baseline_m = 1e-310;  // denormal: too small for std::stod, and within the range
  EXPECT_EQ(parseGpisConfig(toYaml(config), "written").sensor.baseline_m, 1e-310);
}

TEST(GpisConfig, MissingFileIsNamed) {
  EXPECT_THAT(messageOf<std::invalid_argument>([] { loadGpisConfig("/no/such.yaml"); }), HasSubstr("/no/such.yaml"));
  EXPECT_THAT(refusalOf("threads: 1"), Not(HasSubstr("here")));
}

}  // namespace
}  // namespace gpis_mapping
