// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline/octomap_config.h"

#include <algorithm>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <stdexcept>

#include <yaml-cpp/yaml.h>

namespace octomap_baseline {
namespace {

const std::map<std::string, ForgetPolicy>& forgetPolicies() {
  static const std::map<std::string, ForgetPolicy> kNames = {{"odds", ForgetPolicy::kOdds},
                                                             {"seen_through", ForgetPolicy::kSeenThrough}};
  return kNames;
}

/// The one table of the keys that gpis_mapping does not have: section, key, member, allowed range, unit.
template <typename Config, typename Visitor>
void visitConfig(Config& c, Visitor&& visit) {
  visit("", "resolution_m", c.resolution_m, 0.002, 1.0, "m");
  visit("occupancy", "prob_hit", c.occupancy.prob_hit, 0.501, 0.999, "");
  visit("occupancy", "prob_miss", c.occupancy.prob_miss, 0.001, 0.499, "");
  visit("occupancy", "clamp_min", c.occupancy.clamp_min, 0.001, 0.499, "");
  visit("occupancy", "clamp_max", c.occupancy.clamp_max, 0.501, 0.999, "");
  visit("occupancy", "threshold", c.occupancy.threshold, 0.01, 0.99, "");
  visit("dynamic", "enabled", c.dynamic.enabled);
  visit("dynamic", "virtual_wall", c.dynamic.virtual_wall);
  visit("dynamic", "policy", c.dynamic.policy);
  visit("dynamic", "tolerance_sigmas", c.dynamic.tolerance_sigmas, 0.0, 10.0, "sigma");
  visit("dynamic", "min_tolerance_m", c.dynamic.min_tolerance_m, 0.0, 0.2, "m");
  visit("dynamic", "least_share", c.dynamic.least_share, 0.01, 1.0, "");
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
    const std::string suffix = *unit ? std::string(" ") + unit : "";
    text << fullKey(section, key) << " = " << value << suffix << ", must be in [" << lo << ", " << hi << "]" << suffix;
    problems.push_back(text.str());
  }
  void operator()(const char*, const char*, bool) {}
  void operator()(const char*, const char*, ForgetPolicy) {}
  void operator()(const char* section, const char* key, const Eigen::Vector3d& value) {
    if (!value.allFinite()) problems.push_back(fullKey(section, key) + " must be three finite numbers [m]");
  }
};

/// Takes the values of the table out of a YAML document.
struct YamlReader {
  YAML::Node root;
  std::vector<std::string> problems;
  std::map<std::string, std::set<std::string>> known;

  template <typename T>
  bool read(const std::string& section, const std::string& key, T* value, const char* type) {
    known[section].insert(key);
    const YAML::Node parent = section.empty() ? root : root[section];
    if (!parent || !parent.IsMap() || !parent[key]) return false;
    const YAML::Node node = parent[key];
    try {
      *value = node.as<T>();
      return true;
    } catch (const YAML::Exception&) {
      problems.push_back(fullKey(section, key) + " = '" + (node.IsScalar() ? node.Scalar() : std::string("...")) +
                         "', must be " + type);
      return false;
    }
  }

  void operator()(const char* section, const char* key, double& value, double, double, const char*) {
    read(section, key, &value, "a number");
  }
  void operator()(const char* section, const char* key, int& value, int, int, const char*) {
    read(section, key, &value, "a whole number");
  }
  void operator()(const char* section, const char* key, bool& value) { read(section, key, &value, "true or false"); }
  void operator()(const char* section, const char* key, ForgetPolicy& value) {
    std::string name;
    if (!read(section, key, &name, "a name")) return;
    const auto found = forgetPolicies().find(name);
    if (found != forgetPolicies().end()) {
      value = found->second;
    } else {
      problems.push_back(fullKey(section, key) + " = '" + name + "', must be one of odds, seen_through");
    }
  }
  void operator()(const char* section, const char* key, Eigen::Vector3d& value) {
    std::vector<double> numbers;
    if (!read(section, key, &numbers, "a list of three numbers")) return;
    if (numbers.size() == 3) {
      value = Eigen::Vector3d(numbers[0], numbers[1], numbers[2]);
    } else {
      problems.push_back(fullKey(section, key) + " has " + std::to_string(numbers.size()) + " numbers, must have 3");
    }
  }

  /// yaml-cpp takes the first of two equal keys without a word.
  void reportKeys(const YAML::Node& map, const std::string& section) {
    std::set<std::string> seen;
    for (const auto& entry : map) {
      const std::string key = entry.first.as<std::string>();
      if (!seen.insert(key).second) problems.push_back("key " + fullKey(section, key) + " is given twice");
      if (known[section].count(key) > 0 || (section.empty() && known.count(key) > 0)) continue;
      problems.push_back("unknown key " + fullKey(section, key));
    }
  }

  void reportUnknown() {
    reportKeys(root, "");
    for (const auto& [section, keys] : known) {
      if (section.empty() || !root.IsMap() || !root[section]) continue;
      if (root[section].IsMap()) {
        reportKeys(root[section], section);
      } else {
        problems.push_back(section + " must be a section with keys");
      }
    }
  }
};

/// Writes the table as YAML text.
struct YamlWriter {
  std::ostringstream text;
  std::string open_section;

