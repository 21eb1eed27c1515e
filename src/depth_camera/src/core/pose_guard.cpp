// SPDX-License-Identifier: BSD-3-Clause
#include "depth_camera/pose_guard.h"

#include <algorithm>
#include <cmath>

#include <interactive_mapping_common/formatted.h>

namespace depth_camera {
namespace {

double angleBetween(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return Eigen::Quaterniond(a.linear()).angularDistance(Eigen::Quaterniond(b.linear()));
}

}  // namespace

double PoseLimits::shareUsed(const StampedPose& from, const StampedPose& to) const {
  const double dt = std::abs(to.stamp_s - from.stamp_s);
  const auto share = [](double value, double allowed) { return value == 0.0 ? 0.0 : value / allowed; };
  return std::max(
      share((to.T_map_camera.translation() - from.T_map_camera.translation()).norm(), max_step_m + max_speed_mps * dt),
      share(angleBetween(from.T_map_camera, to.T_map_camera), max_step_rad + max_turn_radps * dt));
}

PoseGuard::Verdict PoseGuard::check(const Eigen::Isometry3d& T_map_camera, double stamp_s) {
  const StampedPose pose{T_map_camera, stamp_s};
  if (!believed_ || limits_.shareUsed(*believed_, pose) <= 1.0) {
    believed_ = pose;
    candidate_.reset();
    num_agreeing_ = 0;
    return Verdict::kBelieved;
  }
  num_agreeing_ = candidate_ && limits_.shareUsed(*candidate_, pose) <= 1.0 ? num_agreeing_ + 1 : 1;
  candidate_ = pose;

  const double dt = std::abs(stamp_s - believed_->stamp_s);
  const double moved = (T_map_camera.translation() - believed_->T_map_camera.translation()).norm();
  message_ = interactive_mapping::formatted(
      "camera moved by %.3f m and %.3f rad in %.3f s, must be at most %.3f m and %.3f rad (pose_limits)", moved,
      angleBetween(believed_->T_map_camera, T_map_camera), dt, limits_.max_step_m + limits_.max_speed_mps * dt,
      limits_.max_step_rad + limits_.max_turn_radps * dt);
  if (limits_.settle_frames == 0 || num_agreeing_ < limits_.settle_frames) return Verdict::kJump;
  believed_ = pose;
  candidate_.reset();
  num_agreeing_ = 0;
  return Verdict::kSettled;
}

void PoseGuard::reset() {
  believed_.reset();
  candidate_.reset();
  num_agreeing_ = 0;
}

}  // namespace depth_camera
