// SPDX-License-Identifier: BSD-3-Clause
#include "driving/plan_attempts.h"

#include <utility>

namespace base_navigation {
namespace {

NavigationStatus statusOf(BasePlanStatus status) {
  switch (status) {
    case BasePlanStatus::kSolved:
      return NavigationStatus::kSuccess;
    case BasePlanStatus::kStartOccupied:
    case BasePlanStatus::kStartUnknown:
      return NavigationStatus::kStartBlocked;
    case BasePlanStatus::kGoalOccupied:
      return NavigationStatus::kGoalOccupied;
    case BasePlanStatus::kGoalUnknown:
      return NavigationStatus::kGoalUnknown;
    case BasePlanStatus::kNoApproach:
      return NavigationStatus::kNoApproach;
    case BasePlanStatus::kNoPath:
      return NavigationStatus::kNoPath;
    case BasePlanStatus::kIterations:
      return NavigationStatus::kIterations;
    case BasePlanStatus::kCancelled:
      return NavigationStatus::kCancelled;
  }
  return NavigationStatus::kNoPath;
}

}  // namespace

void PlanAttempts::start() {
  count_ = 0;
  has_waited_ = false;
  request("", false);
}

void PlanAttempts::request(const std::string& reason, bool is_obstacle) {
  reason_ = reason;
  is_obstacle_ = is_obstacle;
  wait_until_s_.reset();
}

std::optional<std::string> PlanAttempts::waiting(double now_s) const {
  if (!wait_until_s_ || now_s >= *wait_until_s_) return std::nullopt;
  return wait_reason_;
}

std::optional<Ending> PlanAttempts::begin() {
  wait_until_s_.reset();
  if (count_ < config_.max_plans) {
    ++count_;
    return std::nullopt;
  }
  return Ending{
      is_obstacle_ ? NavigationStatus::kObstacle : NavigationStatus::kTooManyPlans,
      "planned " + std::to_string(count_) + " times, may be " + std::to_string(config_.max_plans) + ": " + reason_};
}

std::optional<Ending> PlanAttempts::fail(const BasePlan& plan, double now_s) {
  const bool is_cancel = plan.status == BasePlanStatus::kCancelled;
  std::string message = reason_.empty() ? plan.message : reason_ + "; replanning: " + plan.message;
  if (reason_.empty() || is_cancel || has_waited_) {
    return Ending{is_obstacle_ && !is_cancel ? NavigationStatus::kObstacle : statusOf(plan.status), message};
  }
  has_waited_ = true;
  wait_until_s_ = now_s + config_.blocked_patience_s;
  wait_reason_ = std::move(message);
  return std::nullopt;
}

}  // namespace base_navigation
