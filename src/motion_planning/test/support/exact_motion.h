// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "motion_planning/motion_planner.h"
#include "support/pick_world.h"

namespace motion_planning {

/// A judge of motions that shares no code with CollisionChecker: points on the surfaces of links, magnet and held brick
/// against exact boxes and ground. What it says is inside is inside; it may miss what is smaller than its spacing.
class ExactMotion {
 public:
  ExactMotion(const ArmKinematics& arm, const PickWorld& pick, double spacing_m = 0.04);

  /// Box that magnet and held brick may touch; `is_gone`: it is no obstacle at all.
  void setTarget(std::optional<std::size_t> box, bool is_gone = false);
  void setHeld(const std::optional<HeldBrick>& held);

  /// Smallest distance of links to boxes and ground; of the held brick plus `held_shrink_m`: it may touch by that much.
  /// `what`, if not null, gets the two that are nearest.
  double clearance(const ArmVector& joints_rad, double held_shrink_m, std::string* what = nullptr) const;

  /// Empty if nothing is inside of anything along the whole trajectory, looked at every 0.0035 rad: ten times as densely
  /// as the planner does.
  std::string complaint(const JointTrajectory& trajectory, double held_shrink_m) const;

  /// Points of arm, magnet and held brick in base_link.
  std::vector<Eigen::Vector3d> points(const ArmVector& joints_rad) const;

 private:
  struct Point {
    std::size_t body;
    Eigen::Vector3d p_body;
    const char* link;
    bool is_tool;
  };
  const ArmKinematics& arm_;
  const PickWorld& pick_;
  double spacing_m_;
  std::vector<Point> points_;
  std::vector<Eigen::Vector3d> held_points_tip_;
  std::optional<std::size_t> target_;
  bool is_gone_{false};
};

}  // namespace motion_planning
