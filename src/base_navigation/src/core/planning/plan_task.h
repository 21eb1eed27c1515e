// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include <interactive_mapping_common/result.h>

#include "base_navigation/base_planner.h"
#include "planning/curves.h"

namespace base_navigation {

constexpr double kExact_m = 1e-4;  // a tenth of what a path may end beside its goal
constexpr double kExact_rad = 1e-4;

struct PlanFailure {
  BasePlanStatus status{BasePlanStatus::kIterations};
  std::string message;
};
template <class T>
using Result = interactive_mapping::Result<T, PlanFailure>;

/// Straight out of where the robot stands.
struct Launch {
  double length_m{0.0};  // signed
  double tight_m{0.0};   // so much of it, unsigned, with the goal's padding
  Pose2d pose_map;
};

/// Straight to the goal.
struct Approach {
  double length_m{0.0};
  Pose2d pose_map;  // where it begins
};

/// What all stages of one request share. Once cancelled, nothing is free.
struct PlanTask {
  PlanTask(const BasePlannerConfig& config, const MotionLimits& limits, const Polygon& footprint,
           const std::shared_ptr<const NavigationGrid>& grid, const Pose2d& start_map, const Pose2d& goal_map,
           const std::function<bool()>& is_cancelled);

  bool isCancelled() const;
  /// With the padding of the way between the ends.
  bool isFree(const Pose2d& pose_map) const;
  bool isFree(const Pose2d& from_map, const Motions& motions) const;

  const BasePlannerConfig& config;
  const MotionLimits& limits;
  const Polygon& footprint;
  const NavigationGrid& grid;
  const Pose2d start_map;
  const Pose2d goal_map;
  const FootprintChecker tight;  // with the goal's padding
  const FootprintChecker roomy;

 private:
  const std::function<bool()>& asked_;
  mutable bool is_cancelled_{false};
};

std::string text(const FootprintVerdict& verdict);

/// `occupied` or `unknown`, as the verdict says.
PlanFailure failureAt(const FootprintVerdict& verdict, BasePlanStatus occupied, BasePlanStatus unknown,
                      std::string message);

}  // namespace base_navigation
