// SPDX-License-Identifier: BSD-3-Clause
#include "depth_self_filter/joint_history.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <interactive_mapping_common/formatted.h>

#include "depth_self_filter/robot_mask.h"

namespace depth_self_filter {
namespace {

using interactive_mapping::formatted;

/// Stamps that step back by less are messages out of order, not time that runs anew.
constexpr double kOutOfOrder_s = 1.0;
/// Of seconds since 1970 as doubles, 2.4e-7 s apart, and of their differences.
constexpr double kStampRounding_s = 1e-6;

/// With as many digits as it is compared by.
std::string microseconds(double value) {
  return formatted("%.6f s", value);
}

}  // namespace

JointHistory::JointHistory(std::shared_ptr<const mp700_ur5e_description::RobotModel> robot,
                           const JointHistoryConfig& config)
    : robot_(std::move(robot)), config_(config) {
  interactive_mapping::requireValid("impossible joint history:", config);
  if (!robot_) throw std::invalid_argument("no robot");
  samples_.resize(robot_->joints().size());
  for (std::size_t joint = 0; joint < samples_.size(); ++joint) is_needed_.push_back(movesShapes(*robot_, joint));
}

std::string JointHistory::add(double stamp_s, const std::vector<std::string>& names,
                              const std::vector<double>& positions_rad) {
  if (!std::isfinite(stamp_s) || stamp_s <= 0.0) {
    return formatted("joint states of stamp %.3f s, must be > 0 s", stamp_s);
  }
  if (names.size() != positions_rad.size()) {
    return "joint states have " + std::to_string(names.size()) + " names and " + std::to_string(positions_rad.size()) +
           " positions, must be as many";
  }
  struct Entry {
    std::size_t joint;
    double position_rad;
  };
  std::vector<Entry> entries;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto& joints = robot_->joints();
    const auto found =
        std::find_if(joints.begin(), joints.end(), [&](const auto& joint) { return joint.name == names[i]; });
    if (found == joints.end()) continue;  // of a gripper, say, that the URDF does not have
    const auto joint = static_cast<std::size_t>(found - joints.begin());
    if (!is_needed_[joint]) continue;
    if (!std::isfinite(positions_rad[i]))
      return "joint " + names[i] + " is at " + std::to_string(positions_rad[i]) + " rad";
    entries.push_back({joint, positions_rad[i]});
  }
  for (const Entry& entry : entries) {
    std::deque<Sample>& samples = samples_[entry.joint];
    if (!samples.empty() && stamp_s <= samples.back().stamp_s) {
      if (samples.back().stamp_s - stamp_s < kOutOfOrder_s) continue;
      samples.clear();
    }
    samples.push_back({stamp_s, entry.position_rad});
    while (stamp_s - samples.front().stamp_s > config_.memory_s) samples.pop_front();
  }
  return "";
}

JointHistory::Answer JointHistory::at(double stamp_s) const {
  Answer answer;
  answer.positions_rad = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(samples_.size()));
  // What no waiting helps against comes first, then the worst of the others.
  const auto say = [&answer](Verdict verdict, const std::string& message) {
    const auto rank = [](Verdict v) {
      switch (v) {
        case Verdict::kKnown:
          return 0;
        case Verdict::kNotYet:
          return 1;
        case Verdict::kNeverHeard:
          return 2;
        case Verdict::kGap:
          return 3;
        case Verdict::kForgotten:
          break;
      }
      return 4;
    };
    if (rank(verdict) > rank(answer.verdict)) {
      answer.verdict = verdict;
      answer.message = message;
    }
  };
  std::string never_heard;
  for (std::size_t i = 0; i < samples_.size(); ++i) {
    if (!is_needed_[i]) continue;
    const mp700_ur5e_description::RobotModel::Joint& joint = robot_->joints()[i];
    const std::deque<Sample>& samples = samples_[i];
    if (samples.empty()) {
      never_heard += (never_heard.empty() ? "" : ", ") + joint.name;
      continue;
    }
    const auto after = std::lower_bound(samples.begin(), samples.end(), stamp_s,
                                        [](const Sample& sample, double stamp) { return sample.stamp_s < stamp; });
    if (after == samples.end()) {
      say(Verdict::kNotYet, "the newest position of " + joint.name + " is " +
                                formatted("%.3f s", stamp_s - samples.back().stamp_s) +
                                " before the image, must be at or after it");
      continue;
    }
    double position_rad = after->position_rad;
    if (after->stamp_s > stamp_s) {
      if (after == samples.begin()) {
        say(Verdict::kForgotten, "the oldest position of " + joint.name + " is " +
                                     formatted("%.3f s", after->stamp_s - stamp_s) +
                                     " after the image, must be at or before it");
        continue;
      }
      const Sample& before = *(after - 1);
      const double gap_s = after->stamp_s - before.stamp_s;
      if (gap_s > config_.max_gap_s + kStampRounding_s) {
        say(Verdict::kGap, "the positions of " + joint.name + " before and after the image are " + microseconds(gap_s) +
                               " apart, must be at most " + microseconds(config_.max_gap_s) + " (max_gap_s)");
        continue;
      }
      double change_rad = after->position_rad - before.position_rad;
      // A joint without ends may be reported within one turn: it takes the shorter way.
      const bool is_endless = !std::isfinite(joint.lower_rad) && !std::isfinite(joint.upper_rad);
      if (is_endless) change_rad = std::remainder(change_rad, 2.0 * M_PI);
      position_rad = before.position_rad + change_rad * (stamp_s - before.stamp_s) / gap_s;
    }
    answer.positions_rad[static_cast<Eigen::Index>(i)] = position_rad;
  }
  if (!never_heard.empty()) say(Verdict::kNeverHeard, "no position has come of " + never_heard);
  return answer;
}

}  // namespace depth_self_filter
