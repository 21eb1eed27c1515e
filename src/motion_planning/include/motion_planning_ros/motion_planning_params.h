// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <ros/node_handle.h>

#include "motion_planning/collision_scene.h"
#include "motion_planning/motion_planner.h"
#include "motion_planning/path_monitor.h"

namespace motion_planning_ros {

/// All parameters of the node. SI units.
struct MotionPlanningParams {
  std::string map_frame{"map"};
  std::string bricks_file;
  std::string sectors_file;
  std::string postures_dir;
  std::string stow{"container_place_1"};
  std::string inspect_posture{"inspect"};
  double place_above_m{0.03};

  struct State {
    double max_joint_age_s{0.5};
    double max_tf_age_s{1.0};
    double map_wait_s{2.0};
    double max_shift_m{0.01};
    double max_turn_rad{0.01};

    static void fields(State& c, interactive_mapping::Fields& f) {
      f("max_joint_age_s", c.max_joint_age_s, 0.01, 60.0, "s", "greatest age of joint states, in ROS time");
      f("max_tf_age_s", c.max_tf_age_s, 0.01, 600.0, "s", "greatest age of the base's pose in the map, in ROS time");
      f("map_wait_s", c.map_wait_s, 0.0, 600.0, "s",
        "ROS time that a goal waits for a map as new as its min_map_stamp");
      f("max_shift_m", c.max_shift_m, 0.001, 0.1, "m", "the scene is built again when the base has moved farther");
      f("max_turn_rad", c.max_turn_rad, 0.001, 0.1, "rad", "the scene is built again when the base has turned farther");
    }
  } state;

  struct View {
    std::string camera_frame{"camera_color_optical_frame"};
    double half_width_rad{0.547};
    double half_height_rad{0.429};
    double range_m{3.0};

    static void fields(View& c, interactive_mapping::Fields& f) {
      f("camera_frame", c.camera_frame, "optical frame of the camera whose view the arm leaves to inspect");
      f("half_width_rad", c.half_width_rad, 0.05, 1.5, "rad",
        "half of the angle of view, horizontally: 640 px at a focal length of 525 px");
      f("half_height_rad", c.half_height_rad, 0.05, 1.5, "rad", "half of the angle of view, vertically: 480 px");
      f("range_m", c.range_m, 0.1, 100.0, "m", "length of the view");
    }
  } view;

  struct Cost {
    double pick_s{0.5};
    double arm_s{0.3};
    double stall_s{5.0};

    static void fields(Cost& c, interactive_mapping::Fields& f) {
      f("pick_s", c.pick_s, 0.0, 60.0, "s",
        "simulated time that planning a pick takes; in real time it takes what it takes");
      f("arm_s", c.arm_s, 0.0, 60.0, "s", "simulated time that planning another motion takes");
      f("stall_s", c.stall_s, 0.1, 600.0, "s", "wall time after which a result no longer waits for a stopped clock");
    }
  } cost;

  /// Less than what is planned with: a map that breathes by a millimetre is no reason to stop.
  struct Monitor {
    double rate_hz{10.0};
    double sigmas{1.0};
    double margin_m{0.0};
    double self_padding_m{0.0};

    static void fields(Monitor& c, interactive_mapping::Fields& f) {
      f("rate_hz", c.rate_hz, 0.5, 100.0, "Hz", "rate of the checks of a running trajectory");
      f("sigmas", c.sigmas, 0.0, motion_planning::kMaxSigmas, "", "as scene/sigmas, and at most that");
      f("margin_m", c.margin_m, 0.0, motion_planning::kMaxMargin_m, "m", "as scene/margin_m, and at most that");
      f("self_padding_m", c.self_padding_m, 0.0, motion_planning::kMaxSelfPadding_m, "m",
        "as collision/self_padding_m, and at most that");
    }
  } monitor;

  struct Output {
    int arm_markers{6};

    static void fields(Output& c, interactive_mapping::Fields& f) {
      f("arm_markers", c.arm_markers, 0, 100, "", "arms drawn along a planned path");
    }
  } output;

  motion_planning::CollisionSceneConfig scene;
  motion_planning::MotionPlannerConfig planner;
  motion_planning::PathMonitorConfig path_monitor;

  static void fields(MotionPlanningParams& c, interactive_mapping::Fields& f);

  /// Of what the path monitor looks at: as for planning, with the monitor's own margins.
  motion_planning::CollisionSceneConfig watchedScene() const;
  motion_planning::CollisionCheckerConfig watchedRobot() const;
};

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value.
MotionPlanningParams loadMotionPlanningParams(const ros::NodeHandle& private_nh);

}  // namespace motion_planning_ros
