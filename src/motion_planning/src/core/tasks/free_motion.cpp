// SPDX-License-Identifier: BSD-3-Clause
#include "tasks/free_motion.h"

#include <algorithm>
#include <optional>
#include <random>
#include <string>
#include <utility>

#include "kinematics/arm_reach.h"
#include "tasks/failures.h"
#include "tasks/straight_line.h"

namespace motion_planning {
namespace {

constexpr int kPlanAttempts = 3;  // finer each time, if a path turns out to graze something
constexpr int kRoundings = 4;     // half the deviation each time, the last time practically none

/// Whether the path is valid, its corners rounded, at points between which no point of the arm moves farther than
/// search/verify_step_m.
bool isValidRounded(const JointPath& path, const ArmVector& reach_m, double step_m, const TimingConfig& timing,
                    const std::function<bool(const ArmVector&)>& is_valid) {
  const JointPath dense = roundedPath(path, step_m / reach_m.sum(), timing);
  const ArmVector* checked = &dense.front();
  for (std::size_t i = 1; i < dense.size(); ++i) {
    const bool is_last = i + 1 == dense.size();
    if (!is_last && reach_m.dot((dense[i + 1] - *checked).cwiseAbs()) <= step_m) continue;
    if (!is_valid(dense[i])) return false;
    checked = &dense[i];
  }
  return true;
}

/// Rounds the path's corners as far as that stays valid, and times it. None: it is not valid even with sharp corners.
std::optional<JointTrajectory> timed(const TaskContext& task, const JointPath& path, const ArmVector& reach_m,
                                     const std::function<bool(const ArmVector&)>& is_valid) {
  TimingConfig timing = task.config.timing;
  for (int round = 0; round < kRoundings; ++round) {
    if (round + 1 == kRoundings) timing.max_deviation_rad = std::min(timing.max_deviation_rad, kLineDeviation_rad);
    if (isValidRounded(path, reach_m, task.config.check.verify_step_m, timing, is_valid)) {
      return timeParametrize(path, task.limits, timing);
    }
    if (task.isCancelled()) return std::nullopt;
    timing.max_deviation_rad = std::max(1e-6, 0.5 * timing.max_deviation_rad);
  }
  return std::nullopt;
}

/// What is in the way about a posture.
std::string surroundings(const ArmVector& posture, const CollisionChecker& checker) {
  constexpr int kNear = 200;
  constexpr double kNear_rad = 0.3;
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> offset_rad(-kNear_rad, kNear_rad);
  Rejections rejections;
  for (int k = 0; k < kNear; ++k) {
    ArmVector q = posture;
    for (double& angle_rad : q) angle_rad += offset_rad(rng);
    if (const Contact contact = checker.check(q)) rejections.add(contact);
  }
  return "of " + std::to_string(kNear) + " postures " +
         (rejections.empty() ? "none is in collision" : rejections.describe());
}

PlanFailure noPath(const JointPlanResult& result, const ArmVector& start, const std::vector<ArmVector>& goals,
                   const CollisionChecker& checker, const std::string& what) {
  switch (result.status) {
    case JointPlanStatus::kStartInvalid:
      return {PlanStatus::kStartInCollision,
              what + ": the motion's start is in collision: " + checker.check(start).describe()};
    case JointPlanStatus::kGoalInvalid:
      return {PlanStatus::kGoalInCollision,
              what + ": the motion's end is in collision: " + checker.check(goals.front()).describe()};
    case JointPlanStatus::kCancelled:
      return cancelled();
    default:
      return {PlanStatus::kIterations, what + ": no path to any of " + std::to_string(goals.size()) + " goals in " +
                                           std::to_string(result.iterations) + " iterations; about its start " +
                                           surroundings(start, checker) + "; about the first goal " +
                                           surroundings(goals.front(), checker)};
  }
}

}  // namespace

Result<FreeMotion> moveTo(const TaskContext& task, const ArmVector& start, const std::vector<ArmVector>& goals,
                          const CollisionChecker& checker, const Tilt& tilt, const std::string& what) {
  JointSpace space;
  space.lower_rad = task.arm.limits().lower_rad.array() - kLimitTolerance_rad;
  space.upper_rad = task.arm.limits().upper_rad.array() + kLimitTolerance_rad;
  double planned_tilt_rad = 0.0;
  if (tilt) {
    // Start and goals may use up the reserve.
    planned_tilt_rad = std::max(tilt->max_tilt_rad - kTiltReserve_rad, tiltOf(task.arm, *tilt, start));
    for (const ArmVector& goal : goals) planned_tilt_rad = std::max(planned_tilt_rad, tiltOf(task.arm, *tilt, goal));
    std::vector<ArmVector> references(goals.size() + 1, start);  // as often the start as a goal
    references.insert(references.end(), goals.begin(), goals.end());
    space.sample = tiltSampler(task.arm, *tilt, std::move(references));
  }
  const double max_tilt_rad = tilt ? std::max(tilt->max_tilt_rad, planned_tilt_rad) : 0.0;
  const auto validWithin = [&](double tilt_rad) {
    return [&, tilt_rad](const ArmVector& q) {
      return (!tilt || tiltOf(task.arm, *tilt, q) <= tilt_rad) && checker.isFree(q);
    };
  };
  space.is_valid = validWithin(planned_tilt_rad);
  const ArmVector reach_m = armReach(task.arm, checker.held());
  JointPlannerConfig planner = task.config.planner;
  planner.seed = seedOf(task);
  for (int attempt = 0; attempt < kPlanAttempts; ++attempt) {
    const JointPlanResult result = planJointPath(space, start, goals, planner, task.request.is_cancelled);
    if (result.status != JointPlanStatus::kSolved) return noPath(result, start, goals, checker, what);
    if (auto trajectory = timed(task, result.path, reach_m, validWithin(max_tilt_rad))) {
      return FreeMotion{std::move(*trajectory), result.goal};
    }
    if (task.isCancelled()) return cancelled();
    ++planner.seed;
    planner.check_step_rad = std::max(1e-4, 0.5 * planner.check_step_rad);
  }
  return PlanFailure{PlanStatus::kIterations, what + ": " + std::to_string(kPlanAttempts) +
                                                  " paths found, each too near to something between its states"};
}

}  // namespace motion_planning
