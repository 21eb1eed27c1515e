// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/contact_detector.h"

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>

namespace ur_driver_bridge {
namespace {

using Kind = ContactDetector::Kind;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kStart_s = 1.7e9;  // as ROS time is on a robot
constexpr double kPeriod_s = 0.01;  // 100 Hz
constexpr double kNoise_N = 1.5;    // sigma of the e-Series' force

Stamped<ToolForce> sample(double stamp_s, double z_N, double x_N = 0.0, double y_N = 0.0) {
  Stamped<ToolForce> result;
  result.stamp_s = stamp_s;
  result.value.force_N = {x_N, y_N, z_N};
  return result;
}

class ContactDetectorTest : public ::testing::Test {
 protected:
  /// One more sample, a period later, with noise on all axes.
  const ContactDetector::Contact& addNoisy(double z_N) {
    now_s_ += kPeriod_s;
    return detector_.add(sample(now_s_, z_N + noise_(random_), noise_(random_), noise_(random_)));
  }
  const ContactDetector::Contact& addExact(double z_N, double x_N = 0.0, double y_N = 0.0) {
    now_s_ += kPeriod_s;
    return detector_.add(sample(now_s_, z_N, x_N, y_N));
  }

  ContactDetector detector_{ContactDetectorConfig{}};
  std::mt19937_64 random_{11};
  std::normal_distribution<double> noise_{0.0, kNoise_N};
  double now_s_{kStart_s};
};

TEST_F(ContactDetectorTest, NoiseAloneIsNoContact) {
  for (int n = 0; n < 100000; ++n) ASSERT_EQ(addNoisy(0.0).kind, Kind::kNone) << n;
}

TEST_F(ContactDetectorTest, InertiaThatPassesIsNoContact) {
  // The tool of about 1 kg, braked at up to 3 m/s^2 on the way, plus what the sensor drifts: bumps of half a second
  // below the threshold, noise on top.
  for (int n = 0; n < 20000; ++n) {
    const double bump_N = 3.0 * std::max(0.0, std::sin(2.0 * M_PI * n * kPeriod_s));
    ASSERT_EQ(addNoisy(bump_N).kind, Kind::kNone) << n;
  }
}

TEST_F(ContactDetectorTest, KnocksShorterThanTheDebounceAreNoContact) {
  for (int n = 0; n < 1000; ++n) {
    EXPECT_EQ(addExact(30.0).kind, Kind::kNone);
    EXPECT_EQ(addExact(-30.0).kind, Kind::kNone) << "two samples are 10 ms above";
    EXPECT_EQ(addExact(0.0).kind, Kind::kNone);
  }
}

TEST_F(ContactDetectorTest, StepIsKnownWithinDebounceAndOneSample) {
  const ContactDetectorConfig config;
  for (int n = 0; n < 1000; ++n) {
    detector_ = ContactDetector(ContactDetectorConfig());
    for (int k = 0; k < 20; ++k) ASSERT_EQ(addNoisy(0.0).kind, Kind::kNone);
    const double contact_s = now_s_ + 0.5 * kPeriod_s;  // between two samples
    int samples = 0;
    // 15 N pushes the tool back along its axis: 4.7 sigma above the threshold.
    while (addNoisy(-15.0).kind == Kind::kNone && samples < 100) ++samples;
    const double delay_s = now_s_ - contact_s;
    EXPECT_LE(delay_s, config.debounce_s + kPeriod_s + 1e-6);
    EXPECT_EQ(detector_.contact().kind, Kind::kAxial);
    EXPECT_NEAR(detector_.contact().since_s, contact_s + 0.5 * kPeriod_s, 1e-6) << "the first sample above";
    EXPECT_NEAR(detector_.contact().force_N, 15.0, 5.0 * kNoise_N);
  }
}

TEST_F(ContactDetectorTest, PullCountsAsPushDoes) {
  for (int k = 0; k < 2; ++k) EXPECT_EQ(addExact(9.0).kind, Kind::kNone);
  EXPECT_EQ(addExact(9.0).kind, Kind::kAxial);
  EXPECT_EQ(detector_.contact().force_N, 9.0);
}

TEST_F(ContactDetectorTest, ThresholdItselfIsNotAbove) {
  for (int k = 0; k < 100; ++k) EXPECT_EQ(addExact(-8.0).kind, Kind::kNone);
  for (int k = 0; k < 3; ++k) addExact(-8.001);
  EXPECT_EQ(detector_.contact().kind, Kind::kAxial);
}

TEST_F(ContactDetectorTest, OneSampleBelowBeginsTheDebounceAnew) {
  addExact(-20.0);
  addExact(-20.0);
  addExact(-5.0);
  addExact(-20.0);
  EXPECT_EQ(addExact(-20.0).kind, Kind::kNone);
  EXPECT_EQ(addExact(-20.0).kind, Kind::kAxial);
}

TEST_F(ContactDetectorTest, SampleThatIsNotFiniteBeginsTheDebounceAnew) {
  addExact(-20.0);
  addExact(-20.0);
  addExact(kNaN);
  addExact(-20.0);
  EXPECT_EQ(addExact(-20.0).kind, Kind::kNone);
  EXPECT_EQ(addExact(-20.0).kind, Kind::kAxial);
  for (int axis = 0; axis < 3; ++axis) {
    detector_ = ContactDetector(ContactDetectorConfig());
    Stamped<ToolForce> broken = sample(now_s_ += kPeriod_s, -100.0, 100.0, 100.0);
    broken.value.force_N[axis] = kNaN;
    EXPECT_EQ(detector_.add(broken).kind, Kind::kNone);
  }
}

TEST_F(ContactDetectorTest, MissingSamplesDoNotHideAContact) {
  addExact(-20.0);
  now_s_ += 0.2;
  EXPECT_EQ(addExact(-20.0).kind, Kind::kAxial);
}

TEST_F(ContactDetectorTest, HardContactIsKnownAtOnce) {
  EXPECT_EQ(addExact(-59.9).kind, Kind::kNone);
  detector_ = ContactDetector(ContactDetectorConfig());
  EXPECT_EQ(addExact(-60.1).kind, Kind::kAxial);
  EXPECT_EQ(detector_.contact().force_N, 60.1);
  EXPECT_EQ(detector_.contact().since_s, now_s_);
}

TEST_F(ContactDetectorTest, ForceAcrossIsKnownAtOnceAndAsSuch) {
  EXPECT_EQ(addExact(0.0, 28.0, 28.0).kind, Kind::kNone);  // 39.6 N
  EXPECT_EQ(addExact(-100.0, 30.0, -30.0).kind, Kind::kSideways);
  EXPECT_NEAR(detector_.contact().force_N, std::sqrt(1800.0), 1e-9);
  EXPECT_EQ(detector_.contact().since_s, now_s_);
}

TEST_F(ContactDetectorTest, ContactStays) {
  for (int k = 0; k < 3; ++k) addExact(-20.0);
  const double since_s = detector_.contact().since_s;
  addExact(0.0);
  addExact(-100.0, 100.0);
  EXPECT_EQ(detector_.contact().kind, Kind::kAxial);
  EXPECT_EQ(detector_.contact().force_N, 20.0);
  EXPECT_EQ(detector_.contact().since_s, since_s);
}

TEST_F(ContactDetectorTest, SamplesThatAreNotNewerAreIgnored) {
  detector_.add(sample(kStart_s, -20.0));
  EXPECT_EQ(detector_.add(sample(kStart_s, -100.0)).kind, Kind::kNone);
  EXPECT_EQ(detector_.add(sample(kStart_s - 1.0, -100.0)).kind, Kind::kNone);
  EXPECT_EQ(detector_.add(sample(kNaN, -100.0)).kind, Kind::kNone);
  // An old one from below does not end the debounce.
  detector_.add(sample(kStart_s - 1.0, 0.0));
  EXPECT_EQ(detector_.add(sample(kStart_s + 0.02, -20.0)).kind, Kind::kAxial);
  EXPECT_EQ(detector_.contact().since_s, kStart_s);
}

TEST_F(ContactDetectorTest, WithoutDebounceOneSampleIsEnough) {
  ContactDetectorConfig config;
  config.debounce_s = 0.0;
  ContactDetector detector(config);
  EXPECT_EQ(detector.add(sample(kStart_s, -8.1)).kind, Kind::kAxial);
}

TEST(ContactDetectorConfig, HardContactIsAboveTheThreshold) {
  ContactDetectorConfig config;
  config.hard_N = 5.0;
  EXPECT_THAT(interactive_mapping::problemsOf(config), ::testing::ElementsAre("hard_N = 5 N, must be in [8, 500] N"));
  EXPECT_THROW(ContactDetector{config}, std::invalid_argument);
}

}  // namespace
}  // namespace ur_driver_bridge
