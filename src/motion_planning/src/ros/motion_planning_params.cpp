// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning_ros/motion_planning_params.h"

#include <algorithm>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common_ros/param_reader.h>
#include <interactive_mapping_common_ros/param_writer.h>

#include "motion_planning/config_fields.h"

namespace motion_planning_ros {
namespace {

/// visit(key, value) for each key.
template <typename Params, typename Visitor>
void visitParams(Params& params, Visitor&& visit) {
  visit("map_frame", params.map_frame);
  visit("bricks_file", params.bricks_file);
  visit("sectors_file", params.sectors_file);
  visit("postures_dir", params.postures_dir);
  visit("stow", params.stow);
  visit("inspect_posture", params.inspect_posture);
  visit("place_above_m", params.place_above_m);
  visit("state/max_joint_age_s", params.state.max_joint_age_s);
  visit("state/max_tf_age_s", params.state.max_tf_age_s);
  visit("state/map_wait_s", params.state.map_wait_s);
  visit("state/max_shift_m", params.state.max_shift_m);
  visit("state/max_turn_rad", params.state.max_turn_rad);
  visit("view/camera_frame", params.view.camera_frame);
  visit("view/half_width_rad", params.view.half_width_rad);
  visit("view/half_height_rad", params.view.half_height_rad);
  visit("view/range_m", params.view.range_m);
  visit("cost/pick_s", params.cost.pick_s);
  visit("cost/arm_s", params.cost.arm_s);
  visit("cost/stall_s", params.cost.stall_s);
  visit("monitor/rate_hz", params.monitor.rate_hz);
  visit("monitor/sigmas", params.monitor.sigmas);
  visit("monitor/margin_m", params.monitor.margin_m);
  visit("monitor/self_padding_m", params.monitor.self_padding_m);
  visit("output/arm_markers", params.output.arm_markers);
  motion_planning::visitSceneFields(params.scene, "scene/", visit);
  motion_planning::visitPlannerFields(params.planner, visit);
  motion_planning::visitMonitorFields(params.path_monitor, "monitor/", visit);
}

void append(const std::string& prefix, const std::vector<std::string>& more, std::vector<std::string>* problems) {
  for (const std::string& problem : more) problems->push_back(prefix + problem);
}

}  // namespace

std::vector<std::string> MotionPlanningParams::validate() const {
  std::vector<std::string> problems;
  const auto absolute = [&problems](const char* key, const std::string& path, const char* what) {
    if (path.empty() || path.front() != '/') {
      problems.push_back(std::string(key) + " = '" + path + "', must be the absolute path of " + what);
    }
  };
  if (map_frame.empty()) problems.emplace_back("map_frame is empty, must be a frame of tf");
  absolute("bricks_file", bricks_file, "a bricks.yaml");
  absolute("sectors_file", sectors_file, "a file made by fit_manipulability");
  absolute("postures_dir", postures_dir, "a folder with postures of the arm");
  interactive_mapping::RangeCheck check;
  check("place_above_m", place_above_m, 0.0, 1.0, "m");
  check("state/max_joint_age_s", state.max_joint_age_s, 0.01, 60.0, "s");
  check("state/max_tf_age_s", state.max_tf_age_s, 0.01, 600.0, "s");
  check("state/map_wait_s", state.map_wait_s, 0.0, 600.0, "s");
  check("state/max_shift_m", state.max_shift_m, 0.001, 0.1, "m");
  check("state/max_turn_rad", state.max_turn_rad, 0.001, 0.1, "rad");
  check("view/half_width_rad", view.half_width_rad, 0.05, 1.5, "rad");
  check("view/half_height_rad", view.half_height_rad, 0.05, 1.5, "rad");
  check("view/range_m", view.range_m, 0.1, 100.0, "m");
  check("cost/pick_s", cost.pick_s, 0.0, 60.0, "s");
  check("cost/arm_s", cost.arm_s, 0.0, 60.0, "s");
  check("cost/stall_s", cost.stall_s, 0.1, 600.0, "s");
  check("monitor/rate_hz", monitor.rate_hz, 0.5, 100.0, "Hz");
  // At most what is planned with; where that is impossible itself, it alone is what is wrong.
  const auto atMost = [](double planned, double limit) { return planned >= 0.0 && planned <= limit ? planned : limit; };
  check("monitor/sigmas", monitor.sigmas, 0.0, atMost(scene.sigmas, motion_planning::kMaxSigmas), "");
  check("monitor/margin_m", monitor.margin_m, 0.0, atMost(scene.margin_m, motion_planning::kMaxMargin_m), "m");
  check("monitor/self_padding_m", monitor.self_padding_m, 0.0,
        atMost(planner.collision.self_padding_m, motion_planning::kMaxSelfPadding_m), "m");
  check("output/arm_markers", output.arm_markers, 0.0, 100.0, "");
  append("", check.problems(), &problems);
  append("scene/", scene.validate(), &problems);
  append("", planner.validate(), &problems);
  append("monitor/", path_monitor.validate(), &problems);
  return problems;
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
  return watched;
}

std::string toYaml(const MotionPlanningParams& params) {
  interactive_mapping_ros::ParamWriter writer;
  visitParams(params, [&writer](const std::string& key, const auto& value) { writer.write(key, value); });
  return writer.text();
}

MotionPlanningParams loadMotionPlanningParams(const ros::NodeHandle& private_nh) {
  MotionPlanningParams params;
  interactive_mapping_ros::ParamReader reader(private_nh);
  visitParams(params, [&reader](const std::string& key, auto& value) { reader.read(key, &value); });
  reader.ignore("diagnostic_period");  // read by diagnostic_updater
  reader.ignore("diagnostic_updater");
  reader.report("", params.validate());
  reader.finish();
  return params;
}

}  // namespace motion_planning_ros
