// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "pick_mission/mission_config.h"
#include "pick_mission/mission_log.h"

namespace pick_mission_ros {

/// All parameters of the node, with the only copy of the defaults but for the mission's own. SI units.
struct PickMissionParams {
  pick_mission::MissionConfig mission;
  pick_mission::MissionInfo info;

  std::string map_frame{"map"};
  std::string base_frame{"base_link"};
  std::string sectors_file;        // absolute path of what fit_manipulability made
  std::string bricks_file;         // absolute path of bricks.yaml: their sizes, for the markers
  std::string run_folder;          // absolute path; empty: nothing is written, and nothing survives
  bool autostart{false};           // without anybody pressing start; after a crash, too
  std::string stow{"chute_drop"};  // frame of the robot over which a brick is let go that was not let go by its pick
  double heartbeat_rate_hz{20.0};  // ROS time
  double max_stall_s{2.0};         // wall time that the mission may hang before its heart stops
  double max_bridge_age_s{1.0};    // of the arm bridge's state, ROS time; older: what the magnet holds is not known
  double max_tf_age_s{1.0};        // of where the robot is, ROS time
  double server_timeout_s{5.0};    // wall time that a server may be away before there is no answer
  double service_timeout_s{5.0};   // wall time for the answer of a service that does not wait for images
  double detect_stall_s{60.0};     // wall time for the answer of the detection, whose own limit is in ROS time

  /// Whose actions, services and topics are used: names as ROS resolves them.
  struct Nodes {
    std::string map{"/gpis_mapping"};
    std::string planner{"/motion_planning"};
    std::string bridge{"/ur_driver_bridge"};
    std::string detection{"/brick_detection"};
    std::string selection{"/nbv_selection"};
    std::string navigation{"/base_navigation"};  // its outcome; another navigation than ours has none
    std::string move_base{"/move_base"};         // action
  } nodes;

  /// Every problem as "key = value unit, must be ...".
  std::vector<std::string> validate() const;
};

/// In the layout of config/pick_mission.yaml.
std::string toYaml(const PickMissionParams& params);

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value.
PickMissionParams loadPickMissionParams(const ros::NodeHandle& private_nh);

}  // namespace pick_mission_ros
