// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/clock_gate.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

namespace simulated_world {
namespace {

void requireRule(const std::string& name, double cost_s) {
  if (name.empty()) {
    throw std::invalid_argument("clock gate: a rule without a topic or action");
  }
  if (!(cost_s >= 0.0 && cost_s <= ClockGate::kLongestCost_s)) {
    std::ostringstream message;
    message << "clock gate: cost of " << name << " = " << cost_s << " s, must be in [0, " << ClockGate::kLongestCost_s
            << "] s";
    throw std::invalid_argument(message.str());
  }
}

std::int64_t nanoseconds(double seconds) {
  return std::llround(seconds * 1e9);
}

}  // namespace

ClockGate::ClockGate(const std::vector<WaitRule>& wait_rules, const std::vector<ComputingRule>& computing_rules)
    : wait_rules_(wait_rules), answered_ns_(wait_rules.size(), std::numeric_limits<std::int64_t>::min()) {
  for (const WaitRule& rule : wait_rules) {
    requireRule(rule.topic, rule.cost_s);
  }
  for (const ComputingRule& rule : computing_rules) {
    requireRule(rule.action, rule.cost_s);
    cost_of_action_s_[rule.action] = rule.cost_s;
  }
}

bool ClockGate::isOpen(const std::string& action) const {
  const auto goals = open_.find(action);
  return goals != open_.end() && !goals->second.empty();
}

bool ClockGate::applies(const WaitRule& rule) const {
  return rule.while_action.empty() || isOpen(rule.while_action);
}

void ClockGate::published(ClockEvent event, std::int64_t stamp_ns) {
  for (std::size_t i = 0; i < wait_rules_.size(); ++i) {
    if (wait_rules_[i].after == event && applies(wait_rules_[i]) && answered_ns_[i] < stamp_ns) {
      due_.push_back({i, stamp_ns});
    }
  }
}

void ClockGate::answered(std::size_t rule, std::int64_t stamp_ns) {
  answered_ns_.at(rule) = std::max(answered_ns_.at(rule), stamp_ns);
  due_.erase(std::remove_if(due_.begin(), due_.end(),
                            [this](const Due& due) { return due.stamp_ns <= answered_ns_[due.rule]; }),
             due_.end());
}

void ClockGate::goalOpened(const std::string& action, const std::string& goal_id, std::int64_t stamp_ns) {
  if (closed_early_[action].erase(goal_id) == 0) {
    open_[action][goal_id] = stamp_ns;
  }
}

void ClockGate::goalClosed(const std::string& action, const std::string& goal_id) {
  if (open_[action].erase(goal_id) == 0) {
    closed_early_[action].insert(goal_id);
  }
  // What was due only while the action ran is due no longer.
  due_.erase(
      std::remove_if(due_.begin(), due_.end(), [this](const Due& due) { return !applies(wait_rules_[due.rule]); }),
      due_.end());
}

std::int64_t ClockGate::limitOf(const Due& due) const {
  return due.stamp_ns + nanoseconds(wait_rules_[due.rule].cost_s);
}

std::int64_t ClockGate::limit() const {
  std::int64_t limit_ns = kNoLimit;
  for (const Due& due : due_) {
    limit_ns = std::min(limit_ns, limitOf(due));
  }
  for (const auto& [action, cost_s] : cost_of_action_s_) {
    const auto goals = open_.find(action);
    if (goals == open_.end()) {
      continue;
    }
    for (const auto& [id, stamp_ns] : goals->second) {
      limit_ns = std::min(limit_ns, stamp_ns + nanoseconds(cost_s));
    }
  }
  return limit_ns;
}

std::string ClockGate::awaited() const {
  const std::int64_t limit_ns = limit();
  std::size_t first = wait_rules_.size();
  for (const Due& due : due_) {
    if (limitOf(due) == limit_ns) first = std::min(first, due.rule);
  }
  if (first < wait_rules_.size()) return wait_rules_[first].topic;
  for (const auto& [action, cost_s] : cost_of_action_s_) {
    const auto goals = open_.find(action);
    if (goals == open_.end()) continue;
    for (const auto& [id, stamp_ns] : goals->second) {
      if (stamp_ns + nanoseconds(cost_s) == limit_ns) return action;
    }
  }
  return "";
}

std::vector<std::string> ClockGate::waitingFor() const {
  std::vector<std::string> lines;
  const std::int64_t limit_ns = limit();
  if (limit_ns == kNoLimit) {
    return lines;
  }
  const auto seconds = [](std::int64_t ns) {
    std::ostringstream text;
    text << static_cast<double>(ns) * 1e-9 << " s";
    return text.str();
  };
  for (const Due& due : due_) {
    if (limitOf(due) == limit_ns) {
      lines.push_back("a message on " + wait_rules_[due.rule].topic + " that answers the " +
                      toString(wait_rules_[due.rule].after) + " of " + seconds(due.stamp_ns));
    }
  }
  for (const auto& [action, cost_s] : cost_of_action_s_) {
    const auto goals = open_.find(action);
    if (goals == open_.end()) {
      continue;
    }
    for (const auto& [id, stamp_ns] : goals->second) {
      if (stamp_ns + nanoseconds(cost_s) == limit_ns) {
        lines.push_back("the result of " + action + ", goal " + id + " of " + seconds(stamp_ns));
      }
    }
  }
  return lines;
}

std::vector<std::string> ClockGate::giveUp() {
  const std::vector<std::string> given_up = waitingFor();
  const std::int64_t limit_ns = limit();
  due_.erase(
      std::remove_if(due_.begin(), due_.end(), [this, limit_ns](const Due& due) { return limitOf(due) == limit_ns; }),
      due_.end());
  for (auto& [action, goals] : open_) {
    const auto cost = cost_of_action_s_.find(action);
    if (cost == cost_of_action_s_.end()) {
      continue;
    }
    for (auto goal = goals.begin(); goal != goals.end();) {
      goal = goal->second + nanoseconds(cost->second) == limit_ns ? goals.erase(goal) : std::next(goal);
    }
  }
  return given_up;
}

}  // namespace simulated_world
