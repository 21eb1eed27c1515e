// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <interactive_mapping_common/config/schema.h>

#include "base_navigation/base_path.h"
#include "base_navigation/footprint_checker.h"

namespace base_navigation {

struct BasePlannerConfig {
  double padding_m{0.06};
  double goal_padding_m{0.0};
  double approach_m{0.4};
  double min_approach_m{0.1};
  double max_back_off_m{1.0};
  double turn_radius_m{0.35};
  int max_iterations{4000};
  int shortcut_rounds{150};
  double position_tolerance_m{0.02};
  double yaw_tolerance_rad{0.05};
  std::uint64_t seed{1};  // no parameter: the same request gives the same path

  static void fields(BasePlannerConfig& c, interactive_mapping::Fields& f) {
    // A bound that is impossible itself is reported alone.
    const auto bound = [](double value, double lo, double hi) { return value >= lo && value <= hi ? value : hi; };
    f("padding_m", c.padding_m, 0.0, 0.5, "m",
      "padding of the footprint along the path; above guard/margin_m, or the guard stops planned motion");
    f("goal_padding_m", c.goal_padding_m, 0.0, bound(c.padding_m, 0.0, 0.5), "m",
      "padding at the goal and on the last approach, where the robot comes near on purpose; at most plan/padding_m");
    f("approach_m", c.approach_m, 0.05, 5.0, "m", "length of the straight stretch before the goal");
    f("min_approach_m", c.min_approach_m, 0.0, bound(c.approach_m, 0.05, 5.0), "m",
      "shortest such stretch, where obstacles permit no longer one; at most plan/approach_m");
    f("max_back_off_m", c.max_back_off_m, 0.0, 5.0, "m",
      "longest straight stretch backwards at the start, until the robot can turn on the spot");
    f("turn_radius_m", c.turn_radius_m, 0.05, 5.0, "m", "radius of the curves in a plan");
    f("max_iterations", c.max_iterations, 1, 10000000, "", "iterations of RRTConnect; no clock ends the search");
    f("shortcut_rounds", c.shortcut_rounds, 0, 100000, "", "attempts to shorten the path that was found");
    f("position_tolerance_m", c.position_tolerance_m, 0.0, 1.0, "m", "a goal this near counts as reached");
    f("yaw_tolerance_rad", c.yaw_tolerance_rad, 0.0, 1.0, "rad", "the same of the heading");
  }
};

/// The straight way to a goal, by its length [m].
struct ApproachRoom {
  double free_m{0.0};               // as far back from the goal nothing is met
  FootprintVerdict blocked;         // what is met beyond
  std::optional<double> longest_m;  // of at least min_approach_m, from where the path's padding has room; none: no way
  std::optional<double> turning_m;  // the same, from where the robot can turn on the spot
};

/// `tight`: the footprint with the padding at the goal; `roomy`: with that of the path.
ApproachRoom roomToApproach(const FootprintChecker& tight, const FootprintChecker& roomy, const Pose2d& goal_map,
                            const BasePlannerConfig& config);

enum class BasePlanStatus {
  kSolved,
  kStartOccupied,  // under the footprint; or nearer than the padding, and no straight retreat is free
  kStartUnknown,
  kGoalOccupied,
  kGoalUnknown,
  kNoApproach,  // the goal is free, the straight way to it is not
  kNoPath,      // Dijkstra knows no way even for the inscribed circle: nothing was searched
  kIterations,  // there may be one: the search ended without
  kCancelled,
};
inline constexpr interactive_mapping::Names<BasePlanStatus> kBasePlanStatusNames = {
    {"solved", BasePlanStatus::kSolved},
    {"start occupied", BasePlanStatus::kStartOccupied},
    {"start unknown", BasePlanStatus::kStartUnknown},
    {"goal occupied", BasePlanStatus::kGoalOccupied},
    {"goal unknown", BasePlanStatus::kGoalUnknown},
    {"no approach", BasePlanStatus::kNoApproach},
    {"no path", BasePlanStatus::kNoPath},
    {"iterations", BasePlanStatus::kIterations},
    {"cancelled", BasePlanStatus::kCancelled}};
constexpr const char* toString(BasePlanStatus status) {
  return interactive_mapping::nameOf(status, kBasePlanStatusNames);
}

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

/// Paths of a differential drive over known-free ground. A path begins with a straight back-off from what is too near to
/// turn, or straight ahead where that is faster. It ends with a straight approach along the goal's heading. For the part
/// between it tries one connection: a Reeds-Shepp curve, Dubins curves or turn-drive-turn. Then it turns and drives along
/// Dijkstra's path, where there is clearance. Then RRTConnect (OMPL) searches over Reeds-Shepp curves, with samples about
/// that path. Connections shorten the result. The fastest path is returned; each time it drives backwards after the
/// back-off counts as 2 s. The same arguments give the same path.
class BasePlanner {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  BasePlanner(const BasePlannerConfig& config, const MotionLimits& limits, Polygon footprint);

  /// The path ends within 1 mm and 1 mrad of the goal; a goal within the tolerances is an empty path. `is_cancelled` is
  /// asked every few milliseconds, but for Dijkstra: tens of them on large grids. Throws std::invalid_argument for poses
  /// that are not finite and grids whose size is not that of their states.
  BasePlan plan(std::shared_ptr<const NavigationGrid> grid, const Pose2d& start_map, const Pose2d& goal_map,
                const std::function<bool()>& is_cancelled = {}) const;

  /// The first pose of a plan of this planner, from `from_m` along its path on, that is not free in a newer grid, with
  /// the padding of the plan. In the grid of the plan all are free. Without a path: free. Throws
  /// std::invalid_argument like plan().
  FootprintVerdict recheck(const BasePlan& plan, double from_m, std::shared_ptr<const NavigationGrid> grid) const;

  const BasePlannerConfig& config() const { return config_; }

 private:
  BasePlannerConfig config_;
  MotionLimits limits_;
  Polygon footprint_;
};

}  // namespace base_navigation
