// SPDX-License-Identifier: BSD-3-Clause
#include "driving/look_ahead.h"

#include <algorithm>
#include <cmath>

namespace base_navigation {
namespace {

constexpr double kStoppingMore_m = 0.2;  // the arc of the present twist is looked at so much beyond the stop

}  // namespace

GuardVerdict lookAhead(const ObstacleGuard& guard, const PathFollower& follower, const MotionLimits& limits,
                       const DriveData& data) {
  const Twist2d wanted = follower.wanted(data.T_map_base);
  const std::vector<BaseMotion> ahead = follower.ahead();
  GuardVerdict verdict;
  if (ahead.empty() || (wanted.linear_m_s == 0.0 && wanted.angular_rad_s == 0.0)) return verdict;
  const Pose2d T_scan_base = data.motionSinceScan();
  verdict = guard.check(wanted, ahead, *data.scan, T_scan_base);
  if (ahead.front().isTurn() || wanted.linear_m_s == 0.0) return verdict;

  double left_m = 0.0;
  for (const BaseMotion& motion : ahead) left_m += std::abs(motion.length_m);
  const Twist2d& last = follower.lastCommand();
  const double speed_m_s = std::abs(last.linear_m_s);
  const double curved_s = std::max(speed_m_s / limits.linear_m_s2, std::abs(last.angular_rad_s) / limits.turn_rad_s2) /
                          guard.config().braking_share;
  const double stopping_m = speed_m_s * (guard.config().latency_s + 0.5 * curved_s);
  const auto alongArc = [&](const Twist2d& twist, double length_m) {
    const double duration_s = length_m / std::abs(twist.linear_m_s);
    return guard.check(twist, {{twist.linear_m_s * duration_s, twist.angular_rad_s * duration_s}}, *data.scan,
                       T_scan_base);
  };
  const auto worse = [&](GuardVerdict other, double speed) {
    other.speed_factor = std::min(1.0, other.speed_factor * speed / std::abs(wanted.linear_m_s));
    if (other.speed_factor < verdict.speed_factor) verdict = other;
  };
  worse(alongArc(wanted, std::min(left_m, stopping_m + kStoppingMore_m)), std::abs(wanted.linear_m_s));
  if (speed_m_s > 0.0) {
    const GuardVerdict moving = alongArc(last, stopping_m);
    if (moving.speed_factor < 1.0) worse(moving, speed_m_s);
  }
  return verdict;
}

}  // namespace base_navigation
