// SPDX-License-Identifier: BSD-3-Clause
#include "interactive_mapping_common_ros/params.h"

#include <cmath>

#include <ros/param.h>

#include "interactive_mapping_common_ros/xmlrpc_yaml.h"

namespace interactive_mapping_ros {
namespace {

using XmlRpc::XmlRpcValue;

template <typename Value>
YAML::Node tagged(const Value& value, const char* tag) {
  YAML::Node node(value);
  node.SetTag(tag);
  return node;
}

/// yaml-cpp before 0.7 writes nan and inf as no YAML.
YAML::Node tagged(double value) {
  if (std::isnan(value)) return tagged(".nan", "!!float");
  if (std::isinf(value)) return tagged(value > 0.0 ? ".inf" : "-.inf", "!!float");
  return tagged(value, "!!float");
}

YAML::Node treeBelow(const std::string& name_space) {
  XmlRpcValue root;
  return ros::param::get(name_space, root) ? toYaml(root) : YAML::Node(YAML::NodeType::Map);
}

}  // namespace

// XmlRpcValue's accessors are not const: a copy.
YAML::Node toYaml(XmlRpcValue value) {
  switch (value.getType()) {
    case XmlRpcValue::TypeBoolean:
      return tagged(static_cast<bool>(value), "!!bool");
    case XmlRpcValue::TypeInt:
      return tagged(static_cast<int>(value), "!!int");
    case XmlRpcValue::TypeDouble:
      return tagged(static_cast<double>(value));
    case XmlRpcValue::TypeString:
      return tagged(static_cast<std::string>(value), "!");
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
      return tagged(value.toXml(), "!");
  }
}

ParamsReader::ParamsReader(const ros::NodeHandle& private_nh)
    : name_space_(private_nh.getNamespace()), reader_(treeBelow(name_space_)) {
  reader_.ignore("diagnostic_period");  // read by diagnostic_updater
  reader_.ignore("diagnostic_updater");
}

void ParamsReader::finish(const std::vector<std::string>& problems) {
  std::vector<std::string> all;
  for (const std::string& problem : reader_.finish()) all.push_back(name_space_ + "/" + problem);
  for (const std::string& problem : problems) all.push_back(name_space_ + "/" + problem);
  interactive_mapping::refuseIfAny("refused parameters:", all);
}

}  // namespace interactive_mapping_ros
