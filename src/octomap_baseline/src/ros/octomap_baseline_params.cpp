// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline_ros/octomap_baseline_params.h"

#include <cstdio>
#include <stdexcept>

#include <interactive_mapping_common_ros/param_reader.h>

namespace octomap_baseline_ros {

std::vector<std::string> OctomapBaselineParams::validate() const {
  std::vector<std::string> problems;
  const auto check = [&problems](const char* key, double value, double lo, double hi, const char* unit) {
    if (value >= lo && value <= hi) return;  // false for NaN
    char text[160];
    std::snprintf(text, sizeof(text), "%s = %g %s, must be in [%g, %g] %s", key, value, unit, lo, hi, unit);
    problems.push_back(text);
  };
  for (const std::string& problem : input.validate()) problems.push_back("input/" + problem);
  for (const std::string& problem : map.validate()) problems.push_back("map/" + problem);
  check("output/rate_hz", output.rate_hz, 0.05, 30.0, "Hz");
  check("output/projected_min_z_m", output.projected_min_z_m, -1e4, 1e4, "m");
  check("output/projected_max_z_m", output.projected_max_z_m, -1e4, 1e4, "m");
  if (output.projected_min_z_m >= output.projected_max_z_m) {
    problems.push_back("output/projected_min_z_m must be below output/projected_max_z_m");
  }
  return problems;
}

OctomapBaselineParams loadOctomapBaselineParams(const ros::NodeHandle& private_nh) {
  OctomapBaselineParams params;
  interactive_mapping_ros::ParamReader reader(private_nh);
  params.input.read("input", &reader);
  reader.read("output/rate_hz", &params.output.rate_hz);
  reader.read("output/every_image", &params.output.every_image);
  reader.read("output/projected_min_z_m", &params.output.projected_min_z_m);
  reader.read("output/projected_max_z_m", &params.output.projected_max_z_m);
  reader.read("output/filter_speckles", &params.output.filter_speckles);
  reader.ignore("image_transport");  // read by image_transport
  const std::string map_yaml = reader.yamlOf("map");
  try {
    if (!map_yaml.empty()) params.map = octomap_baseline::parseOctomapConfig(map_yaml, "map");
  } catch (const std::invalid_argument& error) {
    reader.report("", {error.what()});
  }
  reader.report("", params.validate());
  reader.finish();
  return params;
}

}  // namespace octomap_baseline_ros
