// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <initializer_list>
#include <string>

#include <ros/node_handle.h>

#include <interactive_mapping_common_ros/param_reader.h>
#include <interactive_mapping_common_ros/param_writer.h>

/// Parameters of nodes whose one table of keys is visit_params(params, visit), which calls visit(key, value) for each.
namespace interactive_mapping_ros {

template <typename Params, typename VisitParams>
std::string paramsToYaml(const Params& params, VisitParams&& visit_params) {
  ParamWriter writer;
  visit_params(params, [&writer](const std::string& key, const auto& value) { writer.write(key, value); });
  return writer.text();
}

/// Reads `~` parameters but for the `ignored` ones, which others read. Throws one std::invalid_argument that lists every
/// unknown key, every wrong type and all that `problems_of(params)` returns.
template <typename Params, typename VisitParams, typename ProblemsOf>
Params loadParams(const ros::NodeHandle& private_nh, VisitParams&& visit_params,
                  std::initializer_list<const char*> ignored, ProblemsOf&& problems_of) {
  Params params;
  ParamReader reader(private_nh);
  visit_params(params, [&reader](const std::string& key, auto& value) { reader.read(key, &value); });
  for (const char* key : ignored) reader.ignore(key);
  reader.report("", problems_of(params));
  reader.finish();
  return params;
}

template <typename Params, typename VisitParams>
Params loadParams(const ros::NodeHandle& private_nh, VisitParams&& visit_params,
                  std::initializer_list<const char*> ignored = {}) {
  return loadParams<Params>(private_nh, visit_params, ignored, [](const Params& params) { return params.validate(); });
}

}  // namespace interactive_mapping_ros
