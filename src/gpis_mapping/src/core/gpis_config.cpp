// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/gpis_config.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

namespace gpis_mapping {

namespace {

const std::map<std::string, DepthNoiseModel>& noisePresets() {
  // Sources: Nguyen et al. 2012 (Kinect v1), Fankhauser et al. 2015 (v2), Toelgyessy et al. 2021 (Azure, upper bound),
  // Intel's z^2 sigma_d / (f B) with 0.08 px of disparity noise at 848 px (D415, D435).
  static const std::map<std::string, DepthNoiseModel> kPresets = {
      {"generic", {0.0005, 0.0, 0.0017}},        {"kinect_v1", {0.001504, -0.00152, 0.0019}},
      {"kinect_v2", {0.0015, -0.0005, 0.0003}},  {"azure_kinect", {0.001, 0.0, 0.0013}},
      {"realsense_d415", {0.0005, 0.0, 0.0022}}, {"realsense_d435", {0.0005, 0.0, 0.0038}},
  };
  return kPresets;
}

std::string join(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

}  // namespace

HolePolicy holePolicyFromString(const std::string& name) {
  std::vector<std::string> known;
  for (const auto& [word, policy] : kHolePolicyNames) {
    if (name == word) return policy;
    known.emplace_back(word);
  }
  throw std::invalid_argument("hole policy '" + name + "' is unknown, must be one of " + join(known));
}

DepthNoiseModel DepthNoiseModel::preset(const std::string& name) {
  const auto found = noisePresets().find(name);
  if (found != noisePresets().end()) return found->second;
  throw std::invalid_argument("depth noise preset '" + name + "' is unknown, must be one of " + join(presetNames()));
}

std::vector<std::string> DepthNoiseModel::presetNames() {
  std::vector<std::string> names;
  for (const auto& entry : noisePresets()) names.push_back(entry.first);
  return names;
}

void GpisConfig::fields(GpisConfig& c, Fields& f) {
  f.section("sensor", c.sensor);
  f.section("frame_map", c.frame_map, "Gaussian processes over one depth image");
  f.section("surface", c.surface, "training points and their field");
  f.section("cells", c.cells);
  f.section("dynamic", c.dynamic, "what is taken away leaves the map");
  f.section("retraining", c.retraining,
            "a cell is trained at once when a point came or went, else when enough have changed");
  f.section("observed", c.observed);
  f.section("mesh", c.mesh);
  f.section("query", c.query);
  f.section("region", c.region);
  f("threads", c.threads, 0, 256, "threads", "that work on an update; 0: one per core");
  f.require(c.frame_map.wall_range_m > 2.0 * c.sensor.max_range_m,
            "frame_map/wall_range_m must be more than twice sensor/max_range_m");
  f.require(
      c.influenceMargin() <= c.cells.size_m,
      "cells/size_m must be at least cells/blend_margin_m + surface/blend_radius_m and cells/training_margin_m: a "
      "point reaches the neighbouring cells only");
}

double GpisConfig::signalStd() const {
  return surface.signal_std_m > 0.0 ? surface.signal_std_m : surface.length_scale_m / std::sqrt(3.0);
}

double GpisConfig::influenceMargin() const {
  return std::max(cells.training_margin_m, cells.blend_margin_m + surface.blend_radius_m);
}

std::vector<std::string> GpisConfig::validate() const {
  return interactive_mapping::problemsOf(*this);
}

void requireValid(const GpisConfig& config) {
  interactive_mapping::requireValid("impossible map configuration:", config);
}

GpisConfig parseGpisConfig(const std::string& yaml_text, const std::string& origin) {
  return interactive_mapping::parse<GpisConfig>(yaml_text, origin);
}

GpisConfig loadGpisConfig(const std::string& yaml_path) {
  return parseGpisConfig(interactive_mapping::readTextFile(yaml_path), yaml_path);
}

std::string toYaml(const GpisConfig& config) {
  return interactive_mapping::toYaml(config);
}

}  // namespace gpis_mapping
