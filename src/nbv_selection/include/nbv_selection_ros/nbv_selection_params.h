// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <interactive_mapping_common/config/schema.h>
#include <ros/node_handle.h>

namespace nbv_selection_ros {

/// All parameters of the node but those of its strategies. SI units.
struct NbvSelectionParams {
  std::string map_frame{"map"};
  std::string base_frame{"base_link"};
  std::string base_profile_file;
  std::string sectors_file;
  std::vector<std::string> strategies{"gpis"};
  int seed{0};
  int max_attempts{3};

  struct Input {
    double max_grid_age_s{5.0};
    int occupied_from{65};
    double max_pose_age_s{1.0};
    double map_wait_s{3.0};
    double answer_timeout_s{5.0};

    static void fields(Input& c, interactive_mapping::Fields& f) {
      f("max_grid_age_s", c.max_grid_age_s, c.max_grid_age_s == 0.0 ? 0.0 : 0.1, 3600.0, "s",
        "oldest grid that the base drives on, ROS time; or 0: a static grid, which comes once");
      f("occupied_from", c.occupied_from, 1, 100, "", "lowest occupied value of the grid's cells");
      f("max_pose_age_s", c.max_pose_age_s, 0.05, 60.0, "s", "oldest pose of the robot in tf, ROS time");
      f("map_wait_s", c.map_wait_s, 0.0, 60.0, "s", "how long a goal waits for a map as new as it wants, ROS time");
      f("answer_timeout_s", c.answer_timeout_s, 0.1, 600.0, "s", "how long a service of the map may take, wall time");
    }
  } input;

  struct Failures {
    double cell_m{0.1};
    double radius_m{0.3};

    static void fields(Failures& c, interactive_mapping::Fields& f) {
      f("cell_m", c.cell_m, 0.01, 1.0, "m", "cell of the quad-tree on the ground");
      f("radius_m", c.radius_m, 0.0, 10.0, "m", "radius about a reported pose, unless the report gives another");
    }
  } failures;

  struct Cost {
    double select_s{0.3};
    double stall_s{5.0};

    static void fields(Cost& c, interactive_mapping::Fields& f) {
      f("select_s", c.select_s, 0.0, 60.0, "s",
        "simulated time that a selection costs; the rule of the clock must allow as much");
      f("stall_s", c.stall_s, 0.1, 600.0, "s", "how long a simulated clock may stop during a selection, wall time");
    }
  } cost;

  static void fields(NbvSelectionParams& c, interactive_mapping::Fields& f) {
    f("map_frame", c.map_frame, "fixed frame, that of the maps and of the grid");
    f("base_frame", c.base_frame, "frame of the base");
    f("base_profile_file", c.base_profile_file,
      "absolute path of a base_profile.yaml with the footprint; the launch file gives it");
    f("sectors_file", c.sectors_file,
      "absolute path of a file of fit_manipulability; the launch file gives it. Empty: manipulability must weigh 0, "
      "and no robot_description is read");
    f("strategies", c.strategies, "each has a section with its plugin; the first is the default of goals");
    f("seed", c.seed, std::numeric_limits<int>::min(), std::numeric_limits<int>::max(), "",
      "of strategies that draw random numbers");
    f("max_attempts", c.max_attempts, 1, 20, "", "selections for one goal while the map keeps changing");
    f.section("input", c.input);
    f.section("failures", c.failures);
    f.section("cost", c.cost);
    for (const auto& [key, frame] : {std::pair("map_frame", &c.map_frame), std::pair("base_frame", &c.base_frame)}) {
      f.require(!frame->empty() && frame->front() != '/',
                std::string(key) + " = '" + *frame + "', must be a tf2 frame: no leading slash");
    }
    f.require(c.base_frame != c.map_frame, "base_frame = '" + c.base_frame + "', must be another frame than map_frame");
    f.require(!c.base_profile_file.empty() && c.base_profile_file.front() == '/',
              "base_profile_file = '" + c.base_profile_file + "', must be the absolute path of a file");
    f.require(c.sectors_file.empty() || c.sectors_file.front() == '/',
              "sectors_file = '" + c.sectors_file + "', must be the absolute path of a file");
    f.require(!c.strategies.empty(), "strategies = [], must be at least one");
    std::set<std::string> names;
    for (const std::string& name : c.strategies) {
      f.require(isName(name), "strategies holds '" + name + "', must be letters, digits and underscores");
      f.require(names.insert(name).second, "strategies holds '" + name + "' twice, must be once");
    }
  }

 private:
  /// Can be the name of a parameter.
  static bool isName(const std::string& text) {
    if (text.empty() || (text[0] >= '0' && text[0] <= '9')) return false;
    return text.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_") ==
           std::string::npos;
  }
};

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value.
NbvSelectionParams loadNbvSelectionParams(const ros::NodeHandle& private_nh);

}  // namespace nbv_selection_ros
