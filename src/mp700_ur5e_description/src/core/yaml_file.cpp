// SPDX-License-Identifier: BSD-3-Clause
#include "yaml_file.h"

#include <fstream>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace mp700_ur5e_description {
namespace {

std::string dump(const YAML::Node& node) {
  YAML::Emitter emitter;
  emitter.SetMapFormat(YAML::Flow);
  emitter.SetSeqFormat(YAML::Flow);
  emitter << node;
  return emitter.c_str();
}

/// Quoted scalars are words, whatever they spell.
bool isPlain(const YAML::Node& node) {
  return node.IsScalar() && node.Tag() != "!";
}

/// Not a number and infinity are in no interval.
bool readNumber(const YAML::Node& node, double& value) {
  return isPlain(node) && YAML::convert<double>::decode(node, value);
}

[[noreturn]] void refuse(const std::string& name, const std::vector<std::string>& problems) {
  std::string message;
  for (const std::string& problem : problems) message += (message.empty() ? "" : "\n") + name + ": " + problem;
  throw std::invalid_argument(message);
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

YamlMap::YamlMap(YAML::Node node, std::string path, std::vector<std::string>& problems)
    : node_(std::move(node)), path_(std::move(path)), problems_(&problems) {
  if (!node_.IsMap()) {
    problems_->push_back((path_.empty() ? "the file" : path_) + " = " + dump(node_) + ", must be a map");
    node_ = YAML::Node(YAML::NodeType::Null);
  }
}

double YamlMap::number(const std::string& key, const Interval& allowed) {
  const std::string rule = "a number " + allowed.text();
  const YAML::Node node = take(key, rule);
  double value = 0.0;
  if (node.IsDefined() && (!readNumber(node, value) || !allowed.contains(value))) note(key, dump(node), rule);
  return value;
}

int YamlMap::integer(const std::string& key, const Interval& allowed) {
  const std::string rule = "an integer " + allowed.text();
  const YAML::Node node = take(key, rule);
  int value = 0;
  if (node.IsDefined() &&
      (!isPlain(node) || !YAML::convert<int>::decode(node, value) || !allowed.contains(static_cast<double>(value)))) {
    note(key, dump(node), rule);
  }
  return value;
}

std::string YamlMap::word(const std::string& key) {
  const YAML::Node node = take(key, "a word");
  if (!node.IsDefined()) return {};
  if (!node.IsScalar() || node.Scalar().empty()) {
    note(key, dump(node), "a word");
    return {};
  }
  return node.Scalar();
}

std::vector<std::string> YamlMap::words(const std::string& key) {
  const YAML::Node node = take(key, "a list of words");
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

Eigen::VectorXd YamlMap::numbers(const std::string& key, int count, const Interval& allowed) {
  const std::string rule = std::to_string(count) + " numbers " + allowed.text();
  const YAML::Node node = take(key, rule);
  Eigen::VectorXd values = Eigen::VectorXd::Zero(count);
  if (!node.IsDefined()) return values;
  bool is_good = node.IsSequence() && node.size() == static_cast<std::size_t>(count);
  for (int i = 0; is_good && i < count; ++i) is_good = readNumber(node[i], values[i]) && allowed.contains(values[i]);
  if (!is_good) note(key, dump(node), rule);
  return values;
}

std::vector<Eigen::Vector2d> YamlMap::pairs(const std::string& key, int min_count, const Interval& allowed) {
  const std::string rule = "at least " + std::to_string(min_count) + " pairs of numbers " + allowed.text();
  const YAML::Node node = take(key, rule);
  std::vector<Eigen::Vector2d> values;
  if (!node.IsDefined()) return values;
  bool is_good = node.IsSequence() && node.size() >= static_cast<std::size_t>(min_count);
  for (std::size_t i = 0; is_good && i < node.size(); ++i) {
    Eigen::Vector2d pair;
    is_good = node[i].IsSequence() && node[i].size() == 2 && readNumber(node[i][0], pair.x()) &&
              readNumber(node[i][1], pair.y()) && allowed.contains(pair.x()) && allowed.contains(pair.y());
    values.push_back(pair);
  }
  if (!is_good) note(key, dump(node), rule);
  return is_good ? values : std::vector<Eigen::Vector2d>();
}

YamlMap YamlMap::map(const std::string& key) {
  const YAML::Node node = take(key, "a map");
  // What is missing was noted; an empty map stands in for it and the keys within are not missed one by one.
  YamlMap result(node.IsDefined() ? node : YAML::Node(YAML::NodeType::Map), pathOf(key), *problems_);
  if (!node.IsDefined()) result.node_ = YAML::Node(YAML::NodeType::Null);
  return result;
}

std::vector<YamlMap> YamlMap::maps(const std::string& key) {
  const std::string rule = "a list of at least one map";
  const YAML::Node node = take(key, rule);
  std::vector<YamlMap> result;
  if (!node.IsDefined()) return result;
  if (!node.IsSequence() || node.size() == 0) {
    note(key, dump(node), rule);
    return result;
  }
  for (std::size_t i = 0; i < node.size(); ++i) {
    result.emplace_back(node[i], pathOf(key) + "[" + std::to_string(i) + "]", *problems_);
  }
  return result;
}

void YamlMap::finish() {
  if (!node_.IsMap()) return;
  std::set<std::string> seen;
  std::string known;
  for (const std::string& key : known_) known += (known.empty() ? "" : ", ") + key;
  for (const auto& entry : node_) {
    const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : dump(entry.first);
    if (!seen.insert(key).second) {
      problems_->push_back(pathOf(key) + " is given twice");
    } else if (known_.count(key) == 0) {
      problems_->push_back(pathOf(key) + " is unknown; known here: " + known);
    }
  }
}

YAML::Node YamlMap::take(const std::string& key, const std::string& rule) {
  known_.insert(key);
  const YAML::Node undefined(YAML::NodeType::Undefined);
  if (!node_.IsMap()) return undefined;  // noted already
  const YAML::Node node = const_cast<const YAML::Node&>(node_)[key];
  if (!node.IsDefined()) {
    note(key, "(missing)", rule);
    return undefined;
  }
  return node;
}

void YamlMap::note(const std::string& key, const std::string& value, const std::string& rule) {
  problems_->push_back(pathOf(key) + " = " + value + ", must be " + rule);
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
  if (!problems.empty()) refuse(name, problems);
}

std::string readText(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  if (!file || !(text << file.rdbuf())) refuse(path, {"cannot be read, or is empty"});
  return text.str();
}

}  // namespace mp700_ur5e_description