  template <typename T>
  void write(const std::string& section, const char* key, const T& value) {
    if (section != open_section && !section.empty()) text << section << ":\n";
    open_section = section;
    text << (section.empty() ? "" : "  ") << key << ": " << value << '\n';
  }

  /// The shortest decimal that reads back as the same double keeps the file fit for people.
  static std::string shortest(double value) {
    std::ostringstream number;
    for (int digits = 6; digits <= 17; ++digits) {
      number.str("");
      number.precision(digits);
      number << value;
      if (std::stod(number.str()) == value) break;
    }
    return number.str();
  }

  void operator()(const char* section, const char* key, double value, double, double, const char*) {
    write(section, key, shortest(value));
  }
  void operator()(const char* section, const char* key, int value, int, int, const char*) {
    write(section, key, value);
  }
  void operator()(const char* section, const char* key, bool value) { write(section, key, value ? "true" : "false"); }
  void operator()(const char* section, const char* key, ForgetPolicy value) {
    for (const auto& [name, policy] : forgetPolicies()) {
      if (policy == value) write(section, key, name);
    }
  }
  void operator()(const char* section, const char* key, const Eigen::Vector3d& value) {
    write(section, key, "[" + shortest(value.x()) + ", " + shortest(value.y()) + ", " + shortest(value.z()) + "]");
  }
};

/// gpis_mapping's settings with this sensor: reading, checking and writing it is done there.
gpis_mapping::GpisConfig sensorOnly(const gpis_mapping::GpisConfig::Sensor& sensor) {
  gpis_mapping::GpisConfig config;
  config.sensor = sensor;
  config.frame_map.wall_range_m = 1e4;  // beyond twice any range allowed here
  return config;
}

std::string join(const std::string& head, const std::vector<std::string>& problems) {
  std::string text = head;
  for (const std::string& problem : problems) text += "\n  " + problem;
  return text;
}

/// The lines of a refusal but its first.
std::vector<std::string> problemsIn(const std::string& message) {
  std::istringstream lines(message);
  std::vector<std::string> problems;
  std::string line;
  std::getline(lines, line);
  while (std::getline(lines, line)) problems.push_back(line.substr(std::min<std::size_t>(2, line.size())));
  return problems;
}

}  // namespace

std::vector<std::string> OctomapConfig::validate() const {
  RangeChecker checker;
  visitConfig(*this, checker);
  std::vector<std::string> problems = sensorOnly(sensor).validate();
  problems.insert(problems.end(), checker.problems.begin(), checker.problems.end());
  const auto require = [&problems](bool good, const std::string& sentence) {
    if (!good) problems.push_back(sentence);
  };
  require(occupancy.clamp_min < occupancy.threshold && occupancy.threshold < occupancy.clamp_max,
          "occupancy/threshold must be between occupancy/clamp_min and occupancy/clamp_max");
  require((region.min_m.array() < region.max_m.array()).all(), "region/min_m must be below region/max_m on each axis");
  return problems;
}

void requireValid(const OctomapConfig& config) {
  const std::vector<std::string> problems = config.validate();
  if (!problems.empty()) throw std::invalid_argument(join("impossible OctoMap configuration:", problems));
}

OctomapConfig parseOctomapConfig(const std::string& yaml_text, const std::string& origin) {
  OctomapConfig config;
  YamlReader reader;
  try {
    reader.root = YAML::Load(yaml_text);
  } catch (const YAML::Exception& error) {
    throw std::invalid_argument(origin + ": not YAML: " + error.what());
  }
  if (!reader.root.IsMap() && !reader.root.IsNull()) throw std::invalid_argument(origin + ": must be a map of keys");
  if (reader.root.IsMap() && reader.root["sensor"]) {
    YAML::Node sensor;
    sensor["sensor"] = reader.root["sensor"];
    sensor["frame_map"]["wall_range_m"] = sensorOnly({}).frame_map.wall_range_m;
    try {
      config.sensor = gpis_mapping::parseGpisConfig(YAML::Dump(sensor), origin).sensor;
    } catch (const std::invalid_argument& error) {
      reader.problems = problemsIn(error.what());
    }
  }
  visitConfig(config, reader);
  reader.known[""].insert("sensor");
  reader.reportUnknown();
  std::vector<std::string> problems = reader.problems;
  const std::vector<std::string> impossible = config.validate();
  problems.insert(problems.end(), impossible.begin(), impossible.end());
  if (!problems.empty()) throw std::invalid_argument(join(origin + ": refused:", problems));
  return config;
}

OctomapConfig loadOctomapConfig(const std::string& yaml_path) {
  std::ifstream file(yaml_path);
  std::stringstream text;
  // A folder opens like a file and only fails to be read.
  if (!file || !(text << file.rdbuf())) throw std::invalid_argument(yaml_path + ": cannot be read, or is empty");
  return parseOctomapConfig(text.str(), yaml_path);
}

std::string toYaml(const OctomapConfig& config) {
  const std::string sensor = gpis_mapping::toYaml(sensorOnly(config.sensor));
  YamlWriter writer;
  visitConfig(config, writer);
  return sensor.substr(0, sensor.find("frame_map:")) + writer.text.str();
}

}  // namespace octomap_baseline
