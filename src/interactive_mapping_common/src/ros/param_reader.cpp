// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common_ros/param_reader.h>

#include <stdexcept>

#include <yaml-cpp/yaml.h>

#include <ros/param.h>

namespace interactive_mapping_ros {
namespace {

using XmlRpc::XmlRpcValue;

// XmlRpcValue's accessors are not const, and throw an exception that is no std::exception: types are asked for first.
std::string textOf(const XmlRpcValue& value) {
  return value.toXml();
}

YAML::Node toYaml(XmlRpcValue value) {
  switch (value.getType()) {
    case XmlRpcValue::TypeBoolean:
      return YAML::Node(static_cast<bool>(value));
    case XmlRpcValue::TypeInt:
      return YAML::Node(static_cast<int>(value));
    case XmlRpcValue::TypeDouble:
      return YAML::Node(static_cast<double>(value));
    case XmlRpcValue::TypeString:
      return YAML::Node(static_cast<std::string>(value));
    case XmlRpcValue::TypeArray: {
      YAML::Node list(YAML::NodeType::Sequence);
      for (int i = 0; i < value.size(); ++i) list.push_back(toYaml(value[i]));
      return list;
    }
    case XmlRpcValue::TypeStruct: {
      YAML::Node map(YAML::NodeType::Map);
      for (auto& entry : value) map[entry.first] = toYaml(entry.second);
      return map;
    }
    default:
      return YAML::Node(textOf(value));
  }
}

}  // namespace

ParamReader::ParamReader(const ros::NodeHandle& private_nh) : name_space_(private_nh.getNamespace()) {
  ros::param::get(name_space_, root_);
}

const XmlRpcValue* ParamReader::find(const std::string& key) {
  known_.insert(key);
  XmlRpcValue* node = &root_;
  std::size_t begin = 0;
  while (true) {
    if (node->getType() != XmlRpcValue::TypeStruct) return nullptr;
    const std::size_t slash = key.find('/', begin);
    const std::string part = key.substr(begin, slash == std::string::npos ? slash : slash - begin);
    if (!node->hasMember(part)) return nullptr;
    node = &(*node)[part];
    if (slash == std::string::npos) return node;
    begin = slash + 1;
  }
}

void ParamReader::reportType(const std::string& key, const XmlRpcValue& value, const char* wanted) {
  problems_.push_back(name_space_ + "/" + key + " = " + textOf(value) + ", must be " + wanted);
}

void ParamReader::read(const std::string& key, double* value) {
  const XmlRpcValue* found = find(key);
  if (found == nullptr) return;
  XmlRpcValue copy = *found;
  if (copy.getType() == XmlRpcValue::TypeDouble) {
    *value = static_cast<double>(copy);
  } else if (copy.getType() == XmlRpcValue::TypeInt) {
    *value = static_cast<int>(copy);
  } else {
    reportType(key, copy, "a number");
  }
}

void ParamReader::read(const std::string& key, int* value) {
  const XmlRpcValue* found = find(key);
  if (found == nullptr) return;
  XmlRpcValue copy = *found;
  if (copy.getType() == XmlRpcValue::TypeInt) {
    *value = static_cast<int>(copy);
  } else {
    reportType(key, copy, "a whole number");
  }
}

void ParamReader::read(const std::string& key, bool* value) {
  const XmlRpcValue* found = find(key);
  if (found == nullptr) return;
  XmlRpcValue copy = *found;
  if (copy.getType() == XmlRpcValue::TypeBoolean) {
    *value = static_cast<bool>(copy);
  } else {
    reportType(key, copy, "true or false");
  }
}

void ParamReader::read(const std::string& key, std::string* value) {
  const XmlRpcValue* found = find(key);
  if (found == nullptr) return;
  XmlRpcValue copy = *found;
  if (copy.getType() == XmlRpcValue::TypeString) {
    *value = static_cast<std::string>(copy);
  } else {
    reportType(key, copy, "a text");
  }
}

void ParamReader::read(const std::string& key, std::vector<std::string>* value) {
  const XmlRpcValue* found = find(key);
  if (found == nullptr) return;
  XmlRpcValue copy = *found;
  std::vector<std::string> texts;
  bool is_list = copy.getType() == XmlRpcValue::TypeArray;
  for (int i = 0; is_list && i < copy.size(); ++i) {
    is_list = copy[i].getType() == XmlRpcValue::TypeString;
    if (is_list) texts.push_back(static_cast<std::string>(copy[i]));
  }
  if (is_list) {
    *value = texts;
  } else {
    reportType(key, copy, "a list of texts");
  }
}

void ParamReader::read(const std::string& key, std::vector<double>* value) {
  const XmlRpcValue* found = find(key);
  if (found == nullptr) return;
  XmlRpcValue copy = *found;
  std::vector<double> numbers;
  bool is_list = copy.getType() == XmlRpcValue::TypeArray;
  for (int i = 0; is_list && i < copy.size(); ++i) {
    if (copy[i].getType() == XmlRpcValue::TypeDouble) {
      numbers.push_back(static_cast<double>(copy[i]));
    } else if (copy[i].getType() == XmlRpcValue::TypeInt) {
      numbers.push_back(static_cast<int>(copy[i]));
    } else {
      is_list = false;
    }
  }
  if (is_list) {
    *value = numbers;
  } else {
    reportType(key, copy, "a list of numbers");
  }
}

std::string ParamReader::yamlOf(const std::string& section) {
  const XmlRpcValue* found = find(section);
  if (found == nullptr) return "";
  YAML::Emitter text;
  text.SetDoublePrecision(17);
  text << toYaml(*found);
  return text.c_str();
}

void ParamReader::report(const std::string& section, const std::vector<std::string>& problems) {
  for (const std::string& problem : problems) {
    problems_.push_back(name_space_ + "/" + section + (section.empty() ? "" : "/") + problem);
  }
}

void ParamReader::reportUnknown(const XmlRpcValue& section, const std::string& prefix) {
  if (section.getType() != XmlRpcValue::TypeStruct) return;
  XmlRpcValue copy = section;
  for (auto& entry : copy) {
    const std::string key = prefix + entry.first;
    if (known_.count(key) > 0) continue;
    // A key is known, too, when something below it is.
    const auto below = known_.lower_bound(key + "/");
    if (below != known_.end() && below->compare(0, key.size() + 1, key + "/") == 0) {
      if (entry.second.getType() != XmlRpcValue::TypeStruct) {
        reportType(key, entry.second, "a section with keys");
      } else {
        reportUnknown(entry.second, key + "/");
      }
    } else {
      problems_.push_back(name_space_ + "/" + key + " is unknown");
    }
  }
}

void ParamReader::finish() {
  reportUnknown(root_, "");
  if (problems_.empty()) return;
  std::string text = "refused parameters:";
  for (const std::string& problem : problems_) text += "\n  " + problem;
  throw std::invalid_argument(text);
}

}  // namespace interactive_mapping_ros
