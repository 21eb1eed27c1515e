// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission_ros/pick_mission_params.h"

#include <limits>

#include <interactive_mapping_common_ros/params.h>
#include <ros/names.h>

namespace pick_mission_ros {

using interactive_mapping::Fields;

void PickMissionParams::Nodes::fields(Nodes& c, Fields& f) {
  const auto node = [&f](const char* key, std::string& name, const char* text) {
    f(key, name, text);
    std::string why;
    const bool is_name = !name.empty() && ros::names::validate(name, why);
    f.require(is_name,
              std::string(key) + " = '" + name + "', must be a name of a node" + (why.empty() ? "" : ": " + why));
  };
  node("map", c.map, "its topic update is used");
  node("planner", c.planner, "its actions plan_arm and plan_pick are used");
  node("bridge", c.bridge, "its move, pick, let_go, recover, hold, release and its topic state are used");
  node("detection", c.detection, "its service detect and its topic bricks are used");
  node("selection", c.selection, "its action select and its service report_failure are used");
  node("navigation", c.navigation, "its topic outcome is used; other navigations have none");
  node("move_base", c.move_base, "the action itself");
  f("unload", c.unload, "service that empties the container at the depot; empty: a person does, and calls ~unloaded");
}

void PickMissionParams::fields(PickMissionParams& c, Fields& f) {
  const auto frame = [&f](const char* key, std::string& name, const char* text) {
    f(key, name, text);
    f.require(!name.empty() && name.front() != '/',
              std::string(key) + " = '" + name + "', must be a tf2 frame: no leading slash");
  };
  const auto file = [&f](const char* key, std::string& path, const char* text) {
    f(key, path, text);
    f.require(!path.empty() && path.front() == '/',
              std::string(key) + " = '" + path + "', must be the absolute path of a file");
  };
  frame("map_frame", c.map_frame, "fixed frame");
  frame("base_frame", c.base_frame, "frame of the base");
  f.require(c.base_frame != c.map_frame, "base_frame = '" + c.base_frame + "', must be another frame than map_frame");
  file("sectors_file", c.sectors_file, "absolute path of a file made by fit_manipulability; set by the launch file");
  file("bricks_file", c.bricks_file, "absolute path of a bricks.yaml, for the markers' sizes; set by the launch file");
  f("run_folder", c.run_folder, "absolute path; empty: nothing is written, and nothing survives a restart");
  f.require(c.run_folder.empty() || c.run_folder.front() == '/',
            "run_folder = '" + c.run_folder + "', must be the absolute path of a folder, or empty");
  f("autostart", c.autostart, "true: starts without the operator, after a crash too");
  f("scene", c.info.scene, "name of the scene, for the summary");
  f("seed", c.info.seed, 0, std::numeric_limits<int>::max(), "", "seed of the scene, for the summary");
  f("strategy", c.info.strategy, "strategy of the view selection, also for the summary; empty: its default");
  f("removed_factor", c.info.removed_factor, "factor that an ablation removes, for the summary");
  pick_mission::MissionConfig::fields(c.mission, f);
  f.section("heartbeat", c.heartbeat);
  f.section("input", c.input);
  f.section("servers", c.servers);
  f.section("nodes", c.nodes);
}

PickMissionParams loadPickMissionParams(const ros::NodeHandle& private_nh) {
  return interactive_mapping_ros::loadParams<PickMissionParams>(private_nh);
}

}  // namespace pick_mission_ros
