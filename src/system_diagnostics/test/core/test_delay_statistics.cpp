// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics/delay_statistics.h"

#include <gmock/gmock.h>

namespace system_diagnostics {
namespace {

using testing::HasSubstr;

/// Images at 10 Hz for `delays` each, the last one arriving at 0.
DelayStatistics arrivals(const std::vector<double>& delays_s, const DelayStatisticsConfig& config = {}) {
  DelayStatistics statistics(config);
  for (std::size_t i = 0; i < delays_s.size(); ++i) {
    const double arrival_s = -0.1 * static_cast<double>(delays_s.size() - 1 - i);
    statistics.add(arrival_s, arrival_s - delays_s[i]);
  }
  return statistics;
}

TEST(DelayStatistics, GivesLeastMedianAndNinetyFifthOfHundred) {
  DelayStatisticsConfig config;
  config.window_s = 100.0;
  std::vector<double> delays_s;
  for (int i = 0; i < 100; ++i) delays_s.push_back(0.001 * ((37 * i) % 100 + 1));  // 1 to 100 ms, stirred
  const DelayReport report = arrivals(delays_s, config).report(0.0);
  EXPECT_EQ(report.count, 100);
  EXPECT_NEAR(report.min_s, 0.001, 1e-9);
  EXPECT_NEAR(report.median_s, 0.050, 1e-9);
  EXPECT_NEAR(report.p95_s, 0.095, 1e-9);
  EXPECT_NEAR(report.rate_hz, 10.0, 0.2);
  EXPECT_EQ(report.verdict.level, Level::kOk);
}

TEST(DelayStatistics, StampsOfTheFutureShowThatTheClockIsAhead) {
  for (const auto& [ahead_s, level] : std::vector<std::pair<double, Level>>{
           {0.019, Level::kOk}, {0.021, Level::kWarning}, {0.049, Level::kWarning}, {0.051, Level::kError}}) {
    EXPECT_EQ(arrivals({0.04, -ahead_s, 0.04}).report(0.0).verdict.level, level) << ahead_s;
  }
  EXPECT_THAT(arrivals({-0.060, 0.04}).report(0.0).verdict.message, HasSubstr("60.0 ms before their stamp"));
}

TEST(DelayStatistics, SlowArrivalsAreAWarningByTheMedian) {
  EXPECT_EQ(arrivals({0.1, 0.1, 0.9}).report(0.0).verdict.level, Level::kOk);
  EXPECT_EQ(arrivals({0.1, 0.9, 0.9}).report(0.0).verdict.level, Level::kWarning);
}

TEST(DelayStatistics, SilenceIsAnErrorAndOldArrivalsAreForgotten) {
  EXPECT_EQ(DelayStatistics({}).report(0.0).verdict.level, Level::kError);
  const DelayStatistics statistics = arrivals({0.1, 0.1});
  EXPECT_EQ(statistics.report(1.9).verdict.level, Level::kOk);
  EXPECT_EQ(statistics.report(2.1).verdict.level, Level::kError);
  EXPECT_EQ(statistics.report(11.0).count, 0);
}

TEST(DelayStatistics, ImpossibleLimitsAreRefused) {
  DelayStatisticsConfig config;
  config.error_ahead_s = 0.01;  // below the warning
  EXPECT_THAT(interactive_mapping::problemsOf(config), testing::ElementsAre(HasSubstr("error_ahead_s = 0.01 s")));
  EXPECT_THROW(DelayStatistics{config}, std::invalid_argument);
}

}  // namespace
}  // namespace system_diagnostics
