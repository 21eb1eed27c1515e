// SPDX-License-Identifier: BSD-3-Clause
#include "simulation_params.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <sstream>
#include <stdexcept>

#include <ros/names.h>
#include <yaml-cpp/yaml.h>

#include <interactive_mapping_common_ros/param_reader.h>

namespace simulated_world_ros {
namespace {

using interactive_mapping_ros::ParamReader;
using simulated_world::ClockEvent;

const std::map<std::string, ClockMode> kClockModes{
    {"lockstep", ClockMode::kLockstep}, {"stepped", ClockMode::kStepped}, {"realtime", ClockMode::kRealtime}};
const std::map<std::string, ClockEvent> kEvents{{"image", ClockEvent::kImage},
                                                {"odometry", ClockEvent::kOdometry},
                                                {"joint_states", ClockEvent::kJointStates},
                                                {"scan", ClockEvent::kScan},
                                                {"action_result", ClockEvent::kActionResult}};

template <typename Value>
std::string namesOf(const std::map<std::string, Value>& known) {
  std::string names;
  for (const auto& [name, value] : known) {
    names += (names.empty() ? "" : ", ") + name;
  }
  return names;
}

// One rule of a list: a map of known keys with scalar values.
class Rule {
 public:
  Rule(const YAML::Node& node, const std::string& where, std::vector<std::string>* problems)
      : node_(node), where_(where), problems_(problems) {}

  bool requireKeys(const std::vector<std::string>& known) {
    if (!node_.IsMap()) {
      problems_->push_back(where_ + " must be a map of " + join(known));
      return false;
    }
    for (const auto& entry : node_) {
      const auto key = entry.first.as<std::string>();
      if (std::find(known.begin(), known.end(), key) == known.end()) {
        problems_->push_back(where_ + "/" + key + " is unknown; known: " + join(known));
      }
    }
    return true;
  }

  std::string text(const std::string& key, const std::string& fallback) {
    return node_[key].IsDefined() && node_[key].IsScalar() ? node_[key].as<std::string>() : fallback;
  }

  double number(const std::string& key, double fallback) {
    if (!node_[key].IsDefined()) {
      return fallback;
    }
    try {
      return node_[key].as<double>();
    } catch (const YAML::Exception&) {
      problems_->push_back(where_ + "/" + key + " must be a number");
      return fallback;
    }
  }

 private:
  static std::string join(const std::vector<std::string>& names) {
    std::string all;
    for (const std::string& name : names) {
      all += (all.empty() ? "" : ", ") + name;
    }
    return all;
  }

