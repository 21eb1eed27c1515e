// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics/transform_watch.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <interactive_mapping_common/formatted.h>

namespace system_diagnostics {
namespace {

using interactive_mapping::formatted;

// Before this much time has been seen, a rate is chance.
constexpr double kLeastForRate_s = 1.0;

}  // namespace

TransformWatch::TransformWatch(std::string name, const TransformWatchConfig& config)
    : name_(std::move(name)), config_(config) {
  interactive_mapping::requireValid(name_ + ": impossible limits:", config_);
}

void TransformWatch::add(double stamp_s, const Eigen::Isometry3d& pose) {
  if (has_pose_ && !is_static_ && !samples_.empty() && stamp_s <= samples_.back().stamp_s) return;
  if (!std::isfinite(stamp_s) || !pose.matrix().allFinite()) {
    is_finite_ = false;
    return;
  }
  is_finite_ = true;
  Sample sample{stamp_s, 0.0, false, 0.0, 0.0};
  if (has_pose_ && !is_static_ && !samples_.empty()) {
    sample.gap_s = stamp_s - samples_.back().stamp_s;
    const Eigen::Isometry3d moved = last_pose_.inverse() * pose;
    sample.moved_m = moved.translation().norm();
    // Of the quaternion: an AngleAxis of a matrix that is a rotation but for rounding is NaN now and then.
    sample.moved_rad = Eigen::Quaterniond(last_pose_.linear()).angularDistance(Eigen::Quaterniond(pose.linear()));
    sample.is_jump = sample.moved_m > config_.step_m + config_.speed_m_s * sample.gap_s ||
                     sample.moved_rad > config_.step_rad + config_.speed_rad_s * sample.gap_s;
    total_jumps_ += sample.is_jump;
  }
  if (std::isnan(first_stamp_s_)) first_stamp_s_ = stamp_s;
  samples_.push_back(sample);
  last_pose_ = pose;
  has_pose_ = true;
  is_static_ = false;
  forgetBefore(stamp_s - config_.window_s);
}

void TransformWatch::addStatic(const Eigen::Isometry3d& pose) {
  clear();
  is_finite_ = pose.matrix().allFinite();
  last_pose_ = pose;
  has_pose_ = true;
  is_static_ = true;
}

TransformReport TransformWatch::report(double now_s) const {
  TransformReport report;
  report.is_static = is_static_;
  report.total_jumps = total_jumps_;
  if (!is_finite_) {
    report.verdict.worsen(Level::kError, name_ + " is not finite");
    return report;
  }
  if (!has_pose_) {
    report.verdict.worsen(Level::kError, "tf has no " + name_);
    return report;
  }
  if (is_static_) {
    report.verdict.worsen(config_.may_be_static ? Level::kOk : Level::kWarning,
                          config_.may_be_static ? "fixed" : name_ + " is fixed: nothing corrects it");
    return report;
  }
  report.age_s = now_s - samples_.back().stamp_s;
  int count = 0;
  for (const Sample& sample : samples_) {
    if (sample.stamp_s <= now_s - config_.window_s) continue;
    ++count;
    report.longest_gap_s = std::max(report.longest_gap_s, sample.gap_s);
    if (!sample.is_jump) continue;
    ++report.jumps;
    report.largest_jump_m = std::max(report.largest_jump_m, sample.moved_m);
    report.largest_jump_rad = std::max(report.largest_jump_rad, sample.moved_rad);
  }
  // A gap that has not ended counts as well.
  report.longest_gap_s = std::max(report.longest_gap_s, report.age_s);
  // By stamps up to now; of those ahead of now up to the newest.
  const double end_s = std::max(now_s, samples_.back().stamp_s);
  const double seen_s = end_s - first_stamp_s_;
  const bool is_young = seen_s < config_.window_s;
  report.rate_hz = is_young ? (seen_s > 0.0 ? (count - 1) / seen_s : 0.0) : count / (end_s - now_s + config_.window_s);

  Verdict& verdict = report.verdict;
  if (report.age_s > config_.max_age_s) {
    verdict.worsen(Level::kError, name_ + " is " + formatted("%.2f", report.age_s) + " s old, must be at most " +
                                      formatted("%.2f", config_.max_age_s) + " s");
  }
  if (-report.age_s > config_.max_ahead_s) {
    verdict.worsen(Level::kWarning, name_ + " is stamped " + formatted("%.3f", -report.age_s) +
                                        " s ahead of the clock, must be at most " +
                                        formatted("%.3f", config_.max_ahead_s) + " s");
  }
  if (seen_s >= kLeastForRate_s && report.rate_hz < config_.min_rate_hz) {
    verdict.worsen(Level::kWarning, name_ + " comes at " + formatted("%.1f", report.rate_hz) +
                                        " Hz, must be at least " + formatted("%.1f", config_.min_rate_hz) + " Hz");
  }
  if (report.longest_gap_s > config_.max_gap_s) {
    verdict.worsen(Level::kWarning, name_ + " was missing for " + formatted("%.2f", report.longest_gap_s) + " s");
  }
  if (report.jumps > 0) {
    verdict.worsen(Level::kWarning, name_ + " jumped " + std::to_string(report.jumps) + " time(s), by up to " +
                                        formatted("%.3f", report.largest_jump_m) + " m, " +
                                        formatted("%.3f", report.largest_jump_rad) + " rad");
  }
  verdict.worsen(Level::kOk, "comes steadily");
  return report;
}

void TransformWatch::clear() {
  samples_.clear();
  first_stamp_s_ = std::numeric_limits<double>::quiet_NaN();
  last_pose_ = Eigen::Isometry3d::Identity();
  has_pose_ = false;
  is_static_ = false;
  is_finite_ = true;
}

void TransformWatch::forgetBefore(double stamp_s) {
  while (samples_.size() > 1 && samples_.front().stamp_s < stamp_s) samples_.pop_front();
}

}  // namespace system_diagnostics
