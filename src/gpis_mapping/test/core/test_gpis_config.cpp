// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/gpis_config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <interactive_mapping_common/testing/shipped_file.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

namespace gpis_mapping {
namespace {

using test_support::messageOf;
using testing::HasSubstr;
using testing::Not;

const std::string kConfigDir = GPIS_CONFIG_DIR;

std::string refusalOf(const std::string& yaml_text) {
  return messageOf<std::invalid_argument>([&] { parseGpisConfig(yaml_text, "here.yaml"); });
}

TEST(GpisConfig, DefaultsAreValid) {
  EXPECT_THAT(GpisConfig{}.validate(), testing::IsEmpty());
}

TEST(GpisConfig, ShippedFileIsWhatTheFieldsSay) {
  test_support::expectShippedFile<GpisConfig>(kConfigDir + "/gpis_mapping.yaml");
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

TEST(GpisConfig, OneMessageListsEverythingThatIsWrong) {
  const std::string message = refusalOf(
      "sensor: {max_range_m: -1, min_range_m: .nan, baseline_m: wide}\n"
      "cells: {size_m: 7.5}\n"
      "threads: 257\n"
      "surfaces: 1\n");
  EXPECT_THAT(message, HasSubstr("here.yaml"));
  EXPECT_THAT(message, HasSubstr("sensor/max_range_m = -1 m, must be in [0.1, 50] m"));
  EXPECT_THAT(message, HasSubstr("sensor/min_range_m = nan m"));
  EXPECT_THAT(message, HasSubstr("sensor/baseline_m = wide"));
  EXPECT_THAT(message, HasSubstr("cells/size_m = 7.5 m, must be in [0.02, 1] m"));
  EXPECT_THAT(message, HasSubstr("threads = 257"));
  EXPECT_THAT(message, HasSubstr("surfaces is unknown"));
}

TEST(GpisConfig, RefusesContradictions) {
  EXPECT_THAT(refusalOf("sensor: {min_range_m: 4.5}"), HasSubstr("sensor/min_range_m must be below"));
  EXPECT_THAT(refusalOf("region: {min_m: [0, 0, 5], max_m: [1, 1, 4]}"), HasSubstr("region/min_m must be below"));
  EXPECT_THAT(refusalOf("cells: {blend_margin_m: 0.05}"), HasSubstr("cells/blend_margin_m"));
  EXPECT_THAT(refusalOf("region: {min_m: [0, 0, .inf]}"), HasSubstr("region/min_m = [0, 0, inf] m, must be in"));
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
  EXPECT_THAT(message, HasSubstr("sensor/noise_preset = kinect, must be one of"));
  EXPECT_THAT(message, HasSubstr("azure_kinect, generic, kinect_v1"));
}

TEST(GpisConfig, AFolderIsNoConfiguration) {
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { loadGpisConfig(kConfigDir); }), HasSubstr(kConfigDir));
}

TEST(GpisConfig, MissingFileIsNamed) {
  EXPECT_THAT(messageOf<std::invalid_argument>([] { loadGpisConfig("/no/such.yaml"); }), HasSubstr("/no/such.yaml"));
  EXPECT_THAT(refusalOf("threads: 1"), Not(HasSubstr("here")));
}

}  // namespace
}  // namespace gpis_mapping
