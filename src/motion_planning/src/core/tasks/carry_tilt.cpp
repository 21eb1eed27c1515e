// SPDX-License-Identifier: BSD-3-Clause
#include "tasks/carry_tilt.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <mp700_ur5e_description/robot_names.h>

#include "kinematics/arm_reach.h"
#include "tasks/failures.h"

namespace motion_planning {
namespace {

constexpr double kLevelShare = 0.7;  // of the samples: those that keep the tool's angle
constexpr int kSampleAttempts = 30;  // to draw a tip that the arm reaches

}  // namespace

double tiltOf(const ArmKinematics& arm, const TiltConstraint& tilt, const ArmVector& joints_rad) {
  const Eigen::Vector3d up_base = arm.tipPose(joints_rad).linear() * tilt.up_tip;
  return std::acos(std::clamp(up_base.z(), -1.0, 1.0));
}

Eigen::Vector3d uprightEdge(const HeldBrick& held, const Eigen::Vector3d& up_tip) {
  const Eigen::Vector3d along = held.T_tip_brick.linear().transpose() * up_tip;
  int edge = 0;
  along.cwiseAbs().maxCoeff(&edge);
  return std::copysign(1.0, along[edge]) * held.T_tip_brick.linear().col(edge);
}

Result<Tilt> tiltOfHeld(const TaskContext& task, bool keep_level) {
  const PlanningContext& request = task.request;
  if (!request.held || !keep_level) return Tilt();
  const Eigen::Vector3d up_tip = task.arm.tipPose(request.start_rad).linear().transpose() * Eigen::Vector3d::UnitZ();
  const TiltConstraint tilt{uprightEdge(*request.held, up_tip), task.config.pick.max_tilt_rad};
  const double tilt_rad = tiltOf(task.arm, tilt, request.start_rad);
  if (tilt_rad <= tilt.max_tilt_rad) return Tilt(tilt);
  return PlanFailure{PlanStatus::kConstraint, "what is held is tilted by " + inDegrees(tilt_rad) +
                                                  " at the start, allowed are " + inDegrees(tilt.max_tilt_rad)};
}

std::function<ArmVector(const std::function<double()>&)> tiltSampler(const ArmKinematics& arm,
                                                                     const TiltConstraint& tilt,
                                                                     std::vector<ArmVector> references) {
  const Eigen::Isometry3d T_base_armbase =
      arm.robot().framePose(mp700_ur5e_description::kArmBaseFrame, arm.robotPositions(ArmVector::Zero()));
  const Eigen::Matrix3d R_level = turning(tilt.up_tip, Eigen::Vector3d::UnitZ());
  const double reach_m = armReach(arm, std::nullopt)[0];
  const double max_tilt_rad = std::max(0.0, tilt.max_tilt_rad - kTiltReserve_rad);
  const double cos_max = std::cos(max_tilt_rad);
  return [=, &arm, references = std::move(references)](const std::function<double()>& uniform01) -> ArmVector {
    const auto& near = references[std::min(
        references.size() - 1, static_cast<std::size_t>(uniform01() * static_cast<double>(references.size())))];
    if (uniform01() < kLevelShare) {
      ArmVector q = near;
      const double sum_rad = near[1] + near[2] + near[3];
      q[0] += M_PI * (2.0 * uniform01() - 1.0);
      q[1] += M_PI * (2.0 * uniform01() - 1.0);
      q[2] = std::copysign(M_PI * uniform01(), near[2]);  // the other sign leads through the stretched arm
      q[3] = sum_rad - q[1] - q[2];
      const double roll_rad = M_PI * (2.0 * uniform01() - 1.0);
      q[5] += roll_rad;
      if (tiltOf(arm, tilt, q) > max_tilt_rad) q[5] -= roll_rad;  // the tool is not upright: turning it tilts
      return q;
    }
    for (int attempt = 0; attempt < kSampleAttempts; ++attempt) {
      Eigen::Isometry3d T_base_tip = Eigen::Isometry3d::Identity();
      Eigen::Vector3d p_armbase;
      for (int i = 0; i < 3; ++i) p_armbase[i] = reach_m * (2.0 * uniform01() - 1.0);
      T_base_tip.translation() = T_base_armbase * p_armbase;
      // Uniform in the cone's solid angle.
      const double cos_tilt = 1.0 - uniform01() * (1.0 - cos_max);
      const double sin_tilt = std::sqrt(std::max(0.0, 1.0 - cos_tilt * cos_tilt));
      const double to = 2.0 * M_PI * uniform01();
      const Eigen::Vector3d up(sin_tilt * std::cos(to), sin_tilt * std::sin(to), cos_tilt);
      T_base_tip.linear() = turning(Eigen::Vector3d::UnitZ(), up) * aboutZ(2.0 * M_PI * uniform01()) * R_level;
      const std::vector<ArmVector> branches = arm.inverse(T_base_tip, near);
      if (branches.empty()) continue;
      return branches[std::min(branches.size() - 1,
                               static_cast<std::size_t>(uniform01() * static_cast<double>(branches.size())))];
    }
    return near;
  };
}

Eigen::Matrix3d turning(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  // Not Eigen's FromTwoVectors: some 1e-6 rad from opposite, as for a brick that physics has laid down, it cancels and
  // gives no rotation.
  Eigen::Vector3d axis = from.cross(to);
  const double sine = axis.norm();
  constexpr double kParallel = 1e-9;
  axis = sine > kParallel ? Eigen::Vector3d(axis / sine) : from.unitOrthogonal();
  return Eigen::AngleAxisd(std::atan2(sine, from.dot(to)), axis).toRotationMatrix();
}

Eigen::Matrix3d aboutZ(double angle_rad) {
  return Eigen::AngleAxisd(angle_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
}

}  // namespace motion_planning