  YAML::Node node_;
  std::string where_;
  std::vector<std::string>* problems_;
};

void readRules(const std::string& wait_for, const std::string& computing, SimulationParams* params,
               std::vector<std::string>* problems) {
  const YAML::Node waits = YAML::Load(wait_for);
  if (waits.IsDefined() && !waits.IsNull() && !waits.IsSequence()) {
    problems->push_back("wait_for must be a list");
  } else {
    for (std::size_t i = 0; i < waits.size(); ++i) {
      const std::string where = "wait_for[" + std::to_string(i) + "]";
      Rule rule(waits[i], where, problems);
      if (!rule.requireKeys({"topic", "after", "cost_s", "while_action", "subscriber"})) {
        continue;
      }
      simulated_world::WaitRule wait;
      wait.topic = rule.text("topic", "");
      wait.cost_s = rule.number("cost_s", 0.0);
      wait.while_action = rule.text("while_action", "");
      wait.subscriber = rule.text("subscriber", "");
      const auto event = kEvents.find(rule.text("after", "image"));
      if (event == kEvents.end()) {
        problems->push_back(where + "/after = '" + rule.text("after", "") + "', must be one of " + namesOf(kEvents));
      } else {
        wait.after = event->second;
      }
      params->wait_for.push_back(wait);
    }
  }
  const YAML::Node actions = YAML::Load(computing);
  if (actions.IsDefined() && !actions.IsNull() && !actions.IsSequence()) {
    problems->push_back("computing must be a list");
    return;
  }
  for (std::size_t i = 0; i < actions.size(); ++i) {
    Rule rule(actions[i], "computing[" + std::to_string(i) + "]", problems);
    if (rule.requireKeys({"action", "cost_s"})) {
      params->computing.push_back({rule.text("action", ""), rule.number("cost_s", 0.0)});
    }
  }
  try {
    simulated_world::ClockGate(params->wait_for, params->computing);
  } catch (const std::invalid_argument& error) {
    problems->emplace_back(error.what());
  }
}

// The core's structs have other sections than the parameters: the first rule that fits renames a problem's key.
std::vector<std::string> asParameters(std::vector<std::string> problems) {
  static const std::vector<std::pair<std::string, std::string>> kRules{
      {"servo/arm_", "arm/"},
      {"servo/base_", "base/"},
      {"servo/", "base/"},
      {"sleep/rest_speed_m_per_s", "physics/sleep/rest_speed_m_s"},
      {"sleep/rest_rate_rad_per_s", "physics/sleep/rest_rate_rad_s"},
      {"sleep/", "physics/sleep/"},
      {"timestep_s", "physics/timestep_s"},
      {"tick_s", "clock/tick_s"},
      {"start_time_s", "clock/start_time_s"},
      {"joint_state_rate_hz", "arm/joint_state_rate_hz"},
      {"collision_stop", "arm/collision_stop"},
      {"magnet_output", "magnet/digital_output"},
      {"chute_", "chute/"},
      {"camera_", "camera/"},
      {"odometry_", "base/odometry_"},
      {"localisation_", "base/localisation_"},
      {"scan_noise", "base/scan_noise"}};
  for (std::string& problem : problems) {
    for (const auto& [from, to] : kRules) {
      if (problem.compare(0, from.size(), from) == 0) {
        problem.replace(0, from.size(), to);
        break;
      }
    }
  }
  return problems;
}

}  // namespace

std::vector<std::string> SimulationParams::validate() const {
  std::vector<std::string> problems = asParameters(simulation.validate());
  const auto requireName = [&problems](const char* key, const std::string& name) {
    std::string reason;
    if (!name.empty() && !ros::names::validate(name, reason)) {
      problems.push_back(std::string(key) + " = '" + name + "', must be a name: " + reason);
    }
  };
  requireName("judge/surface_topic", surface_topic);
  requireName("judge/pick_action", pick_action);
  for (const simulated_world::WaitRule& rule : wait_for) {
    requireName("clock/wait_for: topic", rule.topic);
    requireName("clock/wait_for: while_action", rule.while_action);
    requireName("clock/wait_for: subscriber", rule.subscriber);
    if (!rule.subscriber.empty() && rule.after == ClockEvent::kActionResult) {
      problems.push_back("clock/wait_for: subscriber = '" + rule.subscriber +
                         "' after action_result, must be after image, odometry, joint_states or scan");
    }
  }
  for (const simulated_world::ComputingRule& rule : computing) {
    requireName("clock/computing: action", rule.action);
  }
  const auto require = [&problems](const char* key, double value, double low, double high, const char* unit) {
    if (!(value >= low && value <= high)) {
      std::ostringstream line;
      line << key << " = " << value << ' ' << unit << ", must be in [" << low << ", " << high << "] " << unit;
      problems.push_back(line.str());
    }
  };
  require("camera/focal_length_px", simulation.camera.camera.fx_px, 10.0, 1e5, "px");
  require("camera/width_px", simulation.camera.camera.width_px, 16.0, 8192.0, "px");
  require("camera/height_px", simulation.camera.camera.height_px, 16.0, 8192.0, "px");
  require("clock/realtime_factor", realtime_factor, 0.01, 100.0, "");
  require("clock/wait_timeout_wall_s", wait_timeout_wall_s, 0.1, 3600.0, "s");
  if (has_pictures && run_folder.empty()) {
    problems.push_back("judge/pictures = true without judge/run_folder, must be false, or the folder given");
  }
  if (depth_encoding != "16UC1" && depth_encoding != "32FC1") {
    problems.push_back("camera/depth_encoding = '" + depth_encoding + "', must be 16UC1 (mm) or 32FC1 (m)");
  }
  for (const auto& [key, value] :
       {std::pair("description/urdf", simulation.description.urdf),
        std::pair("description/base_profile", simulation.description.base_profile),
        std::pair("description/bricks", simulation.description.bricks),
        std::pair("description/arm_pose", simulation.description.arm_pose), std::pair("scene", simulation.scene),
        std::pair("frames/map", map_frame), std::pair("frames/odom", odom_frame)}) {
    if (value.empty()) {
      problems.push_back(std::string(key) + " is empty, must be given");
    }
  }
  return problems;
}

SimulationParams loadSimulationParams(const ros::NodeHandle& private_nh) {
  SimulationParams params;
  simulated_world::SimulationConfig& sim = params.simulation;
  ParamReader reader(private_nh);
  reader.read("description/urdf", &sim.description.urdf);
  reader.read("description/base_profile", &sim.description.base_profile);
  reader.read("description/bricks", &sim.description.bricks);
  reader.read("description/arm_pose", &sim.description.arm_pose);
  reader.read("scene", &sim.scene);
  int seed = 1;
  reader.read("seed", &seed);
  if (seed < 0) {
    reader.report("", {"seed = " + std::to_string(seed) + ", must be >= 0"});
  }
  sim.seed = static_cast<std::uint64_t>(std::max(seed, 0));

  std::string clock = "lockstep";
  reader.read("clock/mode", &clock);
  const auto mode = kClockModes.find(clock);
  if (mode == kClockModes.end()) {
    reader.report("clock", {"mode = '" + clock + "', must be one of " + namesOf(kClockModes)});
  } else {
    params.clock = mode->second;
  }
  reader.read("clock/realtime_factor", &params.realtime_factor);
  reader.read("clock/tick_s", &sim.tick_s);
  reader.read("clock/start_time_s", &sim.start_time_s);
  reader.read("clock/wait_timeout_wall_s", &params.wait_timeout_wall_s);
  std::vector<std::string> rule_problems;
  readRules(reader.yamlOf("clock/wait_for"), reader.yamlOf("clock/computing"), &params, &rule_problems);
  reader.report("clock", rule_problems);

  reader.read("physics/timestep_s", &sim.world.physics.timestep_s);
  reader.read("physics/sleep/enabled", &sim.world.has_sleep);
  reader.read("physics/sleep/rest_speed_m_s", &sim.world.sleep.rest_speed_m_per_s);
  reader.read("physics/sleep/rest_rate_rad_s", &sim.world.sleep.rest_rate_rad_per_s);
  reader.read("physics/sleep/rest_time_s", &sim.world.sleep.rest_time_s);

  reader.read("arm/headless_mode", &sim.arm_driver.headless_mode);
  reader.read("arm/starts_running", &sim.arm_starts_running);
  reader.read("arm/joint_state_rate_hz", &sim.joint_state_rate_hz);
  reader.read("arm/bandwidth_rad_s", &sim.world.servo.arm_bandwidth_rad_s);
  reader.read("arm/collision_stop_N", &sim.collision_stop_N);
  reader.read("arm/collision_stop_effort", &sim.collision_stop_effort);

  reader.read("magnet/digital_output", &sim.magnet_output);
  reader.read("magnet/holding_force_N", &sim.world.magnet.holding_force_N);
  reader.read("magnet/friction", &sim.world.magnet.friction);
  reader.read("magnet/radius_m", &sim.world.magnet.radius_m);
  reader.read("magnet/max_tilt_rad", &sim.world.magnet.max_tilt_rad);
  reader.read("chute/capacity", &sim.chute_capacity);
  reader.read("chute/rest_s", &sim.chute_rest_s);

  reader.read("base/odometry_rate_hz", &sim.odometry_rate_hz);
  reader.read("base/bandwidth_rad_s", &sim.world.servo.base_bandwidth_rad_s);
  reader.read("base/traction_N", &sim.world.servo.traction_N);
  reader.read("base/traction_Nm", &sim.world.servo.traction_Nm);
  reader.read("base/odometry_scale_std", &sim.odometry_scale_std);
  reader.read("base/odometry_walk_m_per_sqrt_m", &sim.odometry_walk_m_per_sqrt_m);
  reader.read("base/odometry_walk_rad_per_sqrt_m", &sim.odometry_walk_rad_per_sqrt_m);
  reader.read("base/localisation_std_m", &sim.localisation_std_m);
  reader.read("base/localisation_std_rad", &sim.localisation_std_rad);
  reader.read("base/scan_noise_std_m", &sim.scan_noise_std_m);

  synthetic_depth::CameraModel& camera = sim.camera.camera;
  reader.read("camera/rate_hz", &sim.camera_rate_hz);
  reader.read("camera/delay_s", &sim.camera_delay_s);
  reader.read("camera/drop_probability", &sim.camera_drop_probability);
  reader.read("camera/depth_encoding", &params.depth_encoding);
  reader.read("camera/width_px", &camera.width_px);
  reader.read("camera/height_px", &camera.height_px);
  reader.read("camera/focal_length_px", &camera.fx_px);
  camera.fy_px = camera.fx_px;
  camera.cx_px = 0.5 * (camera.width_px - 1);
  camera.cy_px = 0.5 * (camera.height_px - 1);
  reader.read("camera/rgb_noise_std_grey", &sim.camera.rgb_noise_std_grey);
  synthetic_depth::SensorModel& sensor = sim.camera.sensor;
  reader.read("camera/sensor/min_range_m", &sensor.min_range_m);
  reader.read("camera/sensor/max_range_m", &sensor.max_range_m);
  reader.read("camera/sensor/noise_a_m", &sensor.axial_noise_a_m);
  reader.read("camera/sensor/noise_b", &sensor.axial_noise_b);
  reader.read("camera/sensor/noise_c_per_m", &sensor.axial_noise_c_per_m);
  reader.read("camera/sensor/baseline_m", &sensor.baseline_m);
  reader.read("camera/sensor/has_shadows", &sensor.has_shadows);
  reader.read("camera/sensor/disparity_step_px", &sensor.disparity_step_px);
  reader.read("camera/sensor/edge_mixing_fraction", &sensor.edge_mixing_fraction);
  reader.read("camera/sensor/dropout_probability", &sensor.dropout_probability);
  reader.read("camera/sensor/lateral_jitter_px", &sensor.lateral_jitter_px);
  reader.read("camera/sensor/border_left_px", &sensor.border_left_px);
  reader.read("camera/sensor/border_right_px", &sensor.border_right_px);
  reader.read("camera/sensor/border_top_px", &sensor.border_top_px);
  reader.read("camera/sensor/border_bottom_px", &sensor.border_bottom_px);
  reader.read("camera/sensor/has_hexagonal_view", &sensor.has_hexagonal_view);
  reader.read("camera/sensor/min_return_per_m2", &sensor.min_return_per_m2);
  reader.read("camera/sensor/return_flicker", &sensor.return_flicker);
  reader.read("camera/sensor/edge_loss_px", &sensor.edge_loss_px);

  reader.read("judge/surface_topic", &params.surface_topic);
  reader.read("judge/pick_action", &params.pick_action);
  reader.read("judge/run_folder", &params.run_folder);
  reader.read("judge/pictures", &params.has_pictures);
  reader.read("frames/map", &params.map_frame);
  reader.read("frames/odom", &params.odom_frame);
  reader.ignore("image_transport");  // read by image_transport
  reader.report("", params.validate());
  reader.finish();
  return params;
}

}  // namespace simulated_world_ros
