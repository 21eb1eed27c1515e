// SPDX-License-Identifier: BSD-3-Clause
#include "driving/drive_data.h"

#include <cmath>
#include <iterator>

#include "text.h"

namespace base_navigation {
namespace {

constexpr double kFuture_s = 0.1;     // a stamp may be so far ahead of the clock: two computers, one clock
constexpr double kStands_m_s = 0.01;  // odometry tells less: the base stands
constexpr double kStands_rad_s = 0.02;
// Farther between two steps than odometry reports: the localisation has jumped.
constexpr double kMaxPoseStep_m = 0.25;
constexpr double kMaxPoseStep_rad = 0.2;

/// From one pose to another.
struct Shift {
  Shift(const Pose2d& from, const Pose2d& to)
      : m((to.position() - from.position()).norm()), rad(std::abs(wrapAngle(to.yaw_rad - from.yaw_rad))) {}
  double m;
  double rad;
};

}  // namespace

void Source::reset() {
  stamp_s = -1.0;
  refused.clear();
}

bool Source::accept(double stamp, double now_s, bool is_finite) {
  if (stamp < 0.0) return false;
  if (!is_finite || !std::isfinite(stamp)) {
    refused = name() + " is not finite";
  } else if (stamp > now_s + kFuture_s) {
    refused = name() + " is stamped " + text(stamp - now_s) + " s ahead of the clock, may be " + text(kFuture_s) + " s";
  } else if (stamp < stamp_s) {
    refused = "the stamps of " + name() + " ran back by " + text(stamp_s - stamp) + " s";
  } else {
    refused.clear();
    const bool is_new = stamp > stamp_s;
    stamp_s = stamp;
    return is_new;
  }
  return false;
}

std::string Source::stale(double now_s, double max_age_s) const {
  if (stamp_s >= 0.0 && now_s - stamp_s <= max_age_s) return {};
  if (!problem.empty()) return problem;
  if (!refused.empty()) return refused;
  if (stamp_s < 0.0) return std::string("no ") + noun + " has come yet";
  return name() + " is " + text(now_s - stamp_s) + " s old, may be " + text(max_age_s) + " s";
}

void DriveData::take(const NavigationInput& input) {
  jump.clear();
  has_jumped = false;
  odometry_.problem = input.odometry_problem;
  pose_.problem = input.pose_problem;
  scan_.problem = input.scan_problem;
  grid_.problem = input.grid_problem;
  takeOdometry(input);
  takePose(input);
  if (has_jumped) jumped_s_ = input.now_s;
  if (input.scan && scan_.accept(input.scan_stamp_s, input.now_s, true)) scan = input.scan;
  if (input.grid) {
    const bool is_newer = grid_.accept(input.grid_stamp_s, input.now_s, true);
    // Equal stamps: the scanner's part of it is newer.
    if (is_newer || input.grid_stamp_s == grid_.stamp_s) grid = input.grid;
  }
  heartbeat_.accept(input.heartbeat_stamp_s, input.now_s, true);
}

void DriveData::takeOdometry(const NavigationInput& input) {
  const double before_s = odometry_.stamp_s;
  const bool is_finite = isFinite(input.T_odom_base) && std::isfinite(input.odometry_twist.linear_m_s) &&
                         std::isfinite(input.odometry_twist.angular_rad_s);
  if (!odometry_.accept(input.odometry_stamp_s, input.now_s, is_finite)) return;
  if (before_s >= 0.0) {
    const double elapsed_s = input.odometry_stamp_s - before_s;
    const Shift step(T_odom_base, input.T_odom_base);
    const double max_m = kMaxPoseStep_m + limits_.forward_m_s * elapsed_s;
    const double max_rad = kMaxPoseStep_rad + limits_.turn_rad_s * elapsed_s;
    if (step.m > max_m || step.rad > max_rad) {
      has_jumped = true;
      jump = "odometry has jumped by " + text(step.m) + " m and " + text(step.rad) + " rad within " + text(elapsed_s) +
             " s, may be " + text(max_m) + " m and " + text(max_rad) + " rad";
      odometry_history_.clear();
    }
  }
  T_odom_base = input.T_odom_base;
  odometry_twist = input.odometry_twist;
  odometry_history_.push_back({input.odometry_stamp_s, T_odom_base});
  while (odometry_history_.back().first - odometry_history_.front().first > kOdometryHistory_s)
    odometry_history_.pop_front();
}

void DriveData::takePose(const NavigationInput& input) {
  // What odometry told while it was not there is nothing to drive by, and no reason to stop.
  const bool is_odometry_fresh = isOdometryFresh(input.now_s);
  const bool can_compare = is_odometry_fresh && was_odometry_fresh_at_pose_;
  const Pose2d expected = compose(T_map_base_at_pose, compose(inverse(T_odom_base_at_pose_), T_odom_base));
  if (!pose_.accept(input.pose_stamp_s, input.now_s, isFinite(input.T_map_base))) {
    if (can_compare) T_map_base = expected;
    return;
  }
  const Shift step(expected, input.T_map_base);
  if (is_pose_known_ && (step.m > kMaxPoseStep_m || step.rad > kMaxPoseStep_rad)) {
    has_jumped = true;
    if (can_compare && jump.empty()) {
      jump = "the localisation has jumped by " + text(step.m) + " m and " + text(step.rad) +
             " rad against odometry, may be " + text(kMaxPoseStep_m) + " m and " + text(kMaxPoseStep_rad) + " rad";
    }
  }
  T_map_base = T_map_base_at_pose = input.T_map_base;
  T_odom_base_at_pose_ = T_odom_base;
  was_odometry_fresh_at_pose_ = is_odometry_fresh;
  is_pose_known_ = true;
}

void DriveData::forget() {
  for (Source* source : {&odometry_, &pose_, &scan_, &grid_, &heartbeat_}) source->reset();
  odometry_history_.clear();
  scan.reset();
  grid.reset();
}

void DriveData::forgetTimes() {
  forget();
  is_pose_known_ = was_odometry_fresh_at_pose_ = false;
  jumped_s_ = -std::numeric_limits<double>::infinity();
}

std::optional<Ending> DriveData::stale(double now_s) const {
  struct Demand {
    const Source& source;
    double max_age_s;
    NavigationStatus status;
  };
  constexpr double kAny = std::numeric_limits<double>::infinity();
  const Demand demands[] = {
      {odometry_, config_.max_odometry_age_s, NavigationStatus::kStaleOdometry},
      {pose_, config_.max_pose_age_s, NavigationStatus::kStalePose},
      {scan_, config_.max_scan_age_s, NavigationStatus::kStaleScan},
      {grid_, config_.max_grid_age_s > 0.0 ? config_.max_grid_age_s : kAny, NavigationStatus::kStaleGrid},
      {heartbeat_, config_.max_heartbeat_age_s, NavigationStatus::kStaleHeartbeat}};
  for (const Demand& demand : demands) {
    if (demand.status == NavigationStatus::kStaleHeartbeat && demand.max_age_s <= 0.0) continue;
    std::string reason = demand.source.stale(now_s, demand.max_age_s);
    if (reason.empty()) continue;
    // What comes and is wrong is not late; a pose that tf cannot give is.
    const bool is_bad = !demand.source.problem.empty() && demand.status != NavigationStatus::kStalePose;
    return Ending{is_bad ? NavigationStatus::kBadInput : demand.status, std::move(reason)};
  }
  return std::nullopt;
}

bool DriveData::stands() const {
  return std::abs(odometry_twist.linear_m_s) < kStands_m_s && std::abs(odometry_twist.angular_rad_s) < kStands_rad_s;
}

Pose2d DriveData::motionSinceScan() const {
  for (auto it = odometry_history_.rbegin(); it != odometry_history_.rend(); ++it) {
    if (it->first > scan_.stamp_s) continue;
    if (it == odometry_history_.rbegin()) return {};
    // Between two messages: evenly.
    const auto next = std::prev(it);
    const double share = (scan_.stamp_s - it->first) / (next->first - it->first);
    const Pose2d step = compose(inverse(it->second), next->second);
    const Pose2d at_scan = compose(it->second, Pose2d{share * step.x_m, share * step.y_m, share * step.yaw_rad});
    return compose(inverse(at_scan), T_odom_base);
  }
  if (odometry_history_.empty()) return {};
  return compose(inverse(odometry_history_.front().second), T_odom_base);
}

}  // namespace base_navigation
