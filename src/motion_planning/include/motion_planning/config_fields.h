// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "motion_planning/collision_scene.h"
#include "motion_planning/motion_planner.h"
#include "motion_planning/path_monitor.h"

/// The tables of all keys, for whoever reads or writes configurations: visit(key, value) for each, key with its sections.
/// The planner's seed is no key: it belongs to the call.
namespace motion_planning {

template <typename Config, typename Visitor>
void visitSceneFields(Config& config, const std::string& section, Visitor&& visit) {
  visit(section + "sigmas", config.sigmas);
  visit(section + "margin_m", config.margin_m);
  visit(section + "max_margin_m", config.max_margin_m);
  visit(section + "chunk_m", config.chunk_m);
  visit(section + "block_m", config.block_m);
  visit(section + "unknown_near_pile_m", config.unknown_near_pile_m);
  visit(section + "pile_min_height_m", config.pile_min_height_m);
  visit(section + "region_radius_m", config.region_radius_m);
}

template <typename Config, typename Visitor>
void visitPlannerFields(Config& config, Visitor&& visit) {
  visit("collision/self_padding_m", config.collision.self_padding_m);
  visit("collision/held_padding_m", config.collision.held_padding_m);
  visit("collision/floor_margin_m", config.collision.floor_margin_m);
  visit("collision/held_shrink_m", config.collision.held_shrink_m);
  visit("collision/held_release_m", config.collision.held_release_m);
  visit("collision/target_padding_m", config.collision.target_padding_m);
  visit("search/max_iterations", config.planner.max_iterations);
  visit("search/range_rad", config.planner.range_rad);
  visit("search/check_step_rad", config.planner.check_step_rad);
  visit("search/shortcut_rounds", config.planner.shortcut_rounds);
  visit("search/smooth_rounds", config.planner.smooth_rounds);
  visit("search/joint_window_rad", config.planner.joint_window_rad);
  visit("search/verify_step_m", config.verify_step_m);
  visit("motion/velocity_scale", config.velocity_scale);
  visit("motion/acceleration_rad_s2", config.acceleration_rad_s2);
  visit("motion/contact_speed_m_s", config.contact_speed_m_s);
  visit("motion/lift_speed_m_s", config.lift_speed_m_s);
  visit("motion/max_deviation_rad", config.timing.max_deviation_rad);
  visit("motion/sample_s", config.timing.sample_s);
  visit("pick/approach_m", config.approach_m);
  visit("pick/lift_m", config.lift_m);
  visit("pick/min_lift_m", config.min_lift_m);
  visit("pick/lift_room_m", config.lift_room_m);
  visit("pick/overtravel_m", config.overtravel_m);
  visit("pick/cartesian_step_m", config.cartesian_step_m);
  visit("pick/max_joint_jump_rad", config.max_joint_jump_rad);
  visit("pick/plate_margin_m", config.plate_margin_m);
  visit("pick/magnet_radius_m", config.magnet_radius_m);
  visit("pick/yaw_samples", config.yaw_samples);
  visit("pick/contact_grid_m", config.contact_grid_m);
  visit("pick/max_goals", config.max_goals);
  visit("pick/max_tilt_rad", config.max_tilt_rad);
  visit("view/clear_m", config.inspect_clear_m);
  visit("view/samples", config.inspect_samples);
}

template <typename Config, typename Visitor>
void visitMonitorFields(Config& config, const std::string& section, Visitor&& visit) {
  visit(section + "stop_clearance_m", config.stop_clearance_m);
  visit(section + "sample_s", config.sample_s);
  visit(section + "sample_rad", config.sample_rad);
  visit(section + "clearance_step_m", config.clearance_step_m);
  visit(section + "horizon_s", config.horizon_s);
}

}  // namespace motion_planning
