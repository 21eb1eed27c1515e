// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection_ros/nbv_selection_params.h"

#include <XmlRpcValue.h>
#include <interactive_mapping_common_ros/params.h>

namespace nbv_selection_ros {
namespace {

/// Sections with a plugin, used or not: strategies read their own.
std::vector<std::string> strategySections(const ros::NodeHandle& private_nh) {
  std::vector<std::string> names;
  XmlRpc::XmlRpcValue all;
  if (!private_nh.getParam("", all) || all.getType() != XmlRpc::XmlRpcValue::TypeStruct) return names;
  for (auto& [name, value] : all) {
    if (value.getType() == XmlRpc::XmlRpcValue::TypeStruct && value.hasMember("plugin")) names.push_back(name);
  }
  return names;
}

}  // namespace

NbvSelectionParams loadNbvSelectionParams(const ros::NodeHandle& private_nh) {
  NbvSelectionParams params;
  interactive_mapping_ros::ParamsReader reader(private_nh);
  NbvSelectionParams::fields(params, reader.fields());
  for (const std::string& name : strategySections(private_nh)) reader.fields().ignore(name);
  reader.finish(interactive_mapping::problemsOf(params));
  return params;
}

}  // namespace nbv_selection_ros
