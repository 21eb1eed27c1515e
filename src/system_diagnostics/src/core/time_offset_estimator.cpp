// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics/time_offset_estimator.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace system_diagnostics {
namespace {

constexpr double kMaxOdometryGap_s = 0.2;  // pairs of images beside a longer gap are left out
constexpr double kMaxImageGap_s = 0.5;     // images farther apart are no pair
constexpr double kStep_s = 0.005;          // of the search; the peak of the correlation is wider by far
constexpr double kShiftNoise_px =
    0.05;  // phase correlation is hardly better than this: smaller residuals are no outliers
constexpr double kOutlier_sigmas = 4.0;  // one in 16000 of normal ones
constexpr double kMadToSigma = 1.4826;   // of a normal distribution
constexpr int kFitted = 3;               // factor, mean, offset

/// s = mean + factor (p - mean of p), and how well.
struct Fit {
  double correlation{0.0};
  double factor{0.0};
  double mean_turn{0.0};
  double mean_shift{0.0};
};

Fit fit(const std::vector<double>& turns, const std::vector<double>& shifts) {
  const auto n = static_cast<double>(turns.size());
  Fit result;
  for (std::size_t i = 0; i < turns.size(); ++i) {
    result.mean_turn += turns[i] / n;
    result.mean_shift += shifts[i] / n;
  }
  double tt = 0.0, ss = 0.0, ts = 0.0;
  for (std::size_t i = 0; i < turns.size(); ++i) {
    const double t = turns[i] - result.mean_turn, s = shifts[i] - result.mean_shift;
    tt += t * t;
    ss += s * s;
    ts += t * s;
  }
  if (tt > 0.0 && ss > 0.0) {
    result.correlation = ts / std::sqrt(tt * ss);
    result.factor = ts / tt;
  }
  return result;
}

}  // namespace

TimeOffsetEstimator::TimeOffsetEstimator(const TimeOffsetConfig& config) : config_(config) {
  interactive_mapping::requireValid("impossible time offset estimator:", config_);
}

void TimeOffsetEstimator::addYaw(double stamp_s, double yaw_rad) {
  if (!std::isfinite(stamp_s) || !std::isfinite(yaw_rad)) return;
  if (!yaws_.empty()) {
    if (stamp_s <= yaws_.back().stamp_s) return;
    yaw_rad = yaws_.back().yaw_rad + std::remainder(yaw_rad - yaws_.back().yaw_rad, 2.0 * M_PI);
  }
  yaws_.push_back({stamp_s, yaw_rad});
  const double needed_s = stamp_s - config_.window_s - 2.0 * kMaxOffset_s - kMaxImageGap_s;
  while (yaws_.front().stamp_s < needed_s) yaws_.pop_front();
}

void TimeOffsetEstimator::addShift(double start_stamp_s, double end_stamp_s, double shift_px) {
  if (!std::isfinite(start_stamp_s) || !std::isfinite(end_stamp_s) || !std::isfinite(shift_px)) return;
  if (!(end_stamp_s > start_stamp_s) || end_stamp_s - start_stamp_s > kMaxImageGap_s) return;
  shifts_.push_back({start_stamp_s, end_stamp_s, shift_px});
  while (shifts_.front().end_s < end_stamp_s - config_.window_s) shifts_.pop_front();
}

std::vector<TimeOffsetEstimator::Shift> TimeOffsetEstimator::coveredShifts() const {
  std::vector<Shift> covered;
  for (const Shift& shift : shifts_) {
    if (isCovered(shift.start_s - kMaxOffset_s, shift.end_s + kMaxOffset_s)) covered.push_back(shift);
  }
  return covered;
}

std::vector<double> TimeOffsetEstimator::turnsAt(double offset_s, const std::vector<Shift>& used) const {
  std::vector<double> turns;
  turns.reserve(used.size());
  for (const Shift& shift : used) turns.push_back(yawAt(shift.end_s - offset_s) - yawAt(shift.start_s - offset_s));
  return turns;
}

std::vector<double> TimeOffsetEstimator::pixelsOf(const std::vector<Shift>& used) {
  std::vector<double> shifts;
  shifts.reserve(used.size());
  for (const Shift& shift : used) shifts.push_back(shift.shift_px);
  return shifts;
}

TimeOffsetEstimator::Peak TimeOffsetEstimator::findPeak(const std::vector<Shift>& used) const {
  const int steps = static_cast<int>(std::floor(kMaxOffset_s / kStep_s));
  const std::vector<double> shifts = pixelsOf(used);
  std::vector<double> correlations;
  for (int step = -steps; step <= steps; ++step) {
    correlations.push_back(fit(turnsAt(step * kStep_s, used), shifts).correlation);
  }
  const auto peak = std::max_element(correlations.begin(), correlations.end());
  const bool is_at_end = peak == correlations.begin() || peak + 1 == correlations.end();
  double offset_s = kStep_s * (static_cast<double>(peak - correlations.begin()) - steps);
  if (!is_at_end) {  // top of the parabola through the three highest
    const double before = *(peak - 1), after = *(peak + 1);
    const double bend = before - 2.0 * *peak + after;
    if (bend < 0.0) offset_s += 0.5 * kStep_s * (before - after) / bend;
  }
  return {offset_s, is_at_end};
}

