// SPDX-License-Identifier: BSD-3-Clause
#include "driving/stuck_detector.h"

#include <algorithm>
#include <cmath>

#include "text.h"

namespace base_navigation {
namespace {

// Stuck: less than this share of the commanded motion was measured. Less motion than this within stuck_s is not judged.
constexpr double kStuckShare = 0.2;
constexpr double kStuckMin_m = 0.05;
constexpr double kStuckMin_rad = 0.1;

}  // namespace

void StuckDetector::add(double now_s, double dt_s, const Twist2d& command, const DriveData& data) {
  commanded_ = moveAlongArc(commanded_, command.linear_m_s * dt_s, command.angular_rad_s * dt_s);
  commanded_rad_ += command.angular_rad_s * dt_s;
  // As the localisation told it: what odometry has carried on since says nothing of slip.
  motions_.push_back({now_s, commanded_, commanded_rad_, data.T_odom_base, data.T_map_base_at_pose});
  while (motions_.size() > 1 && now_s - motions_[1].now_s >= config_.stuck_s) motions_.pop_front();
}

std::string StuckDetector::find(double now_s, double least_s) const {
  if (motions_.empty() || now_s - motions_.front().now_s < least_s) return {};
  // What was commanded last need not be seen yet: drives lag, and poses are as old as they may be.
  const Motion* last = &motions_.front();
  for (const Motion& one : motions_) {
    if (one.now_s <= now_s - config_.max_pose_age_s) last = &one;
  }
  const std::string within = " within " + text(now_s - motions_.front().now_s, 1) + " s, ";
  std::string found = judge("the wheels do not turn as commanded", within + "odometry", &Motion::T_odom_base, *last);
  if (!found.empty()) return found;
  return judge("the wheels slip", within + "the localisation", &Motion::T_map_base, *last);
}

std::string StuckDetector::judge(const char* what, const std::string& by, Pose2d Motion::*measured,
                                 const Motion& last) const {
  const Motion& first = motions_.front();
  const double told_m = (last.commanded.position() - first.commanded.position()).norm();
  const double told_rad = std::abs(last.commanded_rad - first.commanded_rad);
  // The farthest that it came: a base commanded to turn and then back has done so.
  double seen_m = 0.0;
  double seen_rad = 0.0;
  for (const Motion& one : motions_) {
    seen_m = std::max(seen_m, ((one.*measured).position() - (first.*measured).position()).norm());
    seen_rad = std::max(seen_rad, std::abs(wrapAngle((one.*measured).yaw_rad - (first.*measured).yaw_rad)));
  }
  const auto words = [&](const char* move, double told, double seen, const char* unit) {
    return std::string(what) + ": commanded to " + move + " " + text(told, 3) + unit + by + " reports " +
           text(seen, 3) + unit + ", must be at least " + text(kStuckShare * told, 3) + unit;
  };
  if (told_m >= kStuckMin_m && seen_m < kStuckShare * told_m) return words("move", told_m, seen_m, " m");
  // Half a turn and more cannot be told from what remains of a whole one.
  const bool is_clear = told_rad >= kStuckMin_rad && told_rad < 0.9 * M_PI;
  if (is_clear && seen_rad < kStuckShare * told_rad) return words("turn", told_rad, seen_rad, " rad");
  return {};
}

}  // namespace base_navigation
