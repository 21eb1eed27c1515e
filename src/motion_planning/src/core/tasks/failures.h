// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>

#include "motion_planning/motion_planner.h"

/// Failures, and parts of their sentences, that several stages share.
namespace motion_planning {

PlanFailure cancelled();
PlanFailure badRequest(const std::string& message);
PlanFailure startInCollision(const Contact& contact);
/// Names the joints beyond their limits, their angles and the allowed ranges. `what`: the posture, begins the sentence.
PlanFailure outsideLimits(const std::string& what, const ArmVector& joints_rad, const ArmLimits& limits);

/// "(x, y, z) m"
std::string inMetres(const Eigen::Vector3d& p);
std::string inDegrees(double angle_rad);

/// Counts the contacts of rejected postures.
class Rejections {
 public:
  void add(const Contact& contact);
  bool empty() const { return total_ == 0; }
  /// Unseen space may turn out to be free: one posture that nothing else blocks makes it the reason.
  PlanStatus status() const;
  std::string describe() const;

 private:
  Contact first_;
  std::map<CollisionKind, int> count_;
  int total_{0};
};

}  // namespace motion_planning
