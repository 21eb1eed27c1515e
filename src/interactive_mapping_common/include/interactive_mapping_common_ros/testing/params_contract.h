// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fstream>
#include <functional>
#include <map>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>
#include <ros/node_handle.h>
#include <yaml-cpp/yaml.h>

/// What every node's parameters have to fulfil, for the packages' test_*_params.
namespace params_contract {

using Values = std::map<std::string, std::string>;  // "input/pose_limits/max_step_m" -> "0.300000"

inline std::string readText(const std::string& path) {
  std::ifstream in(path);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// visit(key with its sections, scalar or list) for each that is no section.
inline void forEachScalar(const YAML::Node& node, const std::string& prefix,
                          const std::function<void(const std::string&, const YAML::Node&)>& visit) {
  for (const auto& entry : node) {
    const std::string key = prefix + entry.first.as<std::string>();
    if (entry.second.IsMap()) {
      forEachScalar(entry.second, key + "/", visit);
    } else {
      visit(key, entry.second);
    }
  }
}

/// As it is written on one line: "[a, b]" for a list.
inline std::string textOf(const YAML::Node& value) {
  if (!value.IsSequence()) return value.as<std::string>();
  std::string text;
  for (const YAML::Node& item : value) text += (text.empty() ? "" : ", ") + item.as<std::string>();
  return "[" + text + "]";
}

/// Numbers that are equal are the same text, in lists too.
inline std::string canonicalTextOf(const YAML::Node& value) {
  double number = 0.0;
  if (YAML::convert<double>::decode(value, number)) return std::to_string(number);
  if (!value.IsSequence()) return textOf(value);
  std::string text;
  for (const YAML::Node& item : value) text += (text.empty() ? "" : ", ") + canonicalTextOf(item);
  return "[" + text + "]";
}

inline Values flattened(const YAML::Node& yaml) {
  Values values;
  forEachScalar(yaml, "",
                [&values](const std::string& key, const YAML::Node& value) { values[key] = canonicalTextOf(value); });
  return values;
}
inline Values flattened(const std::string& yaml_text) {
  return flattened(YAML::Load(yaml_text));
}

struct Contract {
  std::string package_dir;
  std::string config_file;                                  // below package_dir
  std::string default_yaml;                                 // of a default-constructed struct
  std::function<std::string(const ros::NodeHandle&)> load;  // and back to YAML
  std::set<std::string> whole_numbers;
  std::map<std::string, XmlRpc::XmlRpcValue>
      others;  // allowed values that are not the default, where 0.8 .. 0.9 times it is not
};

inline void expectShippedFileHasEveryDefault(const Contract& contract) {
  EXPECT_EQ(flattened(readText(contract.package_dir + "/" + contract.config_file)), flattened(contract.default_yaml));
}

/// `index` makes it another one for each key: two that are mixed up are found though their defaults are equal.
inline XmlRpc::XmlRpcValue otherThan(const Contract& contract, const std::string& key, const std::string& value,
                                     int index) {
  const auto other = contract.others.find(key);
  if (other != contract.others.end()) return other->second;
  if (value == "true" || value == "false") return value == "false";
  if (contract.whole_numbers.count(key) > 0) return std::stoi(value) + 1;
  if (std::stod(value) == 0.0) return 0.002 + 1e-5 * index;
  return (0.9 - 0.001 * index) * std::stod(value);
}

/// Sets every key below `nh` to something else; each must come back, and none in another's place.
inline void expectEveryKeyIsReadIntoItsOwnField(const Contract& contract, const ros::NodeHandle& nh) {
  YAML::Node changed;
  int index = 0;
  const Values defaults = flattened(contract.default_yaml);
  for (const auto& [key, value] : defaults) {
    XmlRpc::XmlRpcValue other = otherThan(contract, key, value, index++);
    nh.setParam(key, other);
    switch (other.getType()) {
      case XmlRpc::XmlRpcValue::TypeDouble:
        changed[key] = static_cast<double>(other);
        break;
      case XmlRpc::XmlRpcValue::TypeInt:
        changed[key] = static_cast<int>(other);
        break;
      case XmlRpc::XmlRpcValue::TypeBoolean:
        changed[key] = static_cast<bool>(other);
        break;
      case XmlRpc::XmlRpcValue::TypeArray:
        for (int i = 0; i < other.size(); ++i) {
          if (other[i].getType() == XmlRpc::XmlRpcValue::TypeDouble) {
            changed[key].push_back(static_cast<double>(other[i]));
          } else {
            changed[key].push_back(static_cast<std::string>(other[i]));
          }
        }
        break;
      default:
        changed[key] = static_cast<std::string>(other);
    }
  }
  const Values expected = flattened(changed);
  for (const auto& [key, value] : expected) EXPECT_NE(value, defaults.at(key)) << key << ": the test changes nothing";
  EXPECT_EQ(flattened(contract.load(nh)), expected);
}

inline void expectReadmeTableHasEveryDefault(const Contract& contract) {
  const std::string readme = readText(contract.package_dir + "/README.md");
  std::size_t rows = 0;
  forEachScalar(YAML::LoadFile(contract.package_dir + "/" + contract.config_file), "",
                [&](const std::string& key, const YAML::Node& value) {
                  const std::string text = textOf(value).empty() ? "\"\"" : textOf(value);
                  const std::string row = "| `" + key + "` | " + text + " |";
                  EXPECT_NE(readme.find(row), std::string::npos) << row;
                  ++rows;
                });
  EXPECT_EQ(rows, flattened(contract.default_yaml).size());
}

/// What loading from `nh` complains of; empty: nothing.
inline std::string messageOf(const Contract& contract, const ros::NodeHandle& nh) {
  try {
    contract.load(nh);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

}  // namespace params_contract
