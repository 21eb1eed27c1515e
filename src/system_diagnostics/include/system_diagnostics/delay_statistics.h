// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <limits>

#include <interactive_mapping_common/config/schema.h>

#include "system_diagnostics/level.h"

namespace system_diagnostics {

struct DelayStatisticsConfig {
  double window_s{10.0};  // [1, 3600] s; no field: that of the whole node
  double warn_ahead_s{0.02};
  double error_ahead_s{0.05};
  double max_delay_s{0.5};
  double timeout_s{2.0};

  static void fields(DelayStatisticsConfig& c, interactive_mapping::Fields& f) {
    f("warn_ahead_s", c.warn_ahead_s, 0.0, 10.0, "s",
      "an image that arrives this long before its stamp gives a warning: the clock of the camera is ahead");
    f("error_ahead_s", c.error_ahead_s, c.warn_ahead_s, 10.0, "s", "the same for an error; at least warn_ahead_s");
    f("max_delay_s", c.max_delay_s, 0.0, 100.0, "s", "a larger median of the delays gives a warning");
    f("timeout_s", c.timeout_s, 0.01, 1000.0, "s", "no image for this long gives an error");
  }
};

struct DelayReport {
  Verdict verdict;
  int count{0};  // in the window
  double rate_hz{0.0};
  double min_s{std::numeric_limits<double>::quiet_NaN()};
  double median_s{std::numeric_limits<double>::quiet_NaN()};
  double p95_s{std::numeric_limits<double>::quiet_NaN()};
};

/// How long after their stamp images arrive. It holds the exposure, the transport and the difference of two clocks, so
/// a late arrival proves nothing. An arrival before its stamp proves that the camera's clock is ahead by at least as
/// much.
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
