// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "driving/drive_data.h"

namespace base_navigation {

/// The plans for one goal: why the base plans again, how often it may, and when a failed plan ends the goal.
class PlanAttempts {
 public:
  explicit PlanAttempts(const BaseNavigatorConfig& config) : config_(config) {}

  /// A new goal.
  void start();
  /// `reason` empty: the first plan. `is_obstacle`: the scanner saw what is in the way.
  void request(const std::string& reason, bool is_obstacle);
  /// Waits after a failed plan, with why.
  std::optional<std::string> waiting(double now_s) const;
  /// One more plan. Returns how the goal ends if there were too many; else nothing.
  std::optional<Ending> begin();
  /// The plan failed. Returns how the goal ends. Nothing: what came into the way may go again, another plan comes once
  /// after a while.
  std::optional<Ending> fail(const BasePlan& plan, double now_s);
  void succeed() { has_waited_ = false; }

  const std::string& reason() const { return reason_; }
  int count() const { return count_; }

 private:
  const BaseNavigatorConfig& config_;
  int count_{0};
  std::string reason_;
  bool is_obstacle_{false};
  bool has_waited_{false};  // since the last plan that succeeded
  std::optional<double> wait_until_s_;
  std::string wait_reason_;
};

}  // namespace base_navigation
