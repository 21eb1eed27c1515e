// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/gpis_config.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <stdexcept>

#include <yaml-cpp/yaml.h>

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

const std::map<std::string, HolePolicy>& holePolicies() {
  static const std::map<std::string, HolePolicy> kNames = {
      {"auto", HolePolicy::kAuto}, {"wall", HolePolicy::kWall}, {"no_information", HolePolicy::kNoInformation}};
  return kNames;
}

template <typename Map>
std::string joinKeys(const Map& map) {
  std::string text;
  for (const auto& entry : map) text += (text.empty() ? "" : ", ") + entry.first;
  return text;
}

/// The one table of all keys: section, key, member, allowed range, unit.
template <typename Config, typename Visitor>
void visitConfig(Config& c, Visitor&& visit) {
  visit("sensor", "min_range_m", c.sensor.min_range_m, 0.01, 10.0, "m");
  visit("sensor", "max_range_m", c.sensor.max_range_m, 0.1, 50.0, "m");
  visit("sensor", "baseline_m", c.sensor.baseline_m, 0.0, 1.0, "m");
  visit("sensor", "hole_policy", c.sensor.hole_policy);
  visit("sensor", "noise_a_m", c.sensor.noise.a_m, 0.0, 0.1, "m");
  visit("sensor", "noise_b", c.sensor.noise.b, -0.1, 0.1, "m/m");
  visit("sensor", "noise_c_per_m", c.sensor.noise.c_per_m, 0.0, 0.1, "1/m");
  visit("sensor", "pose_std_m", c.sensor.pose_std_m, 0.0, 0.1, "m");
  visit("sensor", "pose_std_rad", c.sensor.pose_std_rad, 0.0, 0.1, "rad");
  visit("sensor", "stamp_std_s", c.sensor.stamp_std_s, 0.0, 0.1, "s");
  visit("sensor", "fov_width_rad", c.sensor.fov_width_rad, 0.0, 3.0, "rad");
  visit("sensor", "fov_height_rad", c.sensor.fov_height_rad, 0.0, 3.0, "rad");
  visit("frame_map", "tile_px", c.frame_map.tile_px, 4, 16, "px");
  visit("frame_map", "overlap_px", c.frame_map.overlap_px, 0, 6, "px");
  visit("frame_map", "kernel_length_rad", c.frame_map.kernel_length_rad, 1e-4, 0.1, "rad");
  visit("frame_map", "prior_std_per_m", c.frame_map.prior_std_per_m, 1e-4, 1.0, "1/m");
  visit("frame_map", "wall_range_m", c.frame_map.wall_range_m, 10.0, 1e4, "m");
  visit("surface", "spacing_m", c.surface.spacing_m, 0.003, 0.2, "m");
  visit("surface", "length_scale_m", c.surface.length_scale_m, 0.005, 1.0, "m");
  visit("surface", "signal_std_m", c.surface.signal_std_m, 0.0, 1.0, "m");
  visit("surface", "blend_radius_m", c.surface.blend_radius_m, 0.005, 0.5, "m");
  visit("surface", "min_noise_std_m", c.surface.min_noise_std_m, 1e-4, 0.05, "m");
  visit("cells", "size_m", c.cells.size_m, 0.02, 1.0, "m");
  visit("cells", "training_margin_m", c.cells.training_margin_m, 0.005, 1.0, "m");
  visit("cells", "blend_margin_m", c.cells.blend_margin_m, 0.001, 0.5, "m");
  visit("dynamic", "enabled", c.dynamic.enabled);
  visit("dynamic", "tolerance_sigmas", c.dynamic.tolerance_sigmas, 0.5, 10.0, "sigma");
  visit("dynamic", "min_tolerance_m", c.dynamic.min_tolerance_m, 0.0, 0.2, "m");
  visit("retraining", "moved_sigmas", c.retraining.moved_sigmas, 0.0, 10.0, "sigma");
  visit("retraining", "noise_ratio", c.retraining.noise_ratio, 0.0, 1.0, "");
  visit("retraining", "changed_share", c.retraining.changed_share, 0.0, 1.0, "");
  visit("observed", "block_size_m", c.observed.block_size_m, 0.01, 0.5, "m");
  visit("mesh", "voxels_per_cell", c.mesh.voxels_per_cell, 2, 32, "");
  visit("mesh", "support_spacings", c.mesh.support_spacings, 0.5, 4.0, "spacings");
  visit("query", "unknown_reach_m", c.query.unknown_reach_m, 0.0, 5.0, "m");
  visit("query", "max_distance_m", c.query.max_distance_m, 0.1, 100.0, "m");
  visit("query", "occupied_depth_m", c.query.occupied_depth_m, 0.01, 5.0, "m");
  visit("region", "min_m", c.region.min_m);
  visit("region", "max_m", c.region.max_m);
  visit("", "threads", c.threads, 0, 256, "threads");
}

