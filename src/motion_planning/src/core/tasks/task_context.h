// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <utility>

#include "motion_planning/motion_planner.h"

namespace motion_planning {

/// What all stages of one request share. The planner, whose parts it refers to, and the request outlive it.
struct TaskContext {
  const std::shared_ptr<const ArmKinematics>& shared_arm;
  const ManipulabilitySectors& sectors;
  const MotionPlannerConfig& config;
  const PlanningContext& request;

  const ArmKinematics& arm{*shared_arm};
  Eigen::Isometry3d T_base_map{request.T_map_base.inverse()};
  MotionLimits limits{config.speed.velocity_scale * arm.limits().velocity_rad_s,
                      ArmVector::Constant(config.speed.acceleration_rad_s2)};

  bool isCancelled() const { return request.is_cancelled && request.is_cancelled(); }
};

/// Of the random numbers of a request. A request uses up fewer than this.
constexpr std::uint64_t kSeedsPerRequest = 1000;
inline std::uint64_t seedOf(const TaskContext& task) {
  return task.config.planner.seed + kSeedsPerRequest * task.request.seed;
}

}  // namespace motion_planning
