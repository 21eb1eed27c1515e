// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <interactive_mapping_common/config/schema.h>

#include "motion_planning/collision_checker.h"
#include "motion_planning/joint_trajectory.h"

namespace motion_planning {

constexpr double kMaxClearance_m = 0.5;

struct PathMonitorConfig {
  double stop_clearance_m{0.0};
  double sample_s{0.05};
  double sample_rad{0.035};
  double clearance_step_m{0.01};
  double horizon_s{1e9};

  static void fields(PathMonitorConfig& c, interactive_mapping::Fields& f) {
    f("stop_clearance_m", c.stop_clearance_m, 0.0, kMaxClearance_m, "m",
      "clearance beyond the margins below which the arm stops; 0: it stops at a collision with the margins");
    f("sample_s", c.sample_s, 0.001, 1.0, "s", "time between checked points of the trajectory");
    f("sample_rad", c.sample_rad, 0.001, 1.0, "rad", "greatest motion of a joint between checked points");
    f("clearance_step_m", c.clearance_step_m, 0.001, 0.5, "m",
      "greatest excess of the reported clearance, where 40 samples suffice for it");
    f("horizon_s", c.horizon_s, 0.01, 1e9, "s", "time ahead that is checked");
  }
};

struct PathVerdict {
  bool must_stop{false};
  std::string reason;             // empty unless must_stop
  double clearance_m{0.0};        // smallest over what remains, at most kMaxClearance_m; once stopped, of that moment
  double time_to_contact_s{0.0};  // from now; infinite unless must_stop
  Contact contact;
};

/// The start of a path, and more each 0.05 s until the tip is kAmongOthers_m from it. The last one is farther than
/// that, or the end. So they cover what the planner looked at there, whose steps lie elsewhere. Throws
/// std::invalid_argument if the trajectory is empty.
std::vector<ArmVector> firstPostures(const ArmKinematics& arm, const JointTrajectory& trajectory);

/// What is known of a running trajectory beside the scene.
struct Watched {
  std::optional<HeldBrick> held;
  std::optional<OrientedBox> vacated;  // the place that it was taken from
  std::optional<OrientedBox> target;   // of an approach or a lift; none: the arm moves freely
  std::vector<ArmVector> first_rad;    // firstPostures(), at least one
};

/// With what a trajectory is checked. Contact is allowed if either allows it. The planner lets a held brick out of its
/// start volume with contact allowed, and continues from there without. An arm that begins within the margin of surface
/// is stopped by the surface as mapped alone.
struct WatchCheckers {
  CollisionChecker from_start;
  std::optional<CollisionChecker> beyond;
};
WatchCheckers watchCheckers(std::shared_ptr<const ArmKinematics> arm, std::shared_ptr<const CollisionScene> scene,
                            const Eigen::Isometry3d& T_map_base, const CollisionCheckerConfig& config,
                            const Watched& watched);

/// Watches what remains of a running trajectory against the scene as it is now.
class PathMonitor {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  explicit PathMonitor(const PathMonitorConfig& config);

  /// Watches this trajectory from now on. Throws std::invalid_argument if it is empty.
  void start(JointTrajectory trajectory, std::shared_ptr<const ArmKinematics> arm);
  void stop();

  /// `elapsed_s` since the start of the trajectory. `checker` knows what is held and what may be touched in this phase,
  /// and the scene as it is now. Where it objects, `beyond` is asked, if there is one. Once it says stop, it does so
  /// until start(). Throws std::logic_error before start() and after stop().
  PathVerdict check(double elapsed_s, const CollisionChecker& checker, const CollisionChecker* beyond = nullptr);

 private:
  PathMonitorConfig config_;
  std::optional<JointTrajectory> trajectory_;
  std::shared_ptr<const ArmKinematics> arm_;
  std::optional<PathVerdict> stopped_;
};

}  // namespace motion_planning