std::string fullKey(const std::string& section, const std::string& key) {
  return section.empty() ? key : section + "/" + key;
}

/// Checks every number of the table against its range.
struct RangeChecker {
  std::vector<std::string> problems;

  template <typename T>
  void operator()(const char* section, const char* key, const T& value, T lo, T hi, const char* unit) {
    if (value >= lo && value <= hi) return;  // false for NaN
    std::ostringstream text;
    text << fullKey(section, key) << " = " << value << ' ' << unit << ", must be in [" << lo << ", " << hi << "] "
         << unit;
    problems.push_back(text.str());
  }
  void operator()(const char*, const char*, bool) {}
  void operator()(const char*, const char*, HolePolicy) {}
  void operator()(const char* section, const char* key, const Eigen::Vector3d& value) {
    if (value.allFinite()) return;
    problems.push_back(fullKey(section, key) + " must be three finite numbers [m]");
  }
};

/// Takes the values of the table out of a YAML document.
struct YamlReader {
  YAML::Node root;
  std::vector<std::string> problems;
  std::map<std::string, std::set<std::string>> known;

  YAML::Node find(const std::string& section, const std::string& key) {
    known[section].insert(key);
    const YAML::Node& parent = section.empty() ? root : root[section];
    return parent && parent.IsMap() ? parent[key] : YAML::Node(YAML::NodeType::Undefined);
  }

  template <typename T>
  void read(const std::string& section, const std::string& key, T* value, const char* type) {
    const YAML::Node node = find(section, key);
    if (!node) return;
    try {
      *value = node.as<T>();
    } catch (const YAML::Exception&) {
      problems.push_back(fullKey(section, key) + " = '" + (node.IsScalar() ? node.Scalar() : std::string("...")) +
                         "', must be " + type);
    }
  }

  void operator()(const char* section, const char* key, double& value, double, double, const char*) {
    read(section, key, &value, "a number");
  }
  void operator()(const char* section, const char* key, int& value, int, int, const char*) {
    read(section, key, &value, "a whole number");
  }
  void operator()(const char* section, const char* key, bool& value) { read(section, key, &value, "true or false"); }
  void operator()(const char* section, const char* key, HolePolicy& value) {
    std::string name;
    read(section, key, &name, "a name");
    if (name.empty()) return;
    const auto found = holePolicies().find(name);
    if (found != holePolicies().end()) {
      value = found->second;
    } else {
      problems.push_back(fullKey(section, key) + " = '" + name + "', must be one of " + joinKeys(holePolicies()));
    }
  }
  void operator()(const char* section, const char* key, Eigen::Vector3d& value) {
    std::vector<double> numbers(value.data(), value.data() + 3);
    read(section, key, &numbers, "a list of three numbers");
    if (numbers.size() == 3) {
      value = Eigen::Vector3d(numbers[0], numbers[1], numbers[2]);
    } else {
      problems.push_back(fullKey(section, key) + " has " + std::to_string(numbers.size()) + " numbers, must have 3");
    }
  }

  /// YAML allows whole lists and maps as keys.
  static std::string nameOf(const YAML::Node& key) {
    return key.IsScalar() ? key.Scalar() : key.IsNull() ? "null" : "(not a name)";
  }

