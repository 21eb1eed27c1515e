// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world_ros/simulation_params.h"

#include <cstdint>
#include <limits>

#include <ros/names.h>

#include <interactive_mapping_common_ros/params.h>
#include <interactive_mapping_common_ros/xmlrpc_yaml.h>

#include "simulated_world/field_section.h"

namespace simulated_world_ros {
namespace {

using interactive_mapping::Fields;
using simulated_world::ClockEvent;
using simulated_world::ClockGate;
using simulated_world::ComputingRule;
using simulated_world::fieldSection;
using simulated_world::WaitRule;

constexpr interactive_mapping::Names<ClockMode> kClockModes = {
    {"lockstep", ClockMode::kLockstep}, {"realtime", ClockMode::kRealtime}, {"stepped", ClockMode::kStepped}};

/// A name of a topic, an action or a node; it may be empty.
void nameField(Fields& f, const char* key, std::string& value, const char* text) {
  f(key, value, text);
  std::string reason;
  f.require(value.empty() || ros::names::validate(value, reason),
            std::string(key) + " = '" + value + "', must be a name: " + reason);
}

void requireGiven(Fields& f, const char* key, const std::string& value) {
  f.require(!value.empty(), std::string(key) + " is empty, must be given");
}

void costField(Fields& f, double& cost_s) {
  f("cost_s", cost_s, 0.0, ClockGate::kLongestCost_s, "s", "simulated time charged");
}

void fieldsOf(WaitRule& c, Fields& f) {
  nameField(f, "topic", c.topic, "of the answer");
  requireGiven(f, "topic", c.topic);
  f("after", c.after, simulated_world::kClockEventNames, "what is answered");
  costField(f, c.cost_s);
  nameField(f, "while_action", c.while_action, "only while a goal of this action is open; empty: always");
  nameField(f, "subscriber", c.subscriber, "node that must hear what is answered before the clock begins");
  f.require(
      c.subscriber.empty() || c.after != ClockEvent::kActionResult,
      "subscriber = '" + c.subscriber + "' after action_result, must be after image, odometry, joint_states or scan");
}

void fieldsOf(ComputingRule& c, Fields& f) {
  nameField(f, "action", c.action, "that computes");
  requireGiven(f, "action", c.action);
  costField(f, c.cost_s);
}

/// A list of maps, which ParamsReader does not read.
template <typename Rule>
void readList(const ros::NodeHandle& nh, const std::string& key, std::vector<Rule>* rules,
              std::vector<std::string>* problems) {
  XmlRpc::XmlRpcValue list;
  if (!nh.getParam(key, list)) return;
  if (list.getType() != XmlRpc::XmlRpcValue::TypeArray) return problems->push_back(key + " must be a list of maps");
  YAML::Node entries;
  for (int i = 0; i < list.size(); ++i) {
    entries[key + "[" + std::to_string(i) + "]"] = interactive_mapping_ros::toYaml(list[i]);
  }
  interactive_mapping::FieldReader reader(entries);
  interactive_mapping::FieldChecker checker;
  for (const auto& entry : entries) {
    Rule& rule = rules->emplace_back();
    for (Fields* f : {static_cast<Fields*>(&reader), static_cast<Fields*>(&checker)}) {
      fieldSection(*f, entry.first.Scalar().c_str(), [&] { fieldsOf(rule, *f); });
    }
  }
  for (const auto& found : {reader.finish(), checker.problems}) {
    problems->insert(problems->end(), found.begin(), found.end());
  }
}

}  // namespace

void SimulationParams::fields(SimulationParams& c, Fields& f) {
  simulated_world::SimulationConfig& simulation = c.simulation;
  const auto given = [&f](const char* key, std::string& value, const char* text) {
    f(key, value, text);
    requireGiven(f, key, value);
  };
  given("scene", simulation.scene, "file of the pile; set by the launch file");
  f("has_tags", simulation.has_tags, "false: no brick has tags, whatever the scene says");
  auto seed = static_cast<int>(simulation.seed);
  f("seed", seed, 0, std::numeric_limits<int>::max(), "", "seed of pile, noise and drift");
  simulation.seed = static_cast<std::uint64_t>(seed);
  fieldSection(f, "description", [&] {
    given("urdf", simulation.description.urdf, "file of the robot; this and the next three are set by the launch file");
    given("base_profile", simulation.description.base_profile, "file of the base's profile");
    given("bricks", simulation.description.bricks, "file of the bricks");
    given("arm_pose", simulation.description.arm_pose, "file of the arm's pose at the start");
  });
  fieldSection(f, "clock", [&] {
    f("mode", c.clock, kClockModes,
      "as fast as the machine allows, waiting for what is due; by the wall clock; by the service ~advance alone");
    f("realtime_factor", c.realtime_factor, 0.01, 100.0, "", "speed against the wall clock in mode realtime");
    f("wait_timeout_wall_s", c.wait_timeout_wall_s, 0.1, 3600.0, "s",
      "wall time after which an answer that is due is given up, with an error");
  });
  simulated_world::SimulationConfig::fields(simulation, f);  // from "clock" to "camera"
  fieldSection(f, "camera", [&] {
    f("depth_encoding", c.depth_encoding, "16UC1 [mm] or 32FC1 [m]");
    f.require(c.depth_encoding == "16UC1" || c.depth_encoding == "32FC1",
              "depth_encoding = '" + c.depth_encoding + "', must be 16UC1 (mm) or 32FC1 (m)");
  });
  fieldSection(f, "judge", [&] {
    nameField(f, "pick_action", c.pick_action,
              "action PickBrick of the arm's bridge: the brick of its last goal is what the magnet may touch; empty: "
              "~target");
    nameField(f, "surface_topic", c.surface_topic,
              "the strategy's map: interactive_mapping_msgs/SurfaceMesh or sensor_msgs/PointCloud2");
    f("run_folder", c.run_folder, "folder of judge.csv, events.jsonl and judge.json; empty: nothing is written");
    f("pictures", c.has_pictures,
      "pictures of the world in run_folder: at the start, after each stowed brick, at the end");
    f.require(!c.has_pictures || !c.run_folder.empty(),
              "pictures = true without judge/run_folder, must be false, or the folder given");
  });
  fieldSection(f, "frames", [&] {
    given("map", c.map_frame, "fixed frame");
    given("odom", c.odom_frame, "frame of the odometry");
  });
}

SimulationParams loadSimulationParams(const ros::NodeHandle& private_nh) {
  SimulationParams params;
  interactive_mapping_ros::ParamsReader reader(private_nh);
  SimulationParams::fields(params, reader.fields());
  for (const char* key : {"clock/wait_for", "clock/computing", "image_transport"}) reader.fields().ignore(key);
  std::vector<std::string> problems = interactive_mapping::problemsOf(params);
  readList(private_nh, "clock/wait_for", &params.wait_for, &problems);
  readList(private_nh, "clock/computing", &params.computing, &problems);
  reader.finish(problems);
  return params;
}

}  // namespace simulated_world_ros
