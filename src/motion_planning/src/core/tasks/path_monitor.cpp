// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/path_monitor.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <utility>

#include <interactive_mapping_common/formatted.h>

#include "kinematics/arm_reach.h"

namespace motion_planning {
namespace {

using interactive_mapping::formatted;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kCoarse_s = 0.4;  // between the first looks at clearance
constexpr int kMaxLooks = 40;      // at clearance in one check: each costs about a millisecond, and 10 Hz must be kept

/// Clearance at one time.
struct Look {
  double time_s;
  ArmVector joints_rad;
  double clearance_m;
};

/// Looks from begin to end, more densely where the smallest clearance may be, by bisection. No point moves farther than
/// reach * |dq| between two postures, so between two looks the clearance is at least the mean of theirs minus half of that.
std::vector<Look> lookAlong(const std::function<Look(double)>& look, double begin_s, double end_s,
                            const ArmVector& reach_m, const PathMonitorConfig& config) {
  std::vector<Look> looks;
  const int parts = std::max(1, static_cast<int>(std::ceil(std::min((end_s - begin_s) / kCoarse_s, 0.5 * kMaxLooks))));
  for (int k = 0; k <= parts; ++k) looks.push_back(look(begin_s + (end_s - begin_s) * k / parts));
  const auto lowerBound = [&](const Look& a, const Look& b) {
    return 0.5 * (a.clearance_m + b.clearance_m - reach_m.dot((b.joints_rad - a.joints_rad).cwiseAbs()));
  };
  while (static_cast<int>(looks.size()) < kMaxLooks) {
    double smallest_m = kMaxClearance_m;
    for (const Look& one : looks) smallest_m = std::min(smallest_m, one.clearance_m);
    std::size_t worst = 0;
    double worst_m = kInfinity;
    for (std::size_t k = 0; k + 1 < looks.size(); ++k) {
      const double bound_m = lowerBound(looks[k], looks[k + 1]);
      if (bound_m >= worst_m || looks[k + 1].time_s - looks[k].time_s < config.sample_s) continue;
      worst_m = bound_m;
      worst = k;
    }
    if (worst_m > smallest_m - config.clearance_step_m) break;
    looks.insert(looks.begin() + static_cast<std::ptrdiff_t>(worst) + 1,
                 look(0.5 * (looks[worst].time_s + looks[worst + 1].time_s)));
  }
  return looks;
}

}  // namespace

std::vector<ArmVector> firstPostures(const ArmKinematics& arm, const JointTrajectory& trajectory) {
  if (trajectory.empty()) throw std::invalid_argument("trajectory has 0 points, must have at least 1");
  constexpr double kSample_s = 0.05;
  std::vector<ArmVector> postures = {trajectory.points.front().position_rad};
  const Eigen::Vector3d from = arm.tipPose(postures.front()).translation();
  for (double t = kSample_s; t <= trajectory.duration(); t += kSample_s) {
    postures.push_back(trajectory.sample(t).position_rad);
    if ((arm.tipPose(postures.back()).translation() - from).norm() > kAmongOthers_m) break;
  }
  return postures;
}

WatchCheckers watchCheckers(std::shared_ptr<const ArmKinematics> arm, std::shared_ptr<const CollisionScene> scene,
                            const Eigen::Isometry3d& T_map_base, const CollisionCheckerConfig& config,
                            const Watched& watched) {
  const ArmVector& start_rad = watched.first_rad.at(0);
  CollisionChecker hanging(std::move(arm), std::move(scene), T_map_base, config);
  if (watched.held) hanging.setHeld(watched.held, false);
  if (watched.target) {
    hanging.setTarget(watched.target);
  } else if (watched.held) {
    hanging.setTarget(watched.vacated, true);
  }
  hanging.freeUnknownAt(start_rad);
  hanging.yieldToRobotAt(start_rad);
  if (watched.held) hanging.yieldToSurfaceAt(start_rad);
  WatchCheckers checkers{hanging, std::nullopt};
  if (watched.held) {
    checkers.from_start.setHeldAt(*watched.held, watched.first_rad);
    if (!watched.target) checkers.beyond.emplace(hanging);
  } else if (!checkers.from_start.yieldToMagnetAt(start_rad)) {
    checkers.from_start.yieldToSurfaceAt(start_rad);
  }
  return checkers;
}

PathMonitor::PathMonitor(const PathMonitorConfig& config) : config_(config) {
  interactive_mapping::requireValid("impossible path monitor:", config);
}

void PathMonitor::start(JointTrajectory trajectory, std::shared_ptr<const ArmKinematics> arm) {
  if (trajectory.empty()) throw std::invalid_argument("trajectory has 0 points, must have at least 1");
  if (!arm) throw std::invalid_argument("no arm");
  trajectory_ = std::move(trajectory);
  arm_ = std::move(arm);
  stopped_.reset();
}

void PathMonitor::stop() {
  trajectory_.reset();
  stopped_.reset();
}

PathVerdict PathMonitor::check(double elapsed_s, const CollisionChecker& checker, const CollisionChecker* beyond) {
  if (!trajectory_) throw std::logic_error("no trajectory is watched");
  if (stopped_) return *stopped_;
  if (!std::isfinite(elapsed_s)) throw std::invalid_argument("elapsed_s is not finite");
  const double duration_s = trajectory_->duration();
  const double begin_s = std::clamp(elapsed_s, 0.0, duration_s);
  const double end_s = std::min(duration_s, begin_s + config_.horizon_s);

  PathVerdict verdict;
  verdict.time_to_contact_s = kInfinity;
  // Every state up to the first that is in the way: the stop must know how soon.
  double time_s = begin_s;
  const auto contactAt = [&](const ArmVector& q) {
    const Contact contact = checker.check(q);
    return contact && beyond != nullptr && beyond->isFree(q) ? Contact() : contact;
  };
  ArmVector last = trajectory_->sample(begin_s).position_rad;
  verdict.contact = contactAt(last);
  while (!verdict.contact && time_s < end_s) {
    double step_s = std::min(config_.sample_s, end_s - time_s);
    ArmVector next = trajectory_->sample(time_s + step_s).position_rad;
    while ((next - last).lpNorm<Eigen::Infinity>() > config_.sample_rad && step_s > 1e-6) {
      step_s *= 0.5;
      next = trajectory_->sample(time_s + step_s).position_rad;
    }
    time_s = end_s - time_s <= step_s ? end_s : time_s + step_s;
    last = next;
    verdict.contact = contactAt(last);
  }
  if (verdict.contact) {
    verdict.must_stop = true;
    verdict.time_to_contact_s = time_s - begin_s;
    verdict.reason = "in " + formatted("%.2f s", verdict.time_to_contact_s) + ": " + verdict.contact.describe();
    verdict.clearance_m = checker.clearance(last, kMaxClearance_m);
    stopped_ = verdict;
    return verdict;
  }

  const auto look = [&](double t) {
    const ArmVector q = trajectory_->sample(t).position_rad;
    const double clearance_m = checker.clearance(q, kMaxClearance_m);
    return Look{t, q, beyond == nullptr ? clearance_m : std::max(clearance_m, beyond->clearance(q, kMaxClearance_m))};
  };
  const std::vector<Look> looks = lookAlong(look, begin_s, end_s, armReach(*arm_, checker.held()), config_);
  const auto nearest = std::min_element(looks.begin(), looks.end(),
                                        [](const Look& a, const Look& b) { return a.clearance_m < b.clearance_m; });
  verdict.clearance_m = nearest->clearance_m;
  if (verdict.clearance_m >= config_.stop_clearance_m) return verdict;
  const auto first = std::find_if(looks.begin(), looks.end(),
                                  [&](const Look& one) { return one.clearance_m < config_.stop_clearance_m; });
  verdict.must_stop = true;
  verdict.time_to_contact_s = first->time_s - begin_s;
  std::ostringstream reason;
  reason << "in " << formatted("%.2f s", verdict.time_to_contact_s) << ": clearance of " << first->clearance_m
         << " m, allowed are " << config_.stop_clearance_m << " m";
  verdict.reason = reason.str();
  stopped_ = verdict;
  return verdict;
}

}  // namespace motion_planning
