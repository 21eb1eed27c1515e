// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics/delay_statistics.h"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace system_diagnostics {
namespace {

std::string milliseconds(double seconds) {
  std::ostringstream stream;
  stream.setf(std::ios::fixed);
  stream.precision(1);
  stream << 1e3 * seconds << " ms";
  return stream.str();
}

/// Nearest rank: the least value that is not below `share` of them.
double quantile(const std::vector<double>& sorted, double share) {
  const double rank = std::ceil(share * static_cast<double>(sorted.size()));
  return sorted[static_cast<std::size_t>(std::max(rank, 1.0)) - 1];
}

}  // namespace

DelayStatistics::DelayStatistics(const DelayStatisticsConfig& config) : config_(config) {
  interactive_mapping::requireValid("impossible limits of delays:", config_);
}

void DelayStatistics::add(double arrival_s, double stamp_s) {
  if (!std::isfinite(arrival_s) || !std::isfinite(stamp_s)) return;
  arrivals_.push_back({arrival_s, arrival_s - stamp_s});
  while (arrivals_.front().arrival_s < arrival_s - config_.window_s) arrivals_.pop_front();
}

DelayReport DelayStatistics::report(double now_s) const {
  DelayReport report;
  if (arrivals_.empty()) {
    report.verdict.worsen(Level::kError, "no image yet");
    return report;
  }
  std::vector<double> delays;
  for (const Arrival& arrival : arrivals_) {
    if (arrival.arrival_s >= now_s - config_.window_s) delays.push_back(arrival.delay_s);
  }
  const double silence_s = now_s - arrivals_.back().arrival_s;
  if (silence_s > config_.timeout_s) {
    std::ostringstream text;
    text << "no image for " << silence_s << " s";
    report.verdict.worsen(Level::kError, text.str());
  }
  report.count = static_cast<int>(delays.size());
  if (delays.empty()) return report;
  const double span_s = now_s - std::max(arrivals_.front().arrival_s, now_s - config_.window_s);
  report.rate_hz = span_s > 0.0 ? static_cast<double>(delays.size()) / span_s : 0.0;
  std::sort(delays.begin(), delays.end());
  report.min_s = delays.front();
  report.median_s = quantile(delays, 0.5);
  report.p95_s = quantile(delays, 0.95);

  if (report.min_s < -config_.warn_ahead_s) {
    report.verdict.worsen(report.min_s < -config_.error_ahead_s ? Level::kError : Level::kWarning,
                          "images arrive " + milliseconds(-report.min_s) +
                              " before their stamp: the camera's clock is ahead by at least that");
  }
  if (report.median_s > config_.max_delay_s) {
    report.verdict.worsen(Level::kWarning, "images arrive " + milliseconds(report.median_s) +
                                               " after their stamp: slow, or the camera's clock is behind");
  }
  report.verdict.worsen(Level::kOk, "images arrive " + milliseconds(report.median_s) + " after their stamp");
  return report;
}

}  // namespace system_diagnostics
