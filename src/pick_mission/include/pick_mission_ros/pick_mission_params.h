// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <ros/node_handle.h>

#include "pick_mission/mission_config.h"
#include "pick_mission/mission_log.h"

namespace pick_mission_ros {

/// All parameters of the node. SI units.
struct PickMissionParams {
  std::string map_frame{"map"};
  std::string base_frame{"base_link"};
  std::string sectors_file;
  std::string bricks_file;
  std::string run_folder;
  bool autostart{false};
  pick_mission::MissionInfo info;
  pick_mission::MissionConfig mission;

  struct Heartbeat {
    double rate_hz{20.0};
    double max_stall_s{2.0};

    static void fields(Heartbeat& c, interactive_mapping::Fields& f) {
      f("rate_hz", c.rate_hz, 1.0, 100.0, "Hz", "rate of ~heartbeat, in ROS time");
      f("max_stall_s", c.max_stall_s, 0.5, 60.0, "s", "wall time that the mission may hang before the heartbeat stops");
    }
  } heartbeat;

  struct Input {
    double max_bridge_age_s{1.0};
    double max_tf_age_s{1.0};

    static void fields(Input& c, interactive_mapping::Fields& f) {
      f("max_bridge_age_s", c.max_bridge_age_s, 0.05, 60.0, "s",
        "greatest age of the arm bridge's state; with an older one it is unknown what the magnet holds");
      f("max_tf_age_s", c.max_tf_age_s, 0.05, 60.0, "s", "greatest age of the robot's pose");
    }
  } input;

  struct Servers {
    double timeout_s{5.0};
    double service_timeout_s{5.0};
    double detect_stall_s{60.0};

    static void fields(Servers& c, interactive_mapping::Fields& f) {
      f("timeout_s", c.timeout_s, 0.5, 600.0, "s",
        "wall time that an action server may be unavailable, or not acknowledge a goal, before it counts as "
        "unanswered");
      f("service_timeout_s", c.service_timeout_s, 0.5, 600.0, "s",
        "wall time for the answer of a service that does not wait for images");
      f("detect_stall_s", c.detect_stall_s, 1.0, 3600.0, "s",
        "wall time for the answer of the detection, whose own limit is in ROS time");
    }
  } servers;

  /// Names as ROS resolves them.
  struct Nodes {
    std::string map{"/gpis_mapping"};
    std::string planner{"/motion_planning"};
    std::string bridge{"/ur_driver_bridge"};
    std::string detection{"/brick_detection"};
    std::string selection{"/nbv_selection"};
    std::string navigation{"/base_navigation"};
    std::string move_base{"/move_base"};
    std::string unload;

    static void fields(Nodes& c, interactive_mapping::Fields& f);
  } nodes;

  static void fields(PickMissionParams& c, interactive_mapping::Fields& f);
};

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value.
PickMissionParams loadPickMissionParams(const ros::NodeHandle& private_nh);

}  // namespace pick_mission_ros
