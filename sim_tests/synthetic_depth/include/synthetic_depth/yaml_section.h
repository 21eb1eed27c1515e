// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <cstdint>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>
#include <yaml-cpp/yaml.h>

namespace synthetic_depth {

/// Numbers that a key may have.
struct Range {
  double low;
  double high;
  bool low_open;
  std::string unit;

  bool contains(double value) const { return (low_open ? value > low : value >= low) && value <= high; }

  std::string text() const {
    std::ostringstream out;
    out << "in " << (low_open ? "(" : "[") << low << ", " << high << "]" << (unit.empty() ? "" : " ") << unit;
    return out.str();
  }
};

inline Range closed(double low, double high, const std::string& unit = "") {
  return {low, high, false, unit};
}
inline Range above(double low, double high, const std::string& unit = "") {
  return {low, high, true, unit};
}

/// On one line.
inline std::string dump(const YAML::Node& node) {
  YAML::Emitter emitter;
  emitter.SetMapFormat(YAML::Flow);
  emitter.SetSeqFormat(YAML::Flow);
  emitter << node;
  return emitter.c_str();
}

/// One map of the file. Takes values by key, remembers which keys it knows and collects every problem in a shared list,
/// so that one run shows all of them.
class Section {
 public:
  Section(const YAML::Node& node, std::string path, std::vector<std::string>& problems)
      : node_(node), path_(std::move(path)), problems_(problems) {
    if (node_.IsDefined() && !node_.IsNull() && !node_.IsMap()) {
      report("", dump(node_), "a map");
      node_ = YAML::Node();
    }
  }

  bool has(const std::string& key) const { return node_.IsMap() && node_[key].IsDefined(); }

  double number(const std::string& key, double fallback, const Range& range) {
    double value = fallback;
    const YAML::Node node = take(key);
    if (node.IsDefined() && !toNumber(node, value)) {
      report(key, dump(node), "a number " + range.text());
      return fallback;
    }
    if (node.IsDefined() && !range.contains(value)) {
      report(key, dump(node) + (range.unit.empty() ? "" : " " + range.unit), range.text());
      return fallback;
    }
    return value;
  }

  std::uint64_t seed(const std::string& key, std::uint64_t fallback) {
    const YAML::Node node = take(key);
    if (!node.IsDefined()) {
      return fallback;
    }
    std::uint64_t value = fallback;
    if (!node.IsScalar() || node.Scalar().find('-') != std::string::npos ||
        !YAML::convert<std::uint64_t>::decode(node, value)) {
      report(key, dump(node), "an integer in [0, 18446744073709551615]");
    }
    return value;
  }

  int integer(const std::string& key, int fallback, const Range& range) {
    const YAML::Node node = take(key);
    return node.IsDefined() ? toInteger(key, node, fallback, range) : fallback;
  }

  bool flag(const std::string& key, bool fallback) {
    bool value = fallback;
    const YAML::Node node = take(key);
    if (node.IsDefined() && (!node.IsScalar() || !YAML::convert<bool>::decode(node, value))) {
      report(key, dump(node), "true or false");
    }
    return value;
  }

  std::string choice(const std::string& key, const std::set<std::string>& allowed, const std::string& fallback) {
    const YAML::Node node = take(key);
    if (!node.IsDefined()) {
      return fallback;
    }
    if (!node.IsScalar() || allowed.count(node.Scalar()) == 0) {
      std::string list;
      for (const std::string& word : allowed) {
        list += (list.empty() ? "" : ", ") + word;
      }
      report(key, dump(node), "one of: " + list);
      return fallback;
    }
    return node.Scalar();
  }

