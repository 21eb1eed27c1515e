// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base_navigation/base_navigator.h"
#include "base_navigation/grid_fusion.h"

/// The tables of all keys, for whoever reads or writes configurations: visit(key, value) for each. The planner's seed is
/// no key: the same request gives the same path.
namespace base_navigation {

template <typename Config, typename Visitor>
void visitGridFields(Config& config, Visitor&& visit) {
  visit("grid/cell_size_m", config.cell_size_m);
  visit("grid/scan_free_range_m", config.scan_free_range_m);
  visit("grid/scan_obstacle_range_m", config.scan_obstacle_range_m);
  visit("grid/obstacle_memory_s", config.obstacle_memory_s);
  visit("grid/max_range_m", config.max_range_m);
  visit("grid/standing_padding_m", config.standing_padding_m);
}

template <typename Config, typename Visitor>
void visitPlannerFields(Config& config, Visitor&& visit) {
  visit("plan/padding_m", config.padding_m);
  visit("plan/goal_padding_m", config.goal_padding_m);
  visit("plan/approach_m", config.approach_m);
  visit("plan/min_approach_m", config.min_approach_m);
  visit("plan/max_back_off_m", config.max_back_off_m);
  visit("plan/turn_radius_m", config.turn_radius_m);
  visit("plan/max_iterations", config.max_iterations);
  visit("plan/shortcut_rounds", config.shortcut_rounds);
  visit("plan/position_tolerance_m", config.position_tolerance_m);
  visit("plan/yaw_tolerance_rad", config.yaw_tolerance_rad);
}

template <typename Config, typename Visitor>
void visitFollowerFields(Config& config, Visitor&& visit) {
  visit("follow/gain_along_1_s", config.gain_along_1_s);
  visit("follow/gain_across_1_m2", config.gain_across_1_m2);
  visit("follow/gain_yaw_1_m", config.gain_yaw_1_m);
  visit("follow/max_correction_1_s", config.max_correction_1_s);
  visit("follow/gain_turn_1_s", config.gain_turn_1_s);
  visit("follow/lag_s", config.lag_s);
  visit("follow/noise_share", config.noise_share);
  visit("follow/speed_reserve", config.speed_reserve);
  visit("follow/acceleration_reserve", config.acceleration_reserve);
  visit("follow/wait_m", config.wait_m);
  visit("follow/wait_rad", config.wait_rad);
  visit("follow/max_error_m", config.max_error_m);
  visit("follow/max_error_rad", config.max_error_rad);
  visit("follow/settle_m", config.settle_m);
  visit("follow/settle_rad", config.settle_rad);
}

template <typename Config, typename Visitor>
void visitGuardFields(Config& config, Visitor&& visit) {
  visit("guard/margin_m", config.margin_m);
  visit("guard/latency_s", config.latency_s);
  visit("guard/braking_share", config.braking_share);
  visit("guard/look_ahead_m", config.look_ahead_m);
  visit("guard/look_ahead_rad", config.look_ahead_rad);
  visit("guard/min_echoes", config.min_echoes);
}

template <typename Config, typename Visitor>
void visitNavigatorFields(Config& config, Visitor&& visit) {
  visit("drive/max_odometry_age_s", config.max_odometry_age_s);
  visit("drive/max_pose_age_s", config.max_pose_age_s);
  visit("drive/max_scan_age_s", config.max_scan_age_s);
  visit("drive/max_grid_age_s", config.max_grid_age_s);
  visit("drive/max_heartbeat_age_s", config.max_heartbeat_age_s);
  visit("drive/stale_patience_s", config.stale_patience_s);
  visit("drive/scanner_patience_s", config.scanner_patience_s);
  visit("drive/max_pose_step_m", config.max_pose_step_m);
  visit("drive/max_pose_step_rad", config.max_pose_step_rad);
  visit("drive/blocked_patience_s", config.blocked_patience_s);
  visit("drive/stuck_s", config.stuck_s);
  visit("drive/stuck_share", config.stuck_share);
  visit("drive/stuck_min_m", config.stuck_min_m);
  visit("drive/stuck_min_rad", config.stuck_min_rad);
  visit("drive/max_plans", config.max_plans);
  visit("drive/plan_cost_s", config.plan_cost_s);
}

}  // namespace base_navigation
