// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics/time_offset_estimator.h"

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>

namespace system_diagnostics {
namespace {

using testing::HasSubstr;

/// A base that turns to and fro as a driver lets it: ramps of 0.6 rad/s^2 up to 0.6 rad/s, rests between. Exact at every time.
struct Drive {
  double rest_s{1.0};
  double hold_s{1.0};
  double rate_rad_s{0.6};
  double ramp_rad_s2{0.6};

  double yaw(double time_s) const {
    const double ramp_s = rate_rad_s / ramp_rad_s2, turn_s = 2.0 * ramp_s + hold_s, period_s = 2.0 * (turn_s + rest_s);
    double in_period = std::fmod(time_s, period_s);
    if (in_period < 0.0) in_period += period_s;
    const bool is_back = in_period >= 0.5 * period_s;
    const double t = is_back ? in_period - 0.5 * period_s : in_period;
    const double whole = rate_rad_s * (ramp_s + hold_s);
    double turned = whole;
    if (t < ramp_s) {
      turned = 0.5 * ramp_rad_s2 * t * t;
    } else if (t < ramp_s + hold_s) {
      turned = 0.5 * rate_rad_s * ramp_s + rate_rad_s * (t - ramp_s);
    } else if (t < turn_s) {
      const double left = turn_s - t;
      turned = whole - 0.5 * ramp_rad_s2 * left * left;
    }
    return is_back ? whole - turned : turned;
  }
};

struct Rig {
  double offset_s{0.0};  // stamps of images are late by this
  double odometry_hz{50.0};
  double camera_hz{10.0};
  double px_per_rad{130.0};  // of a 640 x 480 image with 525 px focal length, made 160 px wide
  double noise_px{0.2};
  double duration_s{60.0};
  unsigned seed{7};
};

TimeOffsetEstimator record(const Rig& rig, const Drive& drive = {}, const TimeOffsetConfig& config = {}) {
  TimeOffsetEstimator estimator(config);
  for (int i = 0; i <= rig.duration_s * rig.odometry_hz; ++i) {
    const double time_s = i / rig.odometry_hz;
    estimator.addYaw(time_s, std::remainder(drive.yaw(time_s), 2.0 * M_PI));
  }
  std::mt19937 engine(rig.seed);
  std::normal_distribution<double> noise(0.0, rig.noise_px);
  for (int i = 1; i <= rig.duration_s * rig.camera_hz; ++i) {
    const double taken_before_s = (i - 1) / rig.camera_hz, taken_s = i / rig.camera_hz;
    const double shift_px = rig.px_per_rad * (drive.yaw(taken_s) - drive.yaw(taken_before_s)) + noise(engine);
    estimator.addShift(taken_before_s + rig.offset_s, taken_s + rig.offset_s, shift_px);
  }
  return estimator;
}

TEST(TimeOffsetEstimator, FindsOffsetsOfEitherSignAtEveryRate) {
  for (const double offset_s : {-0.15, -0.05, -0.012, 0.0, 0.003, 0.02, 0.05, 0.15}) {
    for (const double camera_hz : {5.0, 10.0, 30.0}) {
      Rig rig;
      rig.offset_s = offset_s;
      rig.camera_hz = camera_hz;
      const TimeOffsetEstimate estimate = record(rig).estimate();
      ASSERT_EQ(estimate.status, TimeOffsetStatus::kEstimated) << offset_s << " s at " << camera_hz << " Hz";
      // 4 standard deviations as the estimator itself states them, and those are below 3 ms (the next test: they are true).
      EXPECT_NEAR(estimate.offset_s, offset_s, 4.0 * estimate.std_s) << camera_hz << " Hz";
      EXPECT_LT(estimate.std_s, 0.003);
      EXPECT_GT(estimate.correlation, 0.9);
    }
  }
}

TEST(TimeOffsetEstimator, ItsStandardDeviationIsThatOfItsErrors) {
  double squares = 0.0, stated = 0.0;
  constexpr int kRuns = 60;
  for (int run = 0; run < kRuns; ++run) {
    Rig rig;
    rig.offset_s = 0.03;
    rig.noise_px = 0.5;
    rig.seed = 100 + static_cast<unsigned>(run);
    const TimeOffsetEstimate estimate = record(rig).estimate();
    ASSERT_EQ(estimate.status, TimeOffsetStatus::kEstimated);
    squares += std::pow(estimate.offset_s - rig.offset_s, 2);
    stated += estimate.std_s / kRuns;
  }
  // The spread of 60 errors is itself known to 9 %: 3 of that, and the parabola's own error.
  EXPECT_NEAR(std::sqrt(squares / kRuns) / stated, 1.0, 0.35);
}

TEST(TimeOffsetEstimator, WithoutNoiseItIsExactToAMillisecond) {
  Rig rig;
  rig.noise_px = 0.0;
  rig.offset_s = 0.0373;  // between the steps of the search
  // Odometry is read off at 50 Hz and interpolated: its corners are cut by up to 0.6 / 8 / 50^2 rad.
  EXPECT_NEAR(record(rig).estimate().offset_s, 0.0373, 0.001);
}

TEST(TimeOffsetEstimator, DoesNotDependOnHowManyPixelsARadianIs) {
  for (const double px_per_rad : {30.0, 600.0}) {
    Rig rig;
    rig.offset_s = 0.04;
    rig.px_per_rad = px_per_rad;
    rig.noise_px = 0.0;
    EXPECT_NEAR(record(rig).estimate().offset_s, 0.04, 0.001);
  }
}

TEST(TimeOffsetEstimator, ABaseThatStandsGivesNoEstimate) {
  Drive drive;
  drive.rate_rad_s = 1e-9;
  const TimeOffsetEstimate estimate = record(Rig{}, drive).estimate();
  EXPECT_EQ(estimate.status, TimeOffsetStatus::kTooLittleTurning);
  EXPECT_TRUE(std::isnan(estimate.offset_s));
}

TEST(TimeOffsetEstimator, AShortTurnGivesNoEstimate) {
  Rig rig;
  rig.duration_s = 2.0;                                                       // 0.9 rad
  EXPECT_EQ(record(rig).estimate().status, TimeOffsetStatus::kTooFewImages);  // 0.2 s at both ends are not covered
  rig.camera_hz = 30.0;
  EXPECT_EQ(record(rig).estimate().status, TimeOffsetStatus::kTooLittleTurning);
}

TEST(TimeOffsetEstimator, ASteadyTurnFitsEveryOffsetAndGivesNone) {
  Drive drive;
  drive.hold_s = 1e4;
  TimeOffsetEstimator estimator({});
  std::mt19937 engine(3);
  std::normal_distribution<double> noise(0.0, 0.2);
  for (int i = 0; i <= 3000; ++i) estimator.addYaw(10.0 + i / 50.0, drive.yaw(10.0 + i / 50.0));
  for (int i = 1; i <= 600; ++i) {
    estimator.addShift(10.0 + (i - 1) / 10.0, 10.0 + i / 10.0, 130.0 * 0.06 + noise(engine));
  }
  const TimeOffsetEstimate estimate = estimator.estimate();
  EXPECT_NE(estimate.status, TimeOffsetStatus::kEstimated);
  EXPECT_TRUE(std::isnan(estimate.offset_s));
  EXPECT_GT(estimate.turned_rad, 30.0);
}

TEST(TimeOffsetEstimator, ShiftsThatHaveNothingToDoWithTheTurnGiveNoEstimate) {
  Rig rig;
  rig.px_per_rad = 0.0;
  rig.noise_px = 3.0;
  EXPECT_EQ(record(rig).estimate().status, TimeOffsetStatus::kNoCorrelation);
  rig.px_per_rad = -130.0;  // a camera that hangs upside down
  rig.noise_px = 0.2;
  EXPECT_EQ(record(rig).estimate().status, TimeOffsetStatus::kNoCorrelation);
}

TEST(TimeOffsetEstimator, AnOffsetBeyondTheRangeIsNotMadeUp) {
  Rig rig;
  rig.offset_s = 0.35;
  const TimeOffsetEstimate estimate = record(rig).estimate();
  EXPECT_EQ(estimate.status, TimeOffsetStatus::kBeyondRange);
  EXPECT_TRUE(std::isnan(estimate.offset_s));
}

TEST(TimeOffsetEstimator, NoiseThatHidesTheOffsetIsAdmitted) {
  Rig rig;
  rig.duration_s = 8.0;
  rig.noise_px = 2.0;
  const TimeOffsetEstimate estimate = record(rig).estimate();
  EXPECT_EQ(estimate.status, TimeOffsetStatus::kTooUncertain);
  EXPECT_GT(estimate.std_s, 0.01);
}

TEST(TimeOffsetEstimator, GapsInOdometryAndImagesDoNotDisturb) {
  Rig rig;
  rig.offset_s = 0.05;
  const Drive drive;
  TimeOffsetEstimator estimator({});
  for (int i = 0; i <= 3000; ++i) {
    const double time_s = i / 50.0;
    // While it turns, so that a straight line across the gap would be wrong.
    if (time_s > 4.3 && time_s < 5.6) continue;
    estimator.addYaw(time_s, drive.yaw(time_s));
  }
  for (int i = 1; i <= 600; ++i) {
    if (i % 50 == 7) continue;
    estimator.addShift((i - 1) / 10.0 + 0.05, i / 10.0 + 0.05,
                       130.0 * (drive.yaw(i / 10.0) - drive.yaw((i - 1) / 10.0)));
  }
  const TimeOffsetEstimate estimate = estimator.estimate();
  ASSERT_EQ(estimate.status, TimeOffsetStatus::kEstimated);
  EXPECT_NEAR(estimate.offset_s, 0.05, 0.001);
  EXPECT_LT(estimate.images, 600 - 12 - 13);
}

TEST(TimeOffsetEstimator, WrongShiftsAmongRightOnesAreLeftOut) {
  Rig rig;
  rig.offset_s = 0.03;
  const Drive drive;
  TimeOffsetEstimator estimator = record(rig);
  for (int i = 0; i < 40; ++i) {  // one in fifteen, within the time of the others
    const double time_s = 10.0 + i + rig.offset_s;
    estimator.addShift(time_s, time_s + 0.1, i % 2 == 0 ? 40.0 : -35.0);
  }
  const TimeOffsetEstimate estimate = estimator.estimate();
  ASSERT_EQ(estimate.status, TimeOffsetStatus::kEstimated);
  EXPECT_NEAR(estimate.offset_s, 0.03, 4.0 * estimate.std_s);
  EXPECT_LE(estimate.images, 600 - 1);
}

TEST(TimeOffsetEstimator, WhatIsOlderThanTheWindowIsForgotten) {
  TimeOffsetConfig config;
  config.window_s = 20.0;
  Rig before, after;
  const Drive drive;
  TimeOffsetEstimator estimator(config);
  for (int i = 0; i <= 4000; ++i) estimator.addYaw(i / 50.0, drive.yaw(i / 50.0));
  for (int i = 1; i <= 800; ++i) {  // the clock is set at 40 s
    const double offset_s = i <= 400 ? 0.08 : 0.0;
    estimator.addShift((i - 1) / 10.0 + offset_s, i / 10.0 + offset_s,
                       130.0 * (drive.yaw(i / 10.0) - drive.yaw((i - 1) / 10.0)));
  }
  EXPECT_NEAR(estimator.estimate().offset_s, 0.0, 0.001);
}

TEST(TimeOffsetEstimator, BadValuesAreLeftOutAndImpossibleLimitsRefused) {
  TimeOffsetEstimator estimator = record(Rig{});
  const TimeOffsetEstimate before = estimator.estimate();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  estimator.addYaw(nan, 1.0);
  estimator.addYaw(30.0, 2.0);  // in the past
  estimator.addShift(20.0, 20.1, nan);
  estimator.addShift(20.1, 20.0, 3.0);
  estimator.addShift(20.0, 25.0, 3.0);
  EXPECT_EQ(estimator.estimate().offset_s, before.offset_s);
  estimator.clear();
  EXPECT_EQ(estimator.estimate().images, 0);
  TimeOffsetConfig config;
  config.window_s = -1.0;
  config.min_correlation = 2.0;
  EXPECT_THAT(interactive_mapping::problemsOf(config),
              testing::ElementsAre(HasSubstr("window_s = -1 s"), HasSubstr("min_correlation = 2")));
  EXPECT_THROW(TimeOffsetEstimator{config}, std::invalid_argument);
}

}  // namespace
}  // namespace system_diagnostics