  /// yaml-cpp takes the first of two equal keys without a word.
  void reportRepeated(const YAML::Node& map, const std::string& section) {
    std::set<std::string> seen;
    for (const auto& entry : map) {
      const std::string key = nameOf(entry.first);
      if (!seen.insert(key).second) problems.push_back("key " + fullKey(section, key) + " is given twice");
    }
  }

  void reportUnknown() {
    reportRepeated(root, "");
    for (const auto& entry : root) {
      const std::string name = nameOf(entry.first);
      if (known[""].count(name) > 0) continue;
      const auto section = known.find(name);
      if (section == known.end()) {
        problems.push_back("unknown key " + name);
      } else if (!entry.second.IsMap()) {
        problems.push_back(name + " must be a section with keys");
      } else {
        reportRepeated(entry.second, name);
        for (const auto& item : entry.second) {
          const std::string key = nameOf(item.first);
          if (section->second.count(key) == 0) problems.push_back("unknown key " + fullKey(name, key));
        }
      }
    }
  }
};

/// Writes the table as YAML text.
struct YamlWriter {
  std::ostringstream text;
  std::string open_section;

  template <typename T>
  void write(const std::string& section, const char* key, const T& value, const char* unit = "") {
    if (section != open_section) {
      if (!section.empty()) text << section << ":\n";
      open_section = section;
    }
    text << (section.empty() ? "" : "  ") << key << ": " << value << (*unit ? "  # " : "") << unit << '\n';
  }

  void operator()(const char* section, const char* key, double value, double, double, const char* unit) {
    std::ostringstream number;
    number.precision(17);
    number << value;
    // The shortest decimal that reads back as the same double keeps the file fit for people.
    for (int digits = 6; digits < 17; ++digits) {
      std::ostringstream shorter;
      shorter.precision(digits);
      shorter << value;
      if (std::strtod(shorter.str().c_str(), nullptr) == value) {  // stod throws for denormals
        number.str(shorter.str());
        break;
      }
    }
    write(section, key, number.str(), unit);
  }
  void operator()(const char* section, const char* key, int value, int, int, const char* unit) {
    write(section, key, value, unit);
  }
  void operator()(const char* section, const char* key, bool value) { write(section, key, value ? "true" : "false"); }
  void operator()(const char* section, const char* key, HolePolicy value) { write(section, key, toString(value)); }
  void operator()(const char* section, const char* key, const Eigen::Vector3d& value) {
    std::ostringstream list;
    list.precision(17);
    list << '[' << value.x() << ", " << value.y() << ", " << value.z() << ']';
    write(section, key, list.str(), "m");
  }
};

std::string join(const std::string& head, const std::vector<std::string>& problems) {
  std::string text = head;
  for (const std::string& problem : problems) text += "\n  " + problem;
  return text;
}

}  // namespace

const char* toString(HolePolicy policy) {
  for (const auto& entry : holePolicies()) {
    if (entry.second == policy) return entry.first.c_str();
  }
  return "?";
}

HolePolicy holePolicyFromString(const std::string& name) {
  const auto found = holePolicies().find(name);
  if (found != holePolicies().end()) return found->second;
  throw std::invalid_argument("hole policy '" + name + "' is unknown, must be one of " + joinKeys(holePolicies()));
}

DepthNoiseModel DepthNoiseModel::preset(const std::string& name) {
  const auto found = noisePresets().find(name);
  if (found == noisePresets().end()) {
    throw std::invalid_argument("depth noise preset '" + name + "' is unknown, must be one of " +
                                joinKeys(noisePresets()));
  }
  return found->second;
}

std::vector<std::string> DepthNoiseModel::presetNames() {
  std::vector<std::string> names;
  for (const auto& entry : noisePresets()) names.push_back(entry.first);
  return names;
}

double GpisConfig::signalStd() const {
  return surface.signal_std_m > 0.0 ? surface.signal_std_m : surface.length_scale_m / std::sqrt(3.0);
}

double GpisConfig::influenceMargin() const {
  return std::max(cells.training_margin_m, cells.blend_margin_m + surface.blend_radius_m);
}

