// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <set>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <yaml-cpp/yaml.h>

namespace mp700_ur5e_description {

/// Numbers allowed: [low, high], or (low, high] when open.
struct Interval {
  double low{0.0};
  double high{0.0};
  std::string unit;
  bool is_open{false};

  bool contains(double value) const { return (is_open ? value > low : value >= low) && value <= high; }
  std::string text() const;
};

/// A map in a YAML file, all of whose keys must be there, but for those asked for by has(), and no others. Each reader returns a stand-in for what is
/// missing, mistyped or out of range, and notes it in the shared list, so that one run shows everything.
class YamlMap {
 public:
  YamlMap(YAML::Node node, std::string path, std::vector<std::string>& problems);

  /// Of a key that may be left out: ask for its value only if it is there.
  bool has(const std::string& key) const { return node_.IsMap() && node_[key].IsDefined(); }

  double number(const std::string& key, const Interval& allowed);
  int integer(const std::string& key, const Interval& allowed);
  std::string word(const std::string& key);
  std::vector<std::string> words(const std::string& key);
  Eigen::VectorXd numbers(const std::string& key, int count, const Interval& allowed);
  /// A list of at least `min_count` pairs.
  std::vector<Eigen::Vector2d> pairs(const std::string& key, int min_count, const Interval& allowed);
  YamlMap map(const std::string& key);
  std::vector<YamlMap> maps(const std::string& key);

  /// For rules of the caller's own: notes "<path>/<key> = <value>, must be <rule>".
  void note(const std::string& key, const std::string& value, const std::string& rule);

  /// Notes the keys that nobody asked for, or that are there twice. Call last.
  void finish();

 private:
  YAML::Node take(const std::string& key, const std::string& rule);
  std::string pathOf(const std::string& key) const { return path_.empty() ? key : path_ + "/" + key; }

  YAML::Node node_;
  std::string path_;
  std::vector<std::string>* problems_;
  std::set<std::string> known_;
};

/// Reads a document with `read`, which notes problems in its second argument. Throws std::invalid_argument with every
/// problem on a line of its own, `name` in front.
void readYaml(const std::string& text, const std::string& name,
              const std::function<void(YamlMap&, std::vector<std::string>&)>& read);

/// Contents of a file. Throws std::invalid_argument if it cannot be read.
std::string readText(const std::string& path);

/// 0.17 rather than 0.170000.
std::string toText(double value);

}  // namespace mp700_ur5e_description
