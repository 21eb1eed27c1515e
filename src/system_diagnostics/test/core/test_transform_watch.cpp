// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics/transform_watch.h"

#include <cmath>
#include <limits>

#include <gmock/gmock.h>

namespace system_diagnostics {
namespace {

using testing::HasSubstr;

constexpr double kStart_s = 100.0;

Eigen::Isometry3d pose(double x_m, double yaw_rad = 0.0) {
  return Eigen::Translation3d(x_m, 0.0, 0.0) * Eigen::Isometry3d(Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()));
}

/// Poses every 1/rate from kStart_s to the end, standing still.
TransformWatch steady(double rate_hz, double duration_s, const TransformWatchConfig& config = {}) {
  TransformWatch watch("a -> b", config);
  const int count = static_cast<int>(std::lround(duration_s * rate_hz));
  for (int i = 0; i <= count; ++i) watch.add(kStart_s + i / rate_hz, pose(1.0));
  return watch;
}

TEST(TransformWatch, SteadyPosesAreAllRightWithTheirRateAndAge) {
  const TransformReport report = steady(20.0, 30.0).report(kStart_s + 30.01);
  EXPECT_EQ(report.verdict.level, Level::kOk) << report.verdict.message;
  EXPECT_NEAR(report.rate_hz, 20.0, 0.2);  // one pose more or less in the window of 10 s is 0.1 Hz
  EXPECT_NEAR(report.age_s, 0.01, 1e-9);
  EXPECT_NEAR(report.longest_gap_s, 0.05, 1e-9);
  EXPECT_EQ(report.jumps, 0);
}

TEST(TransformWatch, RateIsRightBeforeTheWindowIsFull) {
  EXPECT_NEAR(steady(20.0, 2.0).report(kStart_s + 2.0).rate_hz, 20.0, 1e-6);
}

TEST(TransformWatch, WhatWasNeverThereIsAnError) {
  const TransformReport report = TransformWatch("map -> odom", {}).report(kStart_s);
  EXPECT_EQ(report.verdict.level, Level::kError);
  EXPECT_THAT(report.verdict.message, HasSubstr("tf has no map -> odom"));
}

TEST(TransformWatch, WhatIsTooOldIsAnErrorThatSaysHowOld) {
  const TransformReport report = steady(20.0, 5.0).report(kStart_s + 6.0);
  EXPECT_EQ(report.verdict.level, Level::kError);
  EXPECT_THAT(report.verdict.message, HasSubstr("1.00 s old, must be at most 0.50 s"));
  EXPECT_EQ(steady(20.0, 5.0).report(kStart_s + 5.49).verdict.level, Level::kOk);
}

TEST(TransformWatch, WhatIsSlowIsAWarning) {
  const TransformReport report = steady(4.0, 20.0).report(kStart_s + 20.0);
  EXPECT_EQ(report.verdict.level, Level::kWarning);
  EXPECT_THAT(report.verdict.message, HasSubstr("4.0 Hz, must be at least 5.0 Hz"));
}

TEST(TransformWatch, AGapIsToldUntilItLeavesTheWindow) {
  TransformWatch watch = steady(20.0, 5.0);
  for (int i = 0; i < 190; ++i) watch.add(kStart_s + 5.75 + i * 0.05, pose(1.0));  // up to 15.2 s
  const TransformReport fresh = watch.report(kStart_s + 15.2);
  EXPECT_EQ(fresh.verdict.level, Level::kWarning);
  EXPECT_NEAR(fresh.longest_gap_s, 0.75, 1e-9);
  for (int i = 190; i < 220; ++i) watch.add(kStart_s + 5.75 + i * 0.05, pose(1.0));
  EXPECT_EQ(watch.report(kStart_s + 16.7).verdict.level, Level::kOk);
}

TEST(TransformWatch, AStampFromTheFutureIsAWarning) {
  const TransformReport report = steady(20.0, 5.0).report(kStart_s + 4.9);
  EXPECT_EQ(report.verdict.level, Level::kWarning);
  EXPECT_THAT(report.verdict.message, HasSubstr("0.100 s ahead of the clock"));
  EXPECT_NEAR(report.rate_hz, 20.0, 0.5);
}

TEST(TransformWatch, AStepFartherThanAllowedIsAJumpInLengthOrAngle) {
  TransformWatchConfig config;
  config.step_m = 0.05;
  config.step_rad = 0.1;
  for (const auto& [moved, jumps] : std::vector<std::pair<Eigen::Isometry3d, int>>{
           {pose(1.049), 0}, {pose(1.051), 1}, {pose(1.0, 0.099), 0}, {pose(1.0, -0.101), 1}}) {
    TransformWatch watch = steady(20.0, 5.0, config);
    watch.add(kStart_s + 5.05, moved);
    const TransformReport report = watch.report(kStart_s + 5.05);
    EXPECT_EQ(report.jumps, jumps);
    EXPECT_EQ(report.total_jumps, jumps);
    EXPECT_EQ(report.verdict.level, jumps > 0 ? Level::kWarning : Level::kOk);
  }
}

TEST(TransformWatch, TheSizeOfAJumpDoesNotDependOnWhereTheFramesAre) {
  const Eigen::Isometry3d far = Eigen::Translation3d(100.0, -50.0, 3.0) *
                                Eigen::Isometry3d(Eigen::AngleAxisd(2.0, Eigen::Vector3d(1, 2, 3).normalized()));
  TransformWatch watch("a -> b", {});
  watch.add(kStart_s, far);
  watch.add(kStart_s + 0.05, far * pose(0.3, 0.4));
  const TransformReport report = watch.report(kStart_s + 0.05);
  EXPECT_NEAR(report.largest_jump_m, 0.3, 1e-9);
  EXPECT_NEAR(report.largest_jump_rad, 0.4, 1e-9);
}

TEST(TransformWatch, WhatMovesAsFastAsItMayDoesNotJump) {
  TransformWatchConfig config;
  config.step_m = 0.01;
  config.speed_m_s = 1.5;
  for (const double speed_m_s : {1.5, 2.0}) {
    TransformWatch watch("a -> b", config);
    // 2 m/s at 20 Hz: 0.1 m a step, allowed are 0.01 + 0.075.
    for (int i = 0; i <= 100; ++i) watch.add(kStart_s + i * 0.05, pose(speed_m_s * i * 0.05));
    EXPECT_EQ(watch.report(kStart_s + 5.0).jumps, speed_m_s > 1.7 ? 100 : 0);
  }
}

TEST(TransformWatch, JumpsLeaveTheWindowButStayInTheSum) {
  TransformWatch watch = steady(20.0, 5.0);
  for (int i = 1; i <= 190; ++i) watch.add(kStart_s + 5.0 + i * 0.05, pose(2.0));
  EXPECT_EQ(watch.report(kStart_s + 14.5).jumps, 1);
  for (int i = 191; i <= 300; ++i) watch.add(kStart_s + 5.0 + i * 0.05, pose(2.0));
  EXPECT_EQ(watch.report(kStart_s + 20.0).jumps, 0);
  EXPECT_EQ(watch.report(kStart_s + 20.0).total_jumps, 1);
}

TEST(TransformWatch, WhatIsFixedIsAllRightOnlyWhereItMayBe) {
  TransformWatchConfig config;
  TransformWatch corrected("map -> odom", config);
  corrected.addStatic(pose(0.0));
  EXPECT_EQ(corrected.report(kStart_s).verdict.level, Level::kWarning);
  EXPECT_THAT(corrected.report(kStart_s).verdict.message, HasSubstr("nothing corrects it"));
  config.may_be_static = true;
  TransformWatch mounted("base_link -> camera", config);
  mounted.addStatic(pose(0.0));
  EXPECT_EQ(mounted.report(kStart_s).verdict.level, Level::kOk);
}

TEST(TransformWatch, StampsAgainAreNotNewAndNothingIsComparedWithThem) {
  TransformWatch watch = steady(20.0, 5.0);
  watch.add(kStart_s + 5.0, pose(9.0));
  watch.add(kStart_s + 4.0, pose(9.0));
  EXPECT_EQ(watch.report(kStart_s + 5.0).jumps, 0);
}

TEST(TransformWatch, AfterClearItBeginsAnew) {
  TransformWatch watch = steady(20.0, 5.0);
  watch.clear();
  EXPECT_EQ(watch.report(kStart_s + 5.0).verdict.level, Level::kError);
  watch.add(1.0, pose(9.0));
  EXPECT_EQ(watch.report(1.0).jumps, 0);
  EXPECT_EQ(watch.report(1.0).verdict.level, Level::kOk);
}

TEST(TransformWatch, APoseThatIsNotFiniteIsAnErrorUntilTheNext) {
  TransformWatch watch = steady(20.0, 5.0);
  watch.add(kStart_s + 5.05, pose(std::numeric_limits<double>::quiet_NaN()));
  EXPECT_EQ(watch.report(kStart_s + 5.05).verdict.level, Level::kError);
  watch.add(kStart_s + 5.10, pose(1.0));
  EXPECT_EQ(watch.report(kStart_s + 5.10).verdict.level, Level::kOk);
}

TEST(TransformWatch, ImpossibleLimitsAreRefusedTogether) {
  TransformWatchConfig config;
  config.max_age_s = 0.0;
  config.step_m = -1.0;
  EXPECT_THAT(interactive_mapping::problemsOf(config),
              testing::ElementsAre(HasSubstr("max_age_s = 0 s"), HasSubstr("step_m = -1 m")));
  EXPECT_THROW(TransformWatch("a", config), std::invalid_argument);
}

}  // namespace
}  // namespace system_diagnostics
