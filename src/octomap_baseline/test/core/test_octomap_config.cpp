// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline/octomap_config.h"

#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <interactive_mapping_common/testing/shipped_file.h>

namespace octomap_baseline {
namespace {

using testing::HasSubstr;

const std::string kConfigDir = OCTOMAP_CONFIG_DIR;

std::string refusalOf(const std::string& yaml_text) {
  return test_support::messageOf<std::invalid_argument>([&] { parseOctomapConfig(yaml_text, "here.yaml"); });
}

TEST(OctomapConfig, DefaultsAreValid) {
  EXPECT_THAT(OctomapConfig{}.validate(), testing::IsEmpty());
}

TEST(OctomapConfig, ShippedFilesAreWhatTheFieldsSay) {
  test_support::expectShippedFile<OctomapConfig>(kConfigDir + "/octomap_baseline.yaml");
}

TEST(OctomapConfig, NoisePresetStandsForItsCoefficients) {
  const OctomapConfig config = parseOctomapConfig("sensor: {noise_preset: kinect_v2}", "");
  EXPECT_EQ(config.sensor.noise.a_m, gpis_mapping::DepthNoiseModel::preset("kinect_v2").a_m);
}

TEST(OctomapConfig, RefusesValuesThatContradictEachOther) {
  EXPECT_THAT(refusalOf("occupancy: {threshold: 0.98}"), HasSubstr("between occupancy/clamp_min"));
  EXPECT_THAT(refusalOf("occupancy: {threshold: 0.3}"), HasSubstr("above occupancy/prob_miss"));
  EXPECT_THAT(refusalOf("region: {min_m: [0, 0, 0], max_m: [1, 0, 1]}"), HasSubstr("region/min_m must be below"));
  EXPECT_THAT(refusalOf("sensor: {min_range_m: 5}"), HasSubstr("sensor/min_range_m must be below"));
  EXPECT_THAT(refusalOf("resolution_m: .nan"), HasSubstr("resolution_m = nan m"));
}

TEST(OctomapConfig, AcceptsEveryRangeThatTheSensorMayHave) {
  EXPECT_EQ(parseOctomapConfig("sensor: {max_range_m: 50}", "").sensor.max_range_m, 50.0);
}

}  // namespace
}  // namespace octomap_baseline
