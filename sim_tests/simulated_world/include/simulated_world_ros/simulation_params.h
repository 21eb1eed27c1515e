// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "simulated_world/clock_gate.h"
#include "simulated_world/fault.h"
#include "simulated_world/simulation.h"

namespace simulated_world_ros {

enum class ClockMode {
  kLockstep,  ///< as fast as the machine allows, waiting for what is due
  kStepped,   ///< stands still but for the service ~advance
  kRealtime,  ///< at realtime_factor of the wall clock
};

/// Parameters of the node simulated_world; config/simulation.yaml lists them all.
struct SimulationParams {
  simulated_world::SimulationConfig simulation;

  ClockMode clock{ClockMode::kLockstep};
  double realtime_factor{1.0};
  double wait_timeout_wall_s{60.0};
  std::vector<simulated_world::WaitRule> wait_for;
  std::vector<simulated_world::ComputingRule> computing;

  std::string depth_encoding{"16UC1"};
  std::string pick_action;
  std::string surface_topic;
  std::string run_folder;
  bool has_pictures{false};
  std::string map_frame{"map"};
  std::string odom_frame{"odom"};

  /// All but the lists clock/wait_for and clock/computing.
  static void fields(SimulationParams& c, interactive_mapping::Fields& f);
};

/// Reads the private parameters. Throws one std::invalid_argument that names every problem.
SimulationParams loadSimulationParams(const ros::NodeHandle& private_nh);

}  // namespace simulated_world_ros
