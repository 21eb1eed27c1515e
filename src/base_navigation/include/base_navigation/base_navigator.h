// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_enums/navigation_outcome.h>
#include <interactive_mapping_enums/navigation_state.h>

#include "base_navigation/base_planner.h"
#include "base_navigation/obstacle_guard.h"
#include "base_navigation/path_follower.h"

namespace base_navigation {

inline constexpr double kOdometryHistory_s = 2.0;  // kept, to know where a scan was taken

struct BaseNavigatorConfig {
  double max_odometry_age_s{0.2};
  double max_pose_age_s{0.5};
  double max_scan_age_s{0.4};
  double max_grid_age_s{10.0};
  double max_heartbeat_age_s{0.0};
  double stale_patience_s{2.0};
  double scanner_patience_s{30.0};
  double blocked_patience_s{3.0};
  double stuck_s{3.0};
  int max_plans{12};
  double plan_cost_s{0.2};

  static void fields(BaseNavigatorConfig& c, interactive_mapping::Fields& f) {
    f("max_odometry_age_s", c.max_odometry_age_s, 0.02, 5.0, "s", "older odometry is stale: the base stops");
    f("max_pose_age_s", c.max_pose_age_s, 0.02, 5.0, "s", "older localisation is stale: the base stops");
    f("max_scan_age_s", c.max_scan_age_s, 0.02, kOdometryHistory_s, "s", "older scans are stale: the base stops");
    f("max_grid_age_s", c.max_grid_age_s, c.max_grid_age_s == 0.0 ? 0.0 : 0.1, 3600.0, "s",
      "older ground of the map is stale: the base stops; or 0: a static grid, which comes once");
    f("max_heartbeat_age_s", c.max_heartbeat_age_s, 0.0, 60.0, "s",
      "older heartbeats of the sender of goals are stale: the base stops; 0: drives without a heartbeat");
    f("stale_patience_s", c.stale_patience_s, 0.0, 60.0, "s", "a goal fails when an input is stale for longer");
    f("scanner_patience_s", c.scanner_patience_s, 0.0, 3600.0, "s",
      "a goal fails when the base's own safety scanner stops it for longer");
    f("blocked_patience_s", c.blocked_patience_s, 0.0, 600.0, "s",
      "how long the base waits for an obstacle to go away before it plans again");
    // An impossible age is reported alone, without what follows from it.
    const double pose_age_s = c.max_pose_age_s >= 0.02 && c.max_pose_age_s <= 5.0 ? c.max_pose_age_s : 0.02;
    f("stuck_s", c.stuck_s, pose_age_s + 0.5, 60.0, "s",
      "the base is stuck when it was commanded to move for this long and did not; at least max_pose_age_s + 0.5 s");
    f("max_plans", c.max_plans, 1, 1000, "",
      "plans for one goal, the first included: obstacles come into view one by one");
    f("plan_cost_s", c.plan_cost_s, 0.0, 10.0, "s", "simulated time that the base is stationary for each plan");
  }
};

using interactive_mapping::NavigationPhase;
using interactive_mapping::NavigationStatus;

/// What stops the base itself, whatever it is commanded.
enum class BaseStop : std::uint8_t {
  kNone,
  kScanner,  // its safety scanner's field is not free: ends by itself
  kSignal,   // a stop input of unknown origin
  kButton,   // an emergency button
};
inline constexpr interactive_mapping::Names<BaseStop> kBaseStopNames = {
    {"nothing stops it", BaseStop::kNone},
    {"an obstacle is in its safety scanner's field", BaseStop::kScanner},
    {"its stop input is active", BaseStop::kSignal},
    {"its emergency button is pressed", BaseStop::kButton}};
constexpr const char* toString(BaseStop stop) {
  return interactive_mapping::nameOf(stop, kBaseStopNames);
}

/// What the base knows at a step; stamps on one clock, negative: never came.
struct NavigationInput {
  double now_s{0.0};
  Pose2d T_map_base;          // by the newest localisation, at T_odom_base
  double pose_stamp_s{-1.0};  // of that localisation; between two of them odometry carries the pose on
  Pose2d T_odom_base;
  Twist2d odometry_twist;
  double odometry_stamp_s{-1.0};
  std::shared_ptr<const Scan> scan;
  double scan_stamp_s{-1.0};
  std::shared_ptr<const NavigationGrid> grid;
  double grid_stamp_s{-1.0};  // of the map in it
  double heartbeat_stamp_s{-1.0};
  // What was wrong with the newest of each; empty: nothing.
  std::string odometry_problem, pose_problem, scan_problem, grid_problem;
  std::optional<BaseStop> stop;  // nothing: stops are not reported
};

struct NavigationOutput {
  Twist2d command;  // to be sent, zeros too, unless idle
  NavigationPhase phase{NavigationPhase::kIdle};
  std::string reason;                     // of standing, in words; empty while driving
  std::optional<NavigationStatus> ended;  // in this step, with
  std::string message;                    // why
  FollowCommand follow;
  GuardVerdict guard;
  double remaining_m{0.0};
  bool has_jumped{false};  // localisation or odometry, in this step: what was entered in the map's frame before is void
};

/// Drives to one goal after another, a step at a time. It plans, follows, and stops for what the scanner sees. It stops
/// and replans when the grid changes under the path, and gives up with a reason. Stops brake within the limits, those
/// after a cancel or a lost heartbeat with stop_m_s2. A base that stops by itself is commanded zero at once. After its
/// button or stop input nothing moves without a new goal. One pressed between two goals rejects the next goal, once,
/// for its sender may not know. Planning happens inside step(), while the base stands.
class BaseNavigator {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  BaseNavigator(const BaseNavigatorConfig& config, const BasePlannerConfig& planner, const PathFollowerConfig& follower,
                const ObstacleGuardConfig& guard, const MotionLimits& limits, Polygon footprint);
  ~BaseNavigator();
  BaseNavigator(const BaseNavigator&) = delete;
  BaseNavigator& operator=(const BaseNavigator&) = delete;

  /// A new goal takes the place of the one before, which ends without a word. The base brakes first if it moves. Throws
  /// std::invalid_argument for a goal that is not finite.
  void setGoal(const Pose2d& goal_map);
  /// Brakes with stop_m_s2; the goal ends as cancelled once the base stands.
  void cancel();
  bool isActive() const;

  /// A new margin of the guard holds from the next step on. New limits hold from the next plan on; a path in progress
  /// keeps its own. Throws std::invalid_argument listing every impossible value, and changes nothing then.
  void retune(const ObstacleGuardConfig& guard, const MotionLimits& limits);

  /// To be called with each odometry, and when none comes. `is_cancelled` ends a plan that is being made.
  NavigationOutput step(const NavigationInput& input, const std::function<bool()>& is_cancelled = {});

  /// The way being driven; empty: none.
  const BasePath& path() const;
  int plansForGoal() const;        // asked for, those that failed included
  std::uint64_t numPlans() const;  // changes with path()

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace base_navigation
