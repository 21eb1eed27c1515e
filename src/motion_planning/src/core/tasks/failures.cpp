// SPDX-License-Identifier: BSD-3-Clause
#include "tasks/failures.h"

#include <cmath>
#include <sstream>

#include <mp700_ur5e_description/robot_names.h>

namespace motion_planning {
namespace {

std::ostringstream fixedText(int decimals) {
  std::ostringstream out;
  out.precision(decimals);
  out << std::fixed;
  return out;
}

}  // namespace

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
  std::ostringstream out = fixedText(3);
  const char* separator = ": ";
  for (Eigen::Index j = 0; j < joints_rad.size(); ++j) {
    if (joints_rad[j] >= limits.lower_rad[j] - kLimitTolerance_rad &&
        joints_rad[j] <= limits.upper_rad[j] + kLimitTolerance_rad) {
      continue;
    }
    out << separator << mp700_ur5e_description::kArmJoints[static_cast<std::size_t>(j)] << " = " << joints_rad[j]
        << " rad, must be in [" << limits.lower_rad[j] << ", " << limits.upper_rad[j] << "] rad";
    separator = "; ";
  }
  return {PlanStatus::kOutsideLimits, what + out.str()};
}

std::string inMetres(const Eigen::Vector3d& p) {
  std::ostringstream out = fixedText(3);
  out << "(" << p.x() << ", " << p.y() << ", " << p.z() << ") m";
  return out.str();
}

std::string inDegrees(double angle_rad) {
  std::ostringstream out = fixedText(1);
  out << angle_rad * 180.0 / M_PI << " deg";
  return out.str();
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
