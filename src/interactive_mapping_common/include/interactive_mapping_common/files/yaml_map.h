// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <yaml-cpp/yaml.h>

namespace interactive_mapping {

/// Numbers allowed: [low, high], or (low, high] when open.
struct Interval {
  double low{0.0};
  double high{0.0};
  std::string unit{};
  bool is_open{false};

  bool contains(double value) const { return (is_open ? value > low : value >= low) && value <= high; }
  std::string text() const;
};

/// A map in a YAML file. Takes values by key, knows then which keys there may be, and notes every problem in a shared
/// list, so that one run shows all. A key that is read without a fallback must be there.
class YamlMap {
 public:
  YamlMap(const YAML::Node& node, std::string path, std::vector<std::string>& problems);

  bool has(const std::string& key) const { return node_.IsMap() && node_[key].IsDefined(); }
  void require(const std::string& key, const std::string& rule);

  double number(const std::string& key, const Interval& allowed);
  double number(const std::string& key, double fallback, const Interval& allowed);
  int integer(const std::string& key, const Interval& allowed);
  int integer(const std::string& key, int fallback, const Interval& allowed);
  std::uint64_t seed(const std::string& key, std::uint64_t fallback);
  bool flag(const std::string& key, bool fallback);
  std::string word(const std::string& key);
  std::string choice(const std::string& key, const std::set<std::string>& allowed, const std::string& fallback);

  std::vector<std::string> words(const std::string& key);
  std::vector<int> optionalIntegers(const std::string& key, const Interval& allowed);
  Eigen::VectorXd numbers(const std::string& key, int count, const Interval& allowed);
  Eigen::VectorXd numbers(const std::string& key, const Eigen::VectorXd& fallback, const Interval& allowed);
  /// A list of at least `min_count` pairs.
  std::vector<Eigen::Vector2d> pairs(const std::string& key, int min_count, const Interval& allowed);
  YamlMap map(const std::string& key);
  YamlMap optionalMap(const std::string& key);
  /// At least one.
  std::vector<YamlMap> maps(const std::string& key);
  std::vector<YamlMap> optionalMaps(const std::string& key);

  /// For rules of the caller's own: notes "<path>/<key> = <value>, must be <rule>".
  void note(const std::string& key, const std::string& value, const std::string& rule);

  /// Notes the keys that nobody asked for, or that are there twice. Call last.
  void finish();

 private:
  YAML::Node take(const std::string& key);
  YAML::Node required(const std::string& key, const std::string& rule);
  int toInteger(const std::string& key, const YAML::Node& node, int fallback, const Interval& allowed);
  std::string pathOf(const std::string& key) const;
  std::string lineOf(const std::string& key) const;

  YAML::Node node_;
  std::string path_;
  std::vector<std::string>* problems_;
  std::set<std::string> known_;
  bool is_noted_{false};  // that there is no map: its keys are then not missed one by one
};

/// Reads a document with `read`, which notes problems in its second argument. Throws std::invalid_argument with every
/// problem on a line of its own, `name` in front.
void readYaml(const std::string& text, const std::string& name,
              const std::function<void(YamlMap&, std::vector<std::string>&)>& read);

/// 0.17 rather than 0.170000.
std::string toText(double value);

}  // namespace interactive_mapping
