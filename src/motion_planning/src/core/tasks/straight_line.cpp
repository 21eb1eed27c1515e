// SPDX-License-Identifier: BSD-3-Clause
#include "tasks/straight_line.h"

#include <algorithm>
#include <cmath>

namespace motion_planning {

std::size_t numSteps(const MotionPlannerConfig& config, double length_m) {
  return static_cast<std::size_t>(std::max(1.0, std::ceil(length_m / config.pick.cartesian_step_m - 1e-9)));
}

JointPath followLine(const TaskContext& task, const ArmVector& from, const Eigen::Isometry3d& T_base_from,
                     const Eigen::Vector3d& offset_base) {
  const std::size_t steps = numSteps(task.config, offset_base.norm());
  JointPath line = {from};
  for (std::size_t k = 1; k <= steps; ++k) {
    Eigen::Isometry3d T_base_tip = T_base_from;
    T_base_tip.translation() += offset_base * (static_cast<double>(k) / static_cast<double>(steps));
    const std::vector<ArmVector> branches = task.arm.inverse(T_base_tip, line.back());
    if (branches.empty()) break;
    if ((branches.front() - line.back()).lpNorm<Eigen::Infinity>() > kMaxJointJump_rad) break;
    line.push_back(branches.front());
  }
  return line;
}

std::vector<Eigen::Vector3d> directionsOut(const TaskContext& task, const ArmVector& joints_rad) {
  constexpr double kBesideUp = 0.9;  // cosine: nearer to up, away from the face is up
  const Eigen::Vector3d up_base = task.T_base_map.linear() * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d back_base = -task.arm.tipPose(joints_rad).linear().col(2);
  if (back_base.dot(up_base) >= kBesideUp) return {up_base};
  return {up_base, (up_base + back_base).normalized(), back_base};
}

std::vector<Eigen::Vector3d> upAndAside() {
  std::vector<Eigen::Vector3d> directions;
  for (std::size_t k = 0; k < kSideways; ++k) {
    const double to_rad = 2.0 * M_PI * static_cast<double>(k) / kSideways;
    directions.push_back(Eigen::Vector3d(std::cos(to_rad), std::sin(to_rad), 1.0).normalized());
  }
  return directions;
}

Contact firstContact(const CollisionChecker& checker, const JointPath& line) {
  std::size_t stride = 1;
  while (stride < line.size()) stride *= 2;
  if (const Contact contact = checker.check(line.back())) return contact;
  for (; stride > 1; stride /= 2) {
    for (std::size_t k = stride / 2; k < line.size(); k += stride) {
      if (const Contact contact = checker.check(line[k])) return contact;
    }
  }
  return {};
}

JointTrajectory timedLine(const TaskContext& task, const JointPath& line, double speed_m_s) {
  TimingConfig timing = task.config.timing;
  timing.max_deviation_rad = std::min(timing.max_deviation_rad, kLineDeviation_rad);
  return timeParametrize(line, task.limits, timing, tipSpeedLimit(task.shared_arm, speed_m_s));
}

void append(const JointTrajectory& next, JointTrajectory* whole) {
  const double since_s = whole->duration();
  const auto begin = next.points.begin() + (whole->empty() || next.empty() ? 0 : 1);
  for (auto point = begin; point != next.points.end(); ++point) {
    whole->points.push_back(*point);
    whole->points.back().time_s += since_s;
  }
}

}  // namespace motion_planning
