// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base_navigation/base_path.h"
#include "base_navigation/footprint_checker.h"

namespace base_navigation {

struct BasePlannerConfig {
  double padding_m{0.06};  // of the footprint on the way; more than the guard's margin, or it stops what was planned
  double goal_padding_m{0.0};  // at the goal and on the last approach, where the robot comes near on purpose
  double approach_m{0.4};      // the way ends with so much straight ahead, ...
  double min_approach_m{0.1};  // ... or at least so much, where there is no room; more room to turn goes before length
  double max_back_off_m{1.0};  // straight back before the first turn, until turning on the spot is free, at most
  double turn_radius_m{0.35};  // of the curves planned with
  int max_iterations{4000};    // of RRTConnect: it ends by these, never by the clock
  int shortcut_rounds{150};
  double position_tolerance_m{0.02};  // a goal this near is reached
  double yaw_tolerance_rad{0.03};
  std::uint64_t seed{1};

  std::vector<std::string> validate() const;
};

enum class BasePlanStatus {
  kSolved,
  kStartOccupied,  // under the footprint; or nearer than the padding, with no straight way out
  kStartUnknown,
  kGoalOccupied,
  kGoalUnknown,
  kNoApproach,  // the goal is free, the straight way to it is not
  kNoPath,      // Dijkstra knows no way even for the inscribed circle: nothing was searched
  kIterations,  // there may be one: the search ended without
  kCancelled,
};
const char* toString(BasePlanStatus status);

struct BasePlan {
  BasePlanStatus status{BasePlanStatus::kIterations};
  std::string message;  // what and where, in words; empty if solved
  BasePath path;
  // Lengths of the path's beginning and end on which the footprint is padded by goal_padding_m; between, by padding_m.
  double tight_start_m{0.0};
  double tight_end_m{0.0};
  double duration_s{0.0};
  int iterations{0};
};

/// Paths of a differential drive over known-free ground: straight out of what is too near to turn (back, or ahead where
/// that is faster), RRTConnect over Reeds-Shepp curves (OMPL) with samples drawn about Dijkstra's way, and turn-and-drive
/// along it where there is room; cut short by the best of Reeds-Shepp curve, Dubins curves and turn-drive-turn; a straight
/// approach square to the goal. The best is the fastest, with 2 s more for each time it drives backwards after the
/// first back-off. The same arguments give the same path.
class BasePlanner {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  BasePlanner(const BasePlannerConfig& config, const MotionLimits& limits, Polygon footprint);

  /// The path ends within 1 mm and 1 mrad of the goal; a goal within the tolerances is an empty path. `is_cancelled` is
  /// asked every few milliseconds, but for Dijkstra: tens of them on large grids. Throws std::invalid_argument for poses
  /// that are not finite and grids whose size is not that of their states.
  BasePlan plan(std::shared_ptr<const NavigationGrid> grid, const Pose2d& start_map, const Pose2d& goal_map,
                const std::function<bool()>& is_cancelled = {}) const;

  /// The first pose of a plan of this planner, from `from_m` along its path on, that a newer grid does not leave free
  /// with the padding it was planned with; in the grid of the plan all are free. Without a path: free. Throws
  /// std::invalid_argument like plan().
  FootprintVerdict recheck(const BasePlan& plan, double from_m, std::shared_ptr<const NavigationGrid> grid) const;

  const BasePlannerConfig& config() const { return config_; }

 private:
  BasePlannerConfig config_;
  MotionLimits limits_;
  Polygon footprint_;
};

}  // namespace base_navigation
