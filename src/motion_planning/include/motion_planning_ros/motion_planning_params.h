// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "motion_planning/collision_scene.h"
#include "motion_planning/motion_planner.h"
#include "motion_planning/path_monitor.h"

namespace motion_planning_ros {

/// All parameters of the node, with the only copy of the defaults. SI units.
struct MotionPlanningParams {
  std::string map_frame{"map"};
  std::string bricks_file;         // absolute path of a bricks.yaml
  std::string sectors_file;        // absolute path; fit_manipulability makes it
  std::string postures_dir;        // absolute path: each *.yaml in it is a posture of the arm, named after the file
  std::string stow{"chute_drop"};  // where a picked brick goes unless the goal says: a frame, or a posture
  std::string inspect_posture{"inspect"};  // tried first
  double place_above_m{0.03};              // lowest point of a brick over the frame where it is let go

  struct State {
    double max_joint_age_s{0.5};  // ROS time; older joint states are not where the arm is
    double max_tf_age_s{1.0};     // the same for the base in the map
    double map_wait_s{2.0};       // ROS time that a goal waits for a map as new as it asks for
    double max_shift_m{0.01};     // the scene is made anew when the base has moved farther, or turned
    double max_turn_rad{0.01};
  } state;

  struct View {  // of the camera, for inspect; its picture's edges
    std::string camera_frame{"camera_color_optical_frame"};
    double half_width_rad{0.547};   // 640 px at a focal length of 525 px
    double half_height_rad{0.429};  // 480 px
    double range_m{3.0};
  } view;

  struct Cost {  // of planning, in simulated time; real time costs what it costs
    double pick_s{0.5};
    double arm_s{0.3};
    double stall_s{5.0};  // wall time after which a clock that stands still does not hold a result back any more
  } cost;

  struct Monitor {
    double rate_hz{10.0};
    // Less than what is planned with: a map that breathes by a millimetre is no reason to stop.
    double sigmas{1.0};
    double margin_m{0.0};
    double self_padding_m{0.0};
  } monitor;

  struct Output {
    int arm_markers{6};  // arms drawn along a planned path
  } output;

  motion_planning::CollisionSceneConfig scene;
  motion_planning::MotionPlannerConfig planner;
  motion_planning::PathMonitorConfig path_monitor;

  /// Of what the path monitor looks at: as for planning, with the monitor's own margins.
  motion_planning::CollisionSceneConfig watchedScene() const;
  motion_planning::CollisionCheckerConfig watchedRobot() const;

  /// Every problem as "key = value unit, must be ...".
  std::vector<std::string> validate() const;
};

/// In the layout of config/motion_planning.yaml.
std::string toYaml(const MotionPlanningParams& params);

/// Reads `~` parameters. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value.
MotionPlanningParams loadMotionPlanningParams(const ros::NodeHandle& private_nh);

}  // namespace motion_planning_ros
