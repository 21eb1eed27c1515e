// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "motion_planning/joint_trajectory.h"

namespace motion_planning {

struct JointPlannerConfig {
  int max_iterations{10000};     // of RRTConnect: planners end by iterations, never by the clock
  double range_rad{0.6};         // longest edge of a tree
  double check_step_rad{0.035};  // states on an edge are checked this near to each other (max norm); 2 degrees
  int shortcut_rounds{60};
  int smooth_rounds{2};
  double joint_window_rad{3.3};  // samples stay within this of start and goal: no needless whole turns
  std::uint64_t seed{1};

  std::vector<std::string> validate() const;
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