std::vector<TimeOffsetEstimator::Shift> TimeOffsetEstimator::withoutOutliers(const std::vector<Shift>& used,
                                                                             double offset_s) const {
  const std::vector<double> turns = turnsAt(offset_s, used);
  const Fit line = fit(turns, pixelsOf(used));
  std::vector<double> residuals;
  for (std::size_t i = 0; i < used.size(); ++i) {
    residuals.push_back(std::abs(used[i].shift_px - line.mean_shift - line.factor * (turns[i] - line.mean_turn)));
  }
  std::vector<double> sorted = residuals;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2), sorted.end());
  const double limit_px = kOutlier_sigmas * std::max(kShiftNoise_px, kMadToSigma * sorted[sorted.size() / 2]);
  std::vector<Shift> kept;
  for (std::size_t i = 0; i < used.size(); ++i) {
    if (residuals[i] <= limit_px) kept.push_back(used[i]);
  }
  return kept;
}

double TimeOffsetEstimator::stdOf(double offset_s, const std::vector<Shift>& used) const {
  const std::vector<double> turns = turnsAt(offset_s, used);
  const Fit line = fit(turns, pixelsOf(used));
  const std::vector<double> before = turnsAt(offset_s - kStep_s, used), after = turnsAt(offset_s + kStep_s, used);
  std::vector<double> slopes;
  for (std::size_t i = 0; i < used.size(); ++i) slopes.push_back((after[i] - before[i]) / (2.0 * kStep_s));
  const Fit explained = fit(turns, slopes);
  double squares = 0.0, leverage = 0.0;
  for (std::size_t i = 0; i < used.size(); ++i) {
    const double turn = turns[i] - line.mean_turn;
    const double residual = used[i].shift_px - line.mean_shift - line.factor * turn;
    const double change = line.factor * (slopes[i] - explained.mean_shift - explained.factor * turn);
    squares += residual * residual;
    leverage += change * change;
  }
  const int freedoms = std::max(1, static_cast<int>(used.size()) - kFitted);
  const double variance = std::max(squares / freedoms, kShiftNoise_px * kShiftNoise_px);
  return leverage > 0.0 ? std::sqrt(variance / leverage) : std::numeric_limits<double>::infinity();
}

TimeOffsetEstimate TimeOffsetEstimator::estimate() const {
  TimeOffsetEstimate result;
  const auto end = [&result](TimeOffsetStatus status) {
    result.status = status;
    return result;
  };
  std::vector<Shift> used = coveredShifts();
  result.images = static_cast<int>(used.size());
  if (result.images < config_.min_images) return result;
  for (const double turn : turnsAt(0.0, used)) result.turned_rad += std::abs(turn);
  if (result.turned_rad < kMinTurn_rad) return end(TimeOffsetStatus::kTooLittleTurning);

  Peak peak = findPeak(used);
  std::vector<Shift> kept = withoutOutliers(used, peak.offset_s);
  if (kept.size() < used.size() && static_cast<int>(kept.size()) >= config_.min_images) {
    used = std::move(kept);
    peak = findPeak(used);
  }
  result.images = static_cast<int>(used.size());
  result.correlation = fit(turnsAt(peak.offset_s, used), pixelsOf(used)).correlation;
  if (result.correlation < config_.min_correlation) return end(TimeOffsetStatus::kNoCorrelation);
  if (peak.is_at_end) return end(TimeOffsetStatus::kBeyondRange);
  result.std_s = stdOf(peak.offset_s, used);
  if (!(result.std_s <= kMaxOffsetStd_s)) return end(TimeOffsetStatus::kTooUncertain);
  result.offset_s = peak.offset_s;
  return end(TimeOffsetStatus::kEstimated);
}

void TimeOffsetEstimator::clear() {
  yaws_.clear();
  shifts_.clear();
}

bool TimeOffsetEstimator::isCovered(double from_s, double to_s) const {
  if (yaws_.empty() || yaws_.front().stamp_s > from_s || yaws_.back().stamp_s < to_s) return false;
  auto next = std::upper_bound(yaws_.begin(), yaws_.end(), from_s,
                               [](double stamp_s, const Yaw& yaw) { return stamp_s < yaw.stamp_s; });
  for (; next != yaws_.end(); ++next) {
    if (next->stamp_s - (next - 1)->stamp_s > kMaxOdometryGap_s) return false;
    if (next->stamp_s >= to_s) return true;
  }
  return true;
}

double TimeOffsetEstimator::yawAt(double stamp_s) const {
  const auto next = std::upper_bound(yaws_.begin(), yaws_.end(), stamp_s,
                                     [](double stamp, const Yaw& yaw) { return stamp < yaw.stamp_s; });
  if (next == yaws_.begin()) return yaws_.front().yaw_rad;
  if (next == yaws_.end()) return yaws_.back().yaw_rad;
  const Yaw& before = *(next - 1);
  const double share = (stamp_s - before.stamp_s) / (next->stamp_s - before.stamp_s);
  return before.yaw_rad + share * (next->yaw_rad - before.yaw_rad);
}

}  // namespace system_diagnostics