std::vector<std::string> GpisConfig::validate() const {
  RangeChecker checker;
  visitConfig(*this, checker);
  auto& problems = checker.problems;
  const auto require = [&problems](bool good, const std::string& sentence) {
    if (!good) problems.push_back(sentence);
  };
  require(sensor.min_range_m < sensor.max_range_m, "sensor/min_range_m must be below sensor/max_range_m");
  require(frame_map.wall_range_m > 2.0 * sensor.max_range_m,
          "frame_map/wall_range_m must be more than twice sensor/max_range_m");
  for (const double z : {sensor.min_range_m, 0.5 * (sensor.min_range_m + sensor.max_range_m), sensor.max_range_m}) {
    if (sensor.noise.sigma(z) > 0.0) continue;
    problems.push_back("sensor/noise_*: standard deviation at " + std::to_string(z) + " m is " +
                       std::to_string(sensor.noise.sigma(z)) + " m, must be > 0 m");
    break;
  }
  require(cells.blend_margin_m < 0.5 * cells.size_m, "cells/blend_margin_m must be below half of cells/size_m");
  require(influenceMargin() <= cells.size_m,
          "cells/size_m must be at least cells/blend_margin_m + surface/blend_radius_m and cells/training_margin_m: a "
          "point reaches the neighbouring cells only");
  require(surface.blend_radius_m >= 1.5 * surface.spacing_m,
          "surface/blend_radius_m must be at least 1.5 surface/spacing_m, or the prior mean has gaps");
  require((region.min_m.array() < region.max_m.array()).all(), "region/min_m must be below region/max_m on each axis");
  return problems;
}

void requireValid(const GpisConfig& config) {
  const std::vector<std::string> problems = config.validate();
  if (!problems.empty()) throw std::invalid_argument(join("impossible map configuration:", problems));
}

GpisConfig parseGpisConfig(const std::string& yaml_text, const std::string& origin) {
  GpisConfig config;
  YamlReader reader;
  try {
    reader.root = YAML::Load(yaml_text);
  } catch (const YAML::Exception& error) {
    throw std::invalid_argument(origin + ": not YAML: " + error.what());
  }
  if (!reader.root.IsMap() && !reader.root.IsNull()) throw std::invalid_argument(origin + ": must be a map of keys");
  // A preset is a shorthand for the three coefficients, which may still override it.
  if (reader.root.IsMap() && reader.root["sensor"] && reader.root["sensor"].IsMap()) {
    const YAML::Node preset = reader.root["sensor"]["noise_preset"];
    if (preset) {
      try {
        config.sensor.noise = DepthNoiseModel::preset(preset.IsScalar() ? preset.Scalar() : "");
      } catch (const std::invalid_argument& error) {
        reader.problems.push_back(std::string("sensor/noise_preset: ") + error.what());
      }
    }
  }
  reader.known["sensor"].insert("noise_preset");
  visitConfig(config, reader);
  reader.reportUnknown();
  std::vector<std::string> problems = reader.problems;
  const std::vector<std::string> impossible = config.validate();
  problems.insert(problems.end(), impossible.begin(), impossible.end());
  if (!problems.empty()) throw std::invalid_argument(join(origin + ": refused:", problems));
  return config;
}

GpisConfig loadGpisConfig(const std::string& yaml_path) {
  std::ifstream file(yaml_path);
  if (!file) throw std::invalid_argument(yaml_path + ": cannot be read");
  std::stringstream text;
  text << file.rdbuf();
  // A folder opens like a file and only fails to be read.
  if (file.bad() || (text.fail() && file.peek() != std::ifstream::traits_type::eof())) {
    throw std::invalid_argument(yaml_path + ": cannot be read; is it a file?");
  }
  if (text.str().empty()) throw std::invalid_argument(yaml_path + ": is empty");
  return parseGpisConfig(text.str(), yaml_path);
}

std::string toYaml(const GpisConfig& config) {
  YamlWriter writer;
  visitConfig(config, writer);
  return writer.text.str();
}

}  // namespace gpis_mapping
