// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission_ros/pick_mission_params.h"

#include <utility>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common_ros/params.h>
#include <ros/names.h>

namespace pick_mission_ros {
namespace {

/// visit(key, value) for each key.
constexpr auto kVisitParams = [](auto& params, auto&& visit) {
  visit("map_frame", params.map_frame);
  visit("base_frame", params.base_frame);
  visit("sectors_file", params.sectors_file);
  visit("bricks_file", params.bricks_file);
  visit("run_folder", params.run_folder);
  visit("autostart", params.autostart);
  visit("scene", params.info.scene);
  visit("seed", params.info.seed);
  visit("strategy", params.info.strategy);
  visit("removed_factor", params.info.removed_factor);
  visit("stow", params.stow);
  visit("heartbeat/rate_hz", params.heartbeat_rate_hz);
  visit("heartbeat/max_stall_s", params.max_stall_s);
  visit("input/max_bridge_age_s", params.max_bridge_age_s);
  visit("input/max_tf_age_s", params.max_tf_age_s);
  visit("servers/timeout_s", params.server_timeout_s);
  visit("servers/service_timeout_s", params.service_timeout_s);
  visit("servers/detect_stall_s", params.detect_stall_s);
  visit("nodes/map", params.nodes.map);
  visit("nodes/planner", params.nodes.planner);
  visit("nodes/bridge", params.nodes.bridge);
  visit("nodes/detection", params.nodes.detection);
  visit("nodes/selection", params.nodes.selection);
  visit("nodes/navigation", params.nodes.navigation);
  visit("nodes/move_base", params.nodes.move_base);
  pick_mission::visitMissionFields(params.mission, visit);
};

}  // namespace

std::vector<std::string> PickMissionParams::validate() const {
  std::vector<std::string> problems = mission.validate();
  const std::pair<const char*, const std::string*> frames[] = {
      {"map_frame", &map_frame}, {"base_frame", &base_frame}, {"stow", &stow}};
  for (const auto& [key, frame] : frames) {
    if (frame->empty() || frame->front() == '/') {
      problems.push_back(std::string(key) + " = '" + *frame + "', must be a tf2 frame: no leading slash");
    }
  }
  if (base_frame == map_frame) {
    problems.push_back("base_frame = '" + base_frame + "', must be another frame than map_frame");
  }
  const std::pair<const char*, const std::string*> files[] = {{"sectors_file", &sectors_file},
                                                              {"bricks_file", &bricks_file}};
  for (const auto& [key, file] : files) {
    if (file->empty() || file->front() != '/') {
      problems.push_back(std::string(key) + " = '" + *file + "', must be the absolute path of a file");
    }
  }
  if (!run_folder.empty() && run_folder.front() != '/') {
    problems.push_back("run_folder = '" + run_folder + "', must be the absolute path of a folder, or empty");
  }
  const std::pair<const char*, const std::string*> names[] = {{"nodes/map", &nodes.map},
                                                              {"nodes/planner", &nodes.planner},
                                                              {"nodes/bridge", &nodes.bridge},
                                                              {"nodes/detection", &nodes.detection},
                                                              {"nodes/selection", &nodes.selection},
                                                              {"nodes/navigation", &nodes.navigation},
                                                              {"nodes/move_base", &nodes.move_base}};
  for (const auto& [key, name] : names) {
    std::string why;
    if (name->empty() || !ros::names::validate(*name, why)) {
      problems.push_back(std::string(key) + " = '" + *name + "', must be a name of a node" +
                         (why.empty() ? "" : ": " + why));
    }
  }
  interactive_mapping::RangeCheck check;
  check("heartbeat/rate_hz", heartbeat_rate_hz, 1.0, 100.0, "Hz");
  check("heartbeat/max_stall_s", max_stall_s, 0.5, 60.0, "s");
  check("input/max_bridge_age_s", max_bridge_age_s, 0.05, 60.0, "s");
  check("input/max_tf_age_s", max_tf_age_s, 0.05, 60.0, "s");
  check("servers/timeout_s", server_timeout_s, 0.5, 600.0, "s");
  check("servers/service_timeout_s", service_timeout_s, 0.5, 600.0, "s");
  check("servers/detect_stall_s", detect_stall_s, 1.0, 3600.0, "s");
  problems.insert(problems.end(), check.problems().begin(), check.problems().end());
  return problems;
}

std::string toYaml(const PickMissionParams& params) {
  return interactive_mapping_ros::paramsToYaml(params, kVisitParams);
}

PickMissionParams loadPickMissionParams(const ros::NodeHandle& private_nh) {
  return interactive_mapping_ros::loadParams<PickMissionParams>(private_nh, kVisitParams, {"diagnostic_period"});
}

}  // namespace pick_mission_ros
