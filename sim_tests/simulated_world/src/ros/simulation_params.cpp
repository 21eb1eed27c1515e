// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world_ros/simulation_params.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <stdexcept>

#include <XmlRpcValue.h>
#include <ros/names.h>

#include <interactive_mapping_common_ros/params.h>

#include "simulated_world/field_section.h"

namespace simulated_world_ros {
namespace {

using interactive_mapping::Fields;
using simulated_world::ClockEvent;
using simulated_world::fieldSection;
using XmlRpc::XmlRpcValue;

constexpr interactive_mapping::Names<ClockMode> kClockModes = {
    {"lockstep", ClockMode::kLockstep}, {"realtime", ClockMode::kRealtime}, {"stepped", ClockMode::kStepped}};

/// What forbids this name of a topic, an action or a node; empty: nothing, and nothing forbids an empty one.
std::string problemOfName(const std::string& key, const std::string& name) {
  std::string reason;
  if (name.empty() || ros::names::validate(name, reason)) return "";
  return key + " = '" + name + "', must be a name: " + reason;
}

std::string join(const std::vector<std::string>& words) {
  std::string all;
  for (const std::string& word : words) all += (all.empty() ? "" : ", ") + word;
  return all;
}

/// One rule of a list: a map of known keys with texts and numbers.
class Rule {
 public:
  Rule(XmlRpcValue value, std::string where, std::vector<std::string>* problems)
      : value_(std::move(value)), where_(std::move(where)), problems_(problems) {}

  bool requireKeys(const std::vector<std::string>& known) {
    if (value_.getType() != XmlRpcValue::TypeStruct) {
      problems_->push_back(where_ + " must be a map of " + join(known));
      return false;
    }
    for (const auto& entry : value_) {
      if (std::find(known.begin(), known.end(), entry.first) == known.end()) {
        problems_->push_back(where_ + "/" + entry.first + " is unknown; known: " + join(known));
      }
    }
    return true;
  }

  std::string text(const std::string& key, const std::string& fallback) {
    if (!value_.hasMember(key)) return fallback;
    XmlRpcValue& value = value_[key];
    if (value.getType() == XmlRpcValue::TypeString) return static_cast<std::string>(value);
    problems_->push_back(where_ + "/" + key + " must be a text");
    return fallback;
  }
  std::string rosName(const std::string& key) {
    std::string value = text(key, "");
    const std::string problem = problemOfName(where_ + "/" + key, value);
    if (!problem.empty()) problems_->push_back(problem);
    return value;
  }

  double number(const std::string& key, double fallback) {
    if (!value_.hasMember(key)) return fallback;
    XmlRpcValue& value = value_[key];
    if (value.getType() == XmlRpcValue::TypeInt) return static_cast<int>(value);
    if (value.getType() == XmlRpcValue::TypeDouble) return static_cast<double>(value);
    problems_->push_back(where_ + "/" + key + " must be a number");
    return fallback;
  }

 private:
  XmlRpcValue value_;
  std::string where_;
  std::vector<std::string>* problems_;
};

std::vector<Rule> rulesOf(const ros::NodeHandle& nh, const std::string& key, std::vector<std::string>* problems) {
  std::vector<Rule> rules;
  XmlRpcValue list;
  if (!nh.getParam(key, list)) return rules;
  if (list.getType() != XmlRpcValue::TypeArray) {
    problems->push_back(key + " must be a list");
    return rules;
  }
  for (int i = 0; i < list.size(); ++i) rules.emplace_back(list[i], key + "[" + std::to_string(i) + "]", problems);
  return rules;
}

void readRules(const ros::NodeHandle& nh, SimulationParams* params, std::vector<std::string>* problems) {
  for (Rule& rule : rulesOf(nh, "clock/wait_for", problems)) {
    if (!rule.requireKeys({"topic", "after", "cost_s", "while_action", "subscriber"})) continue;
    simulated_world::WaitRule wait;
    wait.topic = rule.rosName("topic");
    wait.cost_s = rule.number("cost_s", 0.0);
    wait.while_action = rule.rosName("while_action");
    wait.subscriber = rule.rosName("subscriber");
    const std::string after = rule.text("after", "image");
    std::vector<std::string> known;
    for (const auto& [name, event] : simulated_world::kClockEventNames) {
      if (after == name) wait.after = event;
      known.emplace_back(name);
    }
    if (after != toString(wait.after)) {
      problems->push_back("clock/wait_for: after = '" + after + "', must be one of " + join(known));
    }
    if (!wait.subscriber.empty() && wait.after == ClockEvent::kActionResult) {
      problems->push_back("clock/wait_for: subscriber = '" + wait.subscriber +
                          "' after action_result, must be after image, odometry, joint_states or scan");
    }
    params->wait_for.push_back(wait);
  }
  for (Rule& rule : rulesOf(nh, "clock/computing", problems)) {
    if (!rule.requireKeys({"action", "cost_s"})) continue;
    const std::string action = rule.rosName("action");
    params->computing.push_back({action, rule.number("cost_s", 0.0)});
  }
  try {
    simulated_world::ClockGate(params->wait_for, params->computing);
  } catch (const std::invalid_argument& error) {
    problems->push_back(std::string("clock/") + error.what());
  }
}

}  // namespace

void SimulationParams::fields(SimulationParams& c, Fields& f) {
  simulated_world::SimulationConfig& simulation = c.simulation;
  const auto given = [&f](const char* key, std::string& value, const char* text) {
    f(key, value, text);
    f.require(!value.empty(), std::string(key) + " is empty, must be given");
  };
  const auto name = [&f](const char* key, std::string& value, const char* text) {
    f(key, value, text);
    const std::string problem = problemOfName(key, value);
    f.require(problem.empty(), problem);
  };
  given("scene", simulation.scene, "file of the pile; set by the launch file");
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
    name("pick_action", c.pick_action,
         "action PickBrick of the arm's bridge: the brick of its last goal is what the magnet may touch; empty: "
         "~target");
    name("surface_topic", c.surface_topic,
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
  readRules(private_nh, &params, &problems);
  reader.finish(problems);
  return params;
}

}  // namespace simulated_world_ros
