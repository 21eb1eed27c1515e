// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include <interactive_mapping_common/config/schema.h>

#include "motion_planning/joint_trajectory.h"

namespace motion_planning {

struct JointPlannerConfig {
  int max_iterations{10000};
  double range_rad{0.6};
  double check_step_rad{0.035};
  int shortcut_rounds{60};
  int smooth_rounds{2};
  double joint_window_rad{3.3};
  std::uint64_t seed{1};  // belongs to the call, not to the parameters

  static void fields(JointPlannerConfig& c, interactive_mapping::Fields& f) {
    f("max_iterations", c.max_iterations, 1, 10'000'000, "", "iterations of RRTConnect, which never ends by the clock");
    f("range_rad", c.range_rad, 0.01, 10.0, "rad", "longest edge of a tree");
    f("check_step_rad", c.check_step_rad, 1e-4, 0.5, "rad", "distance of the states that are checked along an edge");
    f("shortcut_rounds", c.shortcut_rounds, 0, 100'000, "", "attempts to shorten a path");
    f("smooth_rounds", c.smooth_rounds, 0, 10'000, "", "rounds of smoothing after that");
    f("joint_window_rad", c.joint_window_rad, 0.1, 20.0, "rad",
      "samples stay within this of start and goal: no needless whole turns");
  }
};

/// What a path must fulfil everywhere; pure function of the joint vector.
struct JointSpace {
  ArmVector lower_rad;
  ArmVector upper_rad;
  std::function<bool(const ArmVector&)> is_valid;
  /// Draws a joint vector that keeps the constraints by construction; empty: uniform within the limits. `uniform01`
  /// gives the random numbers.
  std::function<ArmVector(const std::function<double()>& uniform01)> sample;
};

enum class JointPlanStatus { kSolved, kStartInvalid, kGoalInvalid, kIterations, kCancelled };

struct JointPlanResult {
  JointPlanStatus status{JointPlanStatus::kIterations};
  JointPath path;       // checked at check_step_rad, from the start to one of the goals
  std::size_t goal{0};  // which one
  int iterations{0};
  std::size_t states_checked{0};
};

/// RRTConnect (OMPL) from `start` to any of `goals`, then shortcuts and smoothing. The same arguments give the same path.
/// `is_cancelled` is asked at least every few milliseconds.
JointPlanResult planJointPath(const JointSpace& space, const ArmVector& start, const std::vector<ArmVector>& goals,
                              const JointPlannerConfig& config, const std::function<bool()>& is_cancelled = {});

}  // namespace motion_planning
