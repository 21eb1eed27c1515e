// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning_ros/motion_planning_params.h"

#include <interactive_mapping_common_ros/params.h>

namespace motion_planning_ros {
namespace {

/// False: one more problem. Where `planned` is impossible itself, up to `limit`, it alone is what is wrong.
bool isAtMost(double value, double planned, double limit) {
  return !(planned >= 0.0 && planned <= limit) || !(value > planned);
}

}  // namespace

void MotionPlanningParams::fields(MotionPlanningParams& c, interactive_mapping::Fields& f) {
  const auto requireAbsolute = [&f](const char* key, const std::string& path, const char* what) {
    f.require(!path.empty() && path.front() == '/',
              std::string(key) + " = '" + path + "', must be the absolute path of " + what);
  };
  f("map_frame", c.map_frame, "fixed frame, that of the map's mesh");
  f.require(!c.map_frame.empty(), "map_frame is empty, must be a frame of tf");
  f("bricks_file", c.bricks_file, "absolute path of a bricks.yaml; set by the launch file");
  requireAbsolute("bricks_file", c.bricks_file, "a bricks.yaml");
  f("sectors_file", c.sectors_file, "absolute path of a file made by fit_manipulability; set by the launch file");
  requireAbsolute("sectors_file", c.sectors_file, "a file made by fit_manipulability");
  f("postures_dir", c.postures_dir,
    "absolute path of a folder: each *.yaml in it is a posture of the arm, named after the file; set by the launch "
    "file");
  requireAbsolute("postures_dir", c.postures_dir, "a folder with postures of the arm");
  f("stow", c.stow, "where a picked brick goes unless the goal says otherwise: a frame of the robot, or a posture");
  f("inspect_posture", c.inspect_posture, "posture that is tried first when the arm is to leave the camera's view");
  f("place_above_m", c.place_above_m, 0.0, 1.0, "m",
    "height of a brick's lowest point over the frame where it is let go");
  f.section("state", c.state);
  f.section("scene", c.scene);
  motion_planning::MotionPlannerConfig::fields(c.planner, f);  // ends with the section "view"
  f.section("view", c.view);
  f.section("cost", c.cost);
  f.section("monitor", c.monitor);
  f.section("monitor", c.path_monitor);
  f.section("output", c.output);
  f.require(isAtMost(c.monitor.sigmas, c.scene.sigmas, motion_planning::kMaxSigmas),
            "monitor/sigmas must be at most scene/sigmas");
  f.require(isAtMost(c.monitor.margin_m, c.scene.margin_m, motion_planning::kMaxMargin_m),
            "monitor/margin_m must be at most scene/margin_m");
  f.require(isAtMost(c.monitor.self_padding_m, c.planner.collision.self_padding_m, motion_planning::kMaxSelfPadding_m),
            "monitor/self_padding_m must be at most collision/self_padding_m");
}

motion_planning::CollisionSceneConfig MotionPlanningParams::watchedScene() const {
  motion_planning::CollisionSceneConfig watched = scene;
  watched.sigmas = monitor.sigmas;
  watched.margin_m = monitor.margin_m;
  return watched;
}

motion_planning::CollisionCheckerConfig MotionPlanningParams::watchedRobot() const {
  motion_planning::CollisionCheckerConfig watched = planner.collision;
  watched.self_padding_m = monitor.self_padding_m;
  watched.held_padding_m = monitor.self_padding_m;
  // Localisation moves the arm in the map by a centimetre and, at its reach, 0.3 degrees by half of one. A plan keeps no
  // distance from unseen blocks: without this the arm would stop beside them, plan the same path again, and stop again.
  watched.unknown_tolerance_m = 0.015;
  return watched;
}

MotionPlanningParams loadMotionPlanningParams(const ros::NodeHandle& private_nh) {
  return interactive_mapping_ros::loadParams<MotionPlanningParams>(private_nh);
}

}  // namespace motion_planning_ros