  template <int Size>
  Eigen::Matrix<double, Size, 1> vector(const std::string& key, const Eigen::Matrix<double, Size, 1>& fallback,
                                        const Range& range) {
    const YAML::Node node = take(key);
    if (!node.IsDefined()) {
      return fallback;
    }
    Eigen::Matrix<double, Size, 1> value = fallback;
    bool is_good = node.IsSequence() && node.size() == static_cast<std::size_t>(Size);
    for (int i = 0; is_good && i < Size; ++i) {
      is_good = toNumber(node[i], value[i]) && range.contains(value[i]);
    }
    if (!is_good) {
      report(key, dump(node), std::to_string(Size) + " numbers " + range.text());
      return fallback;
    }
    return value;
  }

  std::vector<int> integers(const std::string& key, const Range& range) {
    std::vector<int> values;
    const YAML::Node node = take(key);
    if (!node.IsDefined()) {
      return values;
    }
    if (!node.IsSequence()) {
      report(key, dump(node), "a list of integers " + range.text());
      return values;
    }
    for (std::size_t i = 0; i < node.size(); ++i) {
      values.push_back(toInteger(key + "[" + std::to_string(i) + "]", node[i], 0, range));
    }
    return values;
  }

  Section section(const std::string& key) { return {take(key), join(key), problems_}; }

  std::vector<Section> sections(const std::string& key) {
    std::vector<Section> list;
    const YAML::Node node = take(key);
    if (!node.IsDefined()) {
      return list;
    }
    if (!node.IsSequence()) {
      report(key, dump(node), "a list of maps");
      return list;
    }
    for (std::size_t i = 0; i < node.size(); ++i) {
      list.push_back({node[i], join(key + "[" + std::to_string(i) + "]"), problems_});
    }
    return list;
  }

  void require(const std::string& key, const std::string& rule) {
    if (!has(key)) {
      report(key, "(missing)", rule);
    }
  }

  void report(const std::string& key, const std::string& value, const std::string& rule) {
    problems_.push_back(join(key) + " = " + value + ", must be " + rule + lineOf(key));
  }

  /// Reports keys that no one asked for, and keys given twice. Call after the last value was taken.
  void finish() {
    if (!node_.IsMap()) {
      return;
    }
    std::set<std::string> seen;
    for (const auto& entry : node_) {
      const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : dump(entry.first);
      if (!seen.insert(key).second) {
        problems_.push_back(join(key) + " is given twice");
      } else if (known_.count(key) == 0) {
        std::string list;
        for (const std::string& word : known_) {
          list += (list.empty() ? "" : ", ") + word;
        }
        problems_.push_back(join(key) + " is unknown; known here: " + list + lineOf(key));
      }
    }
  }

 private:
  static bool toNumber(const YAML::Node& node, double& value) {
    return node.IsScalar() && node.Tag() != "!" && YAML::convert<double>::decode(node, value) && std::isfinite(value);
  }

  int toInteger(const std::string& key, const YAML::Node& node, int fallback, const Range& range) {
    int value = fallback;
    if (!node.IsScalar() || node.Tag() == "!" || !YAML::convert<int>::decode(node, value) || !range.contains(value)) {
      report(key, dump(node) + (range.unit.empty() ? "" : " " + range.unit), "an integer " + range.text());
      return fallback;
    }
    return value;
  }

  YAML::Node take(const std::string& key) {
    known_.insert(key);
    return node_.IsMap() ? node_[key] : YAML::Node(YAML::NodeType::Undefined);
  }

  /// Of the key, or where it is missing of the map that should have it.
  std::string lineOf(const std::string& key) const {
    const YAML::Node& map = node_;  // of a const one operator[] adds nothing
    const YAML::Node node = map.IsMap() && map[key].IsDefined() ? map[key] : map;
    const int line = node.IsDefined() ? node.Mark().line : -1;  // -1: it was made by a program
    return line < 0 ? "" : " (line " + std::to_string(line + 1) + ")";
  }

  std::string join(const std::string& key) const {
    return path_.empty() || key.empty() ? path_ + key : path_ + "/" + key;
  }

  YAML::Node node_;
  std::string path_;
  std::vector<std::string>& problems_;
  std::set<std::string> known_;
};

}  // namespace synthetic_depth
