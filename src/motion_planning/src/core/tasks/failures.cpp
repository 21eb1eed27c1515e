// SPDX-License-Identifier: BSD-3-Clause
#include "tasks/failures.h"

#include <cmath>
#include <sstream>

#include <interactive_mapping_common/formatted.h>
#include <mp700_ur5e_description/robot_names.h>

namespace motion_planning {

using interactive_mapping::formatted;

PlanFailure cancelled() {
  return {PlanStatus::kCancelled, "planning was cancelled"};
}

PlanFailure badRequest(const std::string& message) {
  return {PlanStatus::kBadRequest, message};
}

PlanFailure startInCollision(const Contact& contact) {
  return {PlanStatus::kStartInCollision, "the arm's start is in collision: " + contact.describe()};
}

PlanFailure outsideLimits(const std::string& what, const ArmVector& joints_rad, const ArmLimits& limits) {
  std::string text = what;
  const char* separator = ": ";
  for (Eigen::Index j = 0; j < joints_rad.size(); ++j) {
    if (joints_rad[j] >= limits.lower_rad[j] - kLimitTolerance_rad &&
        joints_rad[j] <= limits.upper_rad[j] + kLimitTolerance_rad) {
      continue;
    }
    text += formatted("%s%s = %.3f rad, must be in [%.3f, %.3f] rad", separator,
                      mp700_ur5e_description::kArmJoints[static_cast<std::size_t>(j)], joints_rad[j],
                      limits.lower_rad[j], limits.upper_rad[j]);
    separator = "; ";
  }
  return {PlanStatus::kOutsideLimits, text};
}

std::string inMetres(const Eigen::Vector3d& p) {
  return formatted("(%.3f, %.3f, %.3f) m", p.x(), p.y(), p.z());
}

std::string inDegrees(double angle_rad) {
  return formatted("%.1f deg", angle_rad * 180.0 / M_PI);
}

void Rejections::add(const Contact& contact) {
  if (!first_ || (contact.kind == CollisionKind::kUnknown && first_.kind != CollisionKind::kUnknown)) first_ = contact;
  ++count_[contact.kind];
  ++total_;
}

PlanStatus Rejections::status() const {
  return count_.count(CollisionKind::kUnknown) != 0 ? PlanStatus::kGoalUnknown : PlanStatus::kGoalInCollision;
}

std::string Rejections::describe() const {
  std::ostringstream out;
  out << total_ << " in collision (";
  const char* separator = "";
  for (const auto& [kind, count] : count_) {
    out << separator << toString(kind) << " " << count;
    separator = ", ";
  }
  out << "), for one: " << first_.describe();
  return out.str();
}

}  // namespace motion_planning
