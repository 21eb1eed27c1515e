// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <ros/node_handle.h>

namespace nbv_selection_ros {

/// All parameters of the node but those of its strategies, with the only copy of the defaults. SI units.
struct NbvSelectionParams {
  std::string map_frame{"map"};
  std::string base_frame{"base_link"};
  std::string base_profile_file;  // absolute path of a base_profile.yaml: the footprint
  std::string sectors_file;       // absolute path of what fit_manipulability made; empty: manipulability weighs nothing
  std::vector<std::string> strategies{
      "gpis"};  // each has a section of its own with its plugin; the first is the default
  int seed{0};  // of strategies that draw

  struct Input {
    double max_grid_age_s{5.0};    // of the grid that the base drives on, ROS time; 0: a static grid
    int occupied_from{65};         // of the grid's values, 0 .. 100: less is free
    double max_pose_age_s{1.0};    // of where tf says that the robot is, ROS time
    double map_wait_s{3.0};        // for a map as new as the goal wants, ROS time
    double answer_timeout_s{5.0};  // of a service of the map, wall time
  } input;

  struct Failures {
    double cell_m{0.1};
    double radius_m{0.3};  // round a reported pose
  } failures;

  struct Cost {
    double select_s{0.3};  // simulated time that a selection is charged
    double stall_s{5.0};   // wall time that a simulated clock may stand still meanwhile
  } cost;

  int max_attempts{3};  // at one goal, while the map changes under it

  /// Every problem as "key = value unit, must be ...".
  std::vector<std::string> validate() const;
};

/// In the layout of config/nbv_selection.yaml.
std::string toYaml(const NbvSelectionParams& params);

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value.
NbvSelectionParams loadNbvSelectionParams(const ros::NodeHandle& private_nh);

}  // namespace nbv_selection_ros
