// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <limits>
#include <string>
#include <vector>

#include "system_diagnostics/level.h"

namespace system_diagnostics {

struct DelayStatisticsConfig {
  double window_s{10.0};
  double warn_ahead_s{0.02};  // a stamp that far in the future when it arrives: the camera's clock is ahead by more
  double error_ahead_s{0.05};
  double max_delay_s{0.5};  // median of the arrivals: warning; tf and joint states are kept for 10 s
  double timeout_s{2.0};    // no image for so long: error

  std::vector<std::string> validate() const;
};

struct DelayReport {
  Verdict verdict;
  int count{0};  // in the window
  double rate_hz{0.0};
  double min_s{std::numeric_limits<double>::quiet_NaN()};
  double median_s{std::numeric_limits<double>::quiet_NaN()};
  double p95_s{std::numeric_limits<double>::quiet_NaN()};
};

/// How long after their stamp images arrive. It holds the exposure, the transport and the difference of two clocks, so a
/// late arrival proves nothing; an arrival before its stamp proves that the camera's clock is ahead by at least as much.
class DelayStatistics {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  explicit DelayStatistics(const DelayStatisticsConfig& config);

  void add(double arrival_s, double stamp_s);
  DelayReport report(double now_s) const;
  void clear() { arrivals_.clear(); }

 private:
  struct Arrival {
    double arrival_s;
    double delay_s;
  };
  DelayStatisticsConfig config_;
  std::deque<Arrival> arrivals_;
};

}  // namespace system_diagnostics
