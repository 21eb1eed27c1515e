// SPDX-License-Identifier: BSD-3-Clause
#include "interactive_mapping_common/files/yaml_map.h"

#include <cmath>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace interactive_mapping {
namespace {

std::string dump(const YAML::Node& node) {
  YAML::Emitter emitter;
  emitter.SetMapFormat(YAML::Flow);
  emitter.SetSeqFormat(YAML::Flow);
  emitter << node;
  return emitter.c_str();
}

std::string join(const std::set<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

std::string withUnit(const YAML::Node& node, const Interval& allowed) {
  return dump(node) + (allowed.unit.empty() ? "" : " ") + allowed.unit;
}

/// Quoted scalars are words, whatever they spell.
template <class Number>
bool read(const YAML::Node& node, Number* value) {
  return node.IsScalar() && node.Tag() != "!" && YAML::convert<Number>::decode(node, *value) &&
         std::isfinite(static_cast<double>(*value));
}

bool readAllowed(const YAML::Node& node, const Interval& allowed, double* value) {
  return read(node, value) && allowed.contains(*value);
}

}  // namespace

std::string toText(double value) {
  std::ostringstream out;
  out << value;
  return out.str();
}

std::string Interval::text() const {
  return std::string("in ") + (is_open ? "(" : "[") + toText(low) + ", " + toText(high) + "]" +
         (unit.empty() ? "" : " " + unit);
}

YamlMap::YamlMap(const YAML::Node& node, std::string path, std::vector<std::string>& problems)
    : node_(node), path_(std::move(path)), problems_(&problems) {
  if (!node_.IsDefined() || node_.IsNull() || node_.IsMap()) return;
  note("", dump(node_), "a map");
  node_.reset();
  is_noted_ = true;
}

void YamlMap::require(const std::string& key, const std::string& rule) {
  if (!has(key) && !is_noted_) note(key, "(missing)", rule);
}

double YamlMap::number(const std::string& key, const Interval& allowed) {
  const std::string rule = "a number " + allowed.text();
  const YAML::Node node = required(key, rule);
  double value = 0.0;
  if (node.IsDefined() && !readAllowed(node, allowed, &value)) note(key, dump(node), rule);
  return value;
}

double YamlMap::number(const std::string& key, double fallback, const Interval& allowed) {
  const YAML::Node node = take(key);
  double value = fallback;
  if (!node.IsDefined()) return fallback;
  if (readAllowed(node, allowed, &value)) return value;
  if (read(node, &value)) {
    note(key, withUnit(node, allowed), allowed.text());
  } else {
    note(key, dump(node), "a number " + allowed.text());
  }
  return fallback;
}

int YamlMap::integer(const std::string& key, const Interval& allowed) {
  require(key, "an integer " + allowed.text());
  return integer(key, 0, allowed);
}

int YamlMap::integer(const std::string& key, int fallback, const Interval& allowed) {
  const YAML::Node node = take(key);
  return node.IsDefined() ? toInteger(key, node, fallback, allowed) : fallback;
}

std::uint64_t YamlMap::seed(const std::string& key, std::uint64_t fallback) {
  const YAML::Node node = take(key);
  std::uint64_t value = fallback;
  if (node.IsDefined() && (!node.IsScalar() || node.Scalar().find('-') != std::string::npos ||
                           !YAML::convert<std::uint64_t>::decode(node, value))) {
    note(key, dump(node), "an integer in [0, 18446744073709551615]");
  }
  return value;
}

bool YamlMap::flag(const std::string& key, bool fallback) {
  const YAML::Node node = take(key);
  bool value = fallback;
  if (node.IsDefined() && (!node.IsScalar() || !YAML::convert<bool>::decode(node, value))) {
    note(key, dump(node), "true or false");
  }
  return value;
}

std::string YamlMap::word(const std::string& key) {
  const YAML::Node node = required(key, "a word");
  if (!node.IsDefined()) return {};
  if (node.IsScalar() && !node.Scalar().empty()) return node.Scalar();
  note(key, dump(node), "a word");
  return {};
}

std::string YamlMap::choice(const std::string& key, const std::set<std::string>& allowed, const std::string& fallback) {
  const YAML::Node node = take(key);
  if (!node.IsDefined()) return fallback;
  if (node.IsScalar() && allowed.count(node.Scalar()) > 0) return node.Scalar();
  note(key, dump(node), "one of: " + join(allowed));
  return fallback;
}

std::vector<std::string> YamlMap::words(const std::string& key) {
  const YAML::Node node = required(key, "a list of words");
  std::vector<std::string> values;
  if (!node.IsDefined()) return values;
  bool is_good = node.IsSequence();
  for (std::size_t i = 0; is_good && i < node.size(); ++i) {
    is_good = node[i].IsScalar() && !node[i].Scalar().empty();
    if (is_good) values.push_back(node[i].Scalar());
  }
  if (!is_good) note(key, dump(node), "a list of words");
  return is_good ? values : std::vector<std::string>();
}

std::vector<int> YamlMap::optionalIntegers(const std::string& key, const Interval& allowed) {
  const YAML::Node node = take(key);
  std::vector<int> values;
  if (node.IsDefined() && !node.IsSequence()) {
    note(key, dump(node), "a list of integers " + allowed.text());
  } else {
    for (std::size_t i = 0; node.IsDefined() && i < node.size(); ++i) {
      values.push_back(toInteger(key + "[" + std::to_string(i) + "]", node[i], 0, allowed));
    }
  }
  return values;
}

Eigen::VectorXd YamlMap::numbers(const std::string& key, int count, const Interval& allowed) {
  require(key, std::to_string(count) + " numbers " + allowed.text());
  return numbers(key, Eigen::VectorXd::Zero(count), allowed);
}

Eigen::VectorXd YamlMap::numbers(const std::string& key, const Eigen::VectorXd& fallback, const Interval& allowed) {
  const YAML::Node node = take(key);
  if (!node.IsDefined()) return fallback;
  Eigen::VectorXd values = fallback;
  bool is_good = node.IsSequence() && node.size() == static_cast<std::size_t>(values.size());
  for (Eigen::Index i = 0; is_good && i < values.size(); ++i) is_good = readAllowed(node[i], allowed, &values[i]);
  if (is_good) return values;
  note(key, dump(node), std::to_string(values.size()) + " numbers " + allowed.text());
  return fallback;
}

std::vector<Eigen::Vector2d> YamlMap::pairs(const std::string& key, int min_count, const Interval& allowed) {
  const std::string rule = "at least " + std::to_string(min_count) + " pairs of numbers " + allowed.text();
  const YAML::Node node = required(key, rule);
  std::vector<Eigen::Vector2d> values;
  if (!node.IsDefined()) return values;
  bool is_good = node.IsSequence() && node.size() >= static_cast<std::size_t>(min_count);
  for (std::size_t i = 0; is_good && i < node.size(); ++i) {
    Eigen::Vector2d pair;
    is_good = node[i].IsSequence() && node[i].size() == 2 && readAllowed(node[i][0], allowed, &pair.x()) &&
              readAllowed(node[i][1], allowed, &pair.y());
    values.push_back(pair);
  }
  if (!is_good) note(key, dump(node), rule);
  return is_good ? values : std::vector<Eigen::Vector2d>();
}

YamlMap YamlMap::map(const std::string& key) {
  require(key, "a map");
  YamlMap result = optionalMap(key);
  result.is_noted_ = result.is_noted_ || !has(key);
  return result;
}

YamlMap YamlMap::optionalMap(const std::string& key) {
  return {take(key), pathOf(key), *problems_};
}

std::vector<YamlMap> YamlMap::maps(const std::string& key) {
  const std::string rule = "a list of at least one map";
  const YAML::Node node = required(key, rule);
  if (!node.IsDefined() || (node.IsSequence() && node.size() > 0)) return optionalMaps(key);
  note(key, dump(node), rule);
  return {};
}

std::vector<YamlMap> YamlMap::optionalMaps(const std::string& key) {
  const YAML::Node node = take(key);
  std::vector<YamlMap> result;
  if (node.IsDefined() && !node.IsSequence()) {
    note(key, dump(node), "a list of maps");
  } else {
    for (std::size_t i = 0; node.IsDefined() && i < node.size(); ++i) {
      result.emplace_back(node[i], pathOf(key) + "[" + std::to_string(i) + "]", *problems_);
    }
  }
  return result;
}

void YamlMap::note(const std::string& key, const std::string& value, const std::string& rule) {
  problems_->push_back(pathOf(key) + " = " + value + ", must be " + rule + lineOf(key));
}

void YamlMap::finish() {
  if (!node_.IsMap()) return;
  std::set<std::string> seen;
  for (const auto& entry : node_) {
    const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : dump(entry.first);
    if (!seen.insert(key).second) {
      problems_->push_back(pathOf(key) + " is given twice");
    } else if (known_.count(key) == 0) {
      problems_->push_back(pathOf(key) + " is unknown; known here: " + join(known_) + lineOf(key));
    }
  }
}

YAML::Node YamlMap::take(const std::string& key) {
  known_.insert(key);
  return has(key) ? node_[key] : YAML::Node(YAML::NodeType::Undefined);
}

YAML::Node YamlMap::required(const std::string& key, const std::string& rule) {
  require(key, rule);
  return take(key);
}

int YamlMap::toInteger(const std::string& key, const YAML::Node& node, int fallback, const Interval& allowed) {
  int value = fallback;
  if (read(node, &value) && allowed.contains(value)) return value;
  note(key, withUnit(node, allowed), "an integer " + allowed.text());
  return fallback;
}

std::string YamlMap::pathOf(const std::string& key) const {
  if (path_.empty() && key.empty()) return "the file";
  return path_.empty() || key.empty() ? path_ + key : path_ + "/" + key;
}

/// Of the key, or where it is missing of the map that should have it.
std::string YamlMap::lineOf(const std::string& key) const {
  const YAML::Node node = has(key) ? node_[key] : node_;
  const int line = node.IsDefined() ? node.Mark().line : -1;  // -1: it was made by a program
  return line < 0 ? "" : " (line " + std::to_string(line + 1) + ")";
}

void readYaml(const std::string& text, const std::string& name,
              const std::function<void(YamlMap&, std::vector<std::string>&)>& read) {
  std::vector<std::string> problems;
  try {
    YamlMap root(YAML::Load(text), "", problems);
    read(root, problems);
  } catch (const YAML::Exception& error) {
    problems.push_back("line " + std::to_string(error.mark.line + 1) + ": not valid YAML: " + error.msg);
  }
  std::string message;
  for (const std::string& problem : problems) {
    std::istringstream lines(problem);
    for (std::string line; std::getline(lines, line);) message += (message.empty() ? "" : "\n") + name + ": " + line;
  }
  if (!problems.empty()) throw std::invalid_argument(message);
}

}  // namespace interactive_mapping
