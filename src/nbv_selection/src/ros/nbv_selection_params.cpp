// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection_ros/nbv_selection_params.h"

#include <set>
#include <utility>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common_ros/params.h>

namespace nbv_selection_ros {
namespace {

/// visit(key, value) for each key.
constexpr auto kVisitParams = [](auto& params, auto&& visit) {
  visit("map_frame", params.map_frame);
  visit("base_frame", params.base_frame);
  visit("base_profile_file", params.base_profile_file);
  visit("sectors_file", params.sectors_file);
  visit("strategies", params.strategies);
  visit("seed", params.seed);
  visit("input/max_grid_age_s", params.input.max_grid_age_s);
  visit("input/occupied_from", params.input.occupied_from);
  visit("input/max_pose_age_s", params.input.max_pose_age_s);
  visit("input/map_wait_s", params.input.map_wait_s);
  visit("input/answer_timeout_s", params.input.answer_timeout_s);
  visit("failures/cell_m", params.failures.cell_m);
  visit("failures/radius_m", params.failures.radius_m);
  visit("cost/select_s", params.cost.select_s);
  visit("cost/stall_s", params.cost.stall_s);
  visit("max_attempts", params.max_attempts);
};

/// Can be a parameter's name.
bool isName(const std::string& text) {
  if (text.empty() || (text[0] >= '0' && text[0] <= '9')) return false;
  return text.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_") == std::string::npos;
}

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

std::vector<std::string> NbvSelectionParams::validate() const {
  std::vector<std::string> problems;
  const std::pair<const char*, const std::string*> frames[] = {{"map_frame", &map_frame}, {"base_frame", &base_frame}};
  for (const auto& [key, frame] : frames) {
    if (frame->empty() || frame->front() == '/') {
      problems.push_back(std::string(key) + " = '" + *frame + "', must be a tf2 frame: no leading slash");
    }
  }
  if (base_frame == map_frame) {
    problems.push_back("base_frame = '" + base_frame + "', must be another frame than map_frame");
  }
  const std::pair<const char*, const std::string*> files[] = {{"base_profile_file", &base_profile_file},
                                                              {"sectors_file", &sectors_file}};
  for (const auto& [key, file] : files) {
    const bool is_left_out = file->empty() && file == &sectors_file;
    if (!is_left_out && (file->empty() || file->front() != '/')) {
      problems.push_back(std::string(key) + " = '" + *file + "', must be the absolute path of a file");
    }
  }
  if (strategies.empty()) problems.emplace_back("strategies = [], must be at least one");
  std::set<std::string> names;
  for (const std::string& name : strategies) {
    if (!isName(name)) problems.push_back("strategies holds '" + name + "', must be letters, digits and underscores");
    if (!names.insert(name).second) problems.push_back("strategies holds '" + name + "' twice, must be once");
  }
  interactive_mapping::RangeCheck check;
  if (input.max_grid_age_s != 0.0) check("input/max_grid_age_s", input.max_grid_age_s, 0.1, 3600.0, "s");
  check("input/occupied_from", input.occupied_from, 1, 100, "");
  check("input/max_pose_age_s", input.max_pose_age_s, 0.05, 60.0, "s");
  check("input/map_wait_s", input.map_wait_s, 0.0, 60.0, "s");
  check("input/answer_timeout_s", input.answer_timeout_s, 0.1, 600.0, "s");
  check("failures/cell_m", failures.cell_m, 0.01, 1.0, "m");
  check("failures/radius_m", failures.radius_m, 0.0, 10.0, "m");
  check("cost/select_s", cost.select_s, 0.0, 60.0, "s");
  check("cost/stall_s", cost.stall_s, 0.1, 600.0, "s");
  check("max_attempts", max_attempts, 1, 20, "");
  problems.insert(problems.end(), check.problems().begin(), check.problems().end());
  return problems;
}

std::string toYaml(const NbvSelectionParams& params) {
  return interactive_mapping_ros::paramsToYaml(params, kVisitParams);
}

NbvSelectionParams loadNbvSelectionParams(const ros::NodeHandle& private_nh) {
  NbvSelectionParams params;
  interactive_mapping_ros::ParamReader reader(private_nh);
  kVisitParams(params, [&reader](const std::string& key, auto& value) { reader.read(key, &value); });
  for (const std::string& name : strategySections(private_nh)) reader.ignore(name);
  reader.ignore("diagnostic_period");
  reader.report("", params.validate());
  reader.finish();
  return params;
}

}  // namespace nbv_selection_ros
