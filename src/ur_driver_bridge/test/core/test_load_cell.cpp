// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/load_cell.h"

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>

namespace ur_driver_bridge {
namespace {

using ::testing::HasSubstr;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kStart_s = 1.7e9;  // as ROS time is on a robot
constexpr double kPeriod_s = 0.01;  // 100 Hz
constexpr double kNoise_N = 1.5;    // sigma of the e-Series' force
constexpr double kBrick_kg = 1.2;

class LoadCellTest : public ::testing::Test {
 protected:
  Eigen::Matrix3d anyOrientation() {
    return Eigen::Quaterniond(normal_(random_), normal_(random_), normal_(random_), normal_(random_))
        .normalized()
        .toRotationMatrix();
  }
  /// A sample with this mass beside what the robot compensates, in world axes the weight plus `extra_N`.
  void add(double mass_kg, const Eigen::Matrix3d& R_world_tool = Eigen::Matrix3d::Identity(), double noise_N = 0.0,
           const Eigen::Vector3d& extra_N = Eigen::Vector3d::Zero()) {
    now_s_ += kPeriod_s;
    Stamped<ToolForce> sample;
    sample.stamp_s = now_s_;
    const Eigen::Vector3d force_world_N = Eigen::Vector3d(0.0, 0.0, -mass_kg * 9.81) + extra_N;
    sample.value.force_N = R_world_tool.transpose() * force_world_N;
    for (int i = 0; i < 3; ++i) sample.value.force_N[i] += noise_N * normal_(random_);
    cell_.add(sample, R_world_tool);
  }
  void addFor(double duration_s, double mass_kg, double noise_N = 0.0) {
    for (int k = 0; k < std::lround(duration_s / kPeriod_s); ++k) {
      add(mass_kg, Eigen::Matrix3d::Identity(), noise_N);
    }
  }
  /// From hold on, how long a loss lasts until it is known.
  double timeToLoss(double mass_kg, double noise_N) {
    const double begin_s = now_s_;
    while (!cell_.isLost() && now_s_ < begin_s + 2.0) add(mass_kg, Eigen::Matrix3d::Identity(), noise_N);
    return now_s_ - begin_s;
  }

  LoadCell cell_{LoadCellConfig{}};
  std::mt19937_64 random_{5};
  std::normal_distribution<double> normal_{0.0, 1.0};
  double now_s_{kStart_s};
};

TEST_F(LoadCellTest, WeighsExactlyInAnyOrientation) {
  for (int n = 0; n < 200; ++n) {
    const double mass_kg = 0.1 + 0.02 * n;
    const double from_s = now_s_;
    const Eigen::Matrix3d R_world_tool = anyOrientation();
    for (int k = 0; k < 40; ++k) add(mass_kg, R_world_tool, 0.0, {5.0, -3.0, 0.0});  // forces across do not weigh
    const auto weight = cell_.weigh(from_s);
    ASSERT_TRUE(weight.has_value());
    EXPECT_NEAR(weight->mass_kg, mass_kg, 1e-12);
    EXPECT_NEAR(weight->spread_N, 0.0, 1e-9);
  }
}

TEST_F(LoadCellTest, WeighsWhileTheToolTurns) {
  const double from_s = now_s_;
  for (int k = 0; k < 40; ++k) {
    add(kBrick_kg, Eigen::AngleAxisd(0.1 * k, Eigen::Vector3d(1.0, 2.0, 3.0).normalized()).toRotationMatrix());
  }
  ASSERT_TRUE(cell_.weigh(from_s).has_value());
  EXPECT_NEAR(cell_.weigh(from_s)->mass_kg, kBrick_kg, 1e-12);
}

TEST_F(LoadCellTest, NoiseAveragesOut) {
  for (int n = 0; n < 100; ++n) {
    const double from_s = now_s_;
    const Eigen::Matrix3d R_world_tool = anyOrientation();
    for (int k = 0; k < 40; ++k) add(kBrick_kg, R_world_tool, kNoise_N);
    std::string why;
    const auto weight = cell_.weigh(from_s, &why);
    ASSERT_TRUE(weight.has_value()) << why;
    EXPECT_EQ(weight->samples, 31);
    // Five standard deviations of the mean of 31 samples; of the spread, about sigma / sqrt(60).
    EXPECT_NEAR(weight->mass_kg, kBrick_kg, 5.0 * kNoise_N / std::sqrt(31.0) / 9.81);
    EXPECT_NEAR(weight->spread_N, kNoise_N, 5.0 * kNoise_N / std::sqrt(60.0));
  }
}

TEST_F(LoadCellTest, SpreadIsTheSamplesStandardDeviation) {
  const double from_s = now_s_;
  for (int k = 0; k < 31; ++k) add(0.0, Eigen::Matrix3d::Identity(), 0.0, {0.0, 0.0, k % 2 == 0 ? 1.0 : -1.0});
  // 16 times 1, 15 times -1: mean 1/31, sum of squares 31 - 1/31.
  const auto weight = cell_.weigh(from_s);
  ASSERT_TRUE(weight.has_value());
  EXPECT_NEAR(weight->spread_N, std::sqrt((31.0 - 1.0 / 31.0) / 30.0), 1e-9);
  EXPECT_NEAR(weight->mass_kg, -1.0 / 31.0 / 9.81, 1e-9);
}

TEST_F(LoadCellTest, WeighsOnlySinceTheGivenTime) {
  addFor(1.0, 3.0);
  const double from_s = now_s_ + 1e-3;
  addFor(0.3, kBrick_kg);
  std::string why;
  EXPECT_FALSE(cell_.weigh(from_s, &why).has_value()) << "30 samples are 0.29 s";
  EXPECT_THAT(why, HasSubstr("0.29 s, needed are 0.3 s"));
  addFor(0.01, kBrick_kg);
  const auto weight = cell_.weigh(from_s, &why);
  ASSERT_TRUE(weight.has_value()) << why;
  EXPECT_NEAR(weight->mass_kg, kBrick_kg, 1e-12);
  addFor(0.5, 2.0);
  EXPECT_NEAR(cell_.weigh(from_s)->mass_kg, 2.0, 1e-12) << "of the newest";
}

TEST_F(LoadCellTest, SaysWhyItDoesNotWeigh) {
  std::string why;
  EXPECT_FALSE(cell_.weigh(kStart_s, &why).has_value());
  EXPECT_THAT(why, HasSubstr("no force"));
  for (int k = 0; k < 5; ++k) {  // too few, over a long time
    now_s_ += 0.09;
    add(kBrick_kg);
  }
  EXPECT_FALSE(cell_.weigh(kStart_s, &why).has_value());
  EXPECT_THAT(why, HasSubstr("samples of the force in 0.3 s, needed are 10"));
  const double from_s = now_s_;
  for (int k = 0; k < 40; ++k) add(kBrick_kg, Eigen::Matrix3d::Identity(), 0.0, {0.0, 0.0, k % 2 == 0 ? 5.0 : -5.0});
  EXPECT_FALSE(cell_.weigh(from_s, &why).has_value());
  EXPECT_THAT(why, HasSubstr("scatters by 5."));
  EXPECT_THAT(why, HasSubstr("allowed 3 N"));
  EXPECT_FALSE(cell_.weigh(now_s_ + 1.0).has_value()) << "nothing since, and nobody asks why";
  EXPECT_THROW(cell_.weigh(kNaN), std::invalid_argument);
}

TEST_F(LoadCellTest, SamplesThatAreNoneAreIgnored) {
  addFor(0.3, kBrick_kg);
  Stamped<ToolForce> broken;
  broken.stamp_s = now_s_ + 0.001;
  broken.value.force_N = {0.0, kNaN, -100.0};
  cell_.add(broken, Eigen::Matrix3d::Identity());
  broken.value.force_N = {0.0, 0.0, -100.0};
  cell_.add(broken, Eigen::Matrix3d::Constant(kNaN));
  broken.stamp_s = kNaN;
  cell_.add(broken, Eigen::Matrix3d::Identity());
  broken.stamp_s = now_s_;
  cell_.add(broken, Eigen::Matrix3d::Identity());
  broken.stamp_s = now_s_ - 0.005;
  cell_.add(broken, Eigen::Matrix3d::Identity());
  addFor(0.01, kBrick_kg);
  const auto weight = cell_.weigh(kStart_s);
  ASSERT_TRUE(weight.has_value());
  EXPECT_EQ(weight->samples, 31);
  EXPECT_NEAR(weight->mass_kg, kBrick_kg, 1e-12);
}

TEST_F(LoadCellTest, LoadIsTheMedianOfTheLastWhile) {
  EXPECT_FALSE(cell_.load().has_value());
  add(1.0);
  add(2.0);
  EXPECT_NEAR(*cell_.load(), 1.5, 1e-12);
  addFor(0.5, 2.0);
  EXPECT_NEAR(*cell_.load(), 2.0, 1e-12);
  addFor(0.05, 0.0);  // five of eleven samples
  EXPECT_NEAR(*cell_.load(), 2.0, 1e-12);
  addFor(0.02, 0.0);
  EXPECT_NEAR(*cell_.load(), 0.0, 1e-12);
}

TEST_F(LoadCellTest, BrickThatStaysIsNotLostInAMinuteOfNoise) {
  addFor(0.5, 0.0, kNoise_N);
  cell_.hold(kBrick_kg, kBrick_kg, *cell_.weigh(kStart_s));
  for (int k = 0; k < 6000; ++k) {
    add(0.0, Eigen::Matrix3d::Identity(), kNoise_N);
    ASSERT_FALSE(cell_.isLost()) << k;
  }
}

TEST_F(LoadCellTest, LostBrickIsKnownWhenItHasBeenGoneForSoLong) {
  const LoadCellConfig config;
  for (const bool is_compensated : {false, true}) {
    for (const double noise_N : {0.0, kNoise_N}) {
      for (int n = 0; n < 100; ++n) {
        SCOPED_TRACE(std::to_string(is_compensated) + " " + std::to_string(noise_N));
        const double before_kg = is_compensated ? 0.0 : kBrick_kg;
        cell_.release();
        const double from_s = now_s_;
        addFor(0.5, before_kg, noise_N);
        std::string why;
        const auto reference = cell_.weigh(from_s, &why);
        ASSERT_TRUE(reference.has_value()) << why;
        cell_.hold(kBrick_kg, kBrick_kg, *reference);
        addFor(0.5, before_kg, noise_N);
        ASSERT_FALSE(cell_.isLost());
        const double known_s = timeToLoss(before_kg - kBrick_kg, noise_N);
        // Of samples within noise some are on the wrong side of the half: these shift the median by a few samples.
        const double slack_s = noise_N > 0.0 ? 0.02 : 1e-6;
        EXPECT_GE(known_s, config.lost_s - slack_s);
        EXPECT_LE(known_s, config.lost_s + kPeriod_s + slack_s);
      }
    }
  }
}

TEST_F(LoadCellTest, ShakeOf50MillisecondsIsNoLoss) {
  for (int n = 0; n < 200; ++n) {
    cell_.release();
    const double from_s = now_s_;
    addFor(0.5, 0.0, kNoise_N);
    cell_.hold(kBrick_kg, kBrick_kg, *cell_.weigh(from_s));
    addFor(0.3, 0.0, kNoise_N);
    for (int k = 0; k < 5; ++k) {  // 40 N up, then as much down: the arm has been knocked
      add(0.0, Eigen::Matrix3d::Identity(), kNoise_N, {0.0, 0.0, 40.0});
      ASSERT_FALSE(cell_.isLost());
    }
    for (int k = 0; k < 30; ++k) {
      add(0.0, Eigen::Matrix3d::Identity(), kNoise_N, {0.0, 0.0, k < 5 ? -40.0 : 0.0});
      ASSERT_FALSE(cell_.isLost());
    }
  }
}

TEST_F(LoadCellTest, ShakeRightAfterHoldIsNoLoss) {
  addFor(0.5, 0.0);
  cell_.hold(kBrick_kg, kBrick_kg, *cell_.weigh(kStart_s));
  for (int k = 0; k < 30; ++k) {
    add(k < 7 ? -kBrick_kg : 0.0);
    ASSERT_FALSE(cell_.isLost());
  }
}

TEST_F(LoadCellTest, LossRightAfterHoldIsKnownToo) {
  addFor(0.5, 0.0);
  cell_.hold(kBrick_kg, kBrick_kg, *cell_.weigh(kStart_s));
  addFor(0.09, -kBrick_kg);
  EXPECT_FALSE(cell_.isLost()) << "no samples for so long";
  addFor(0.02, -kBrick_kg);
  EXPECT_TRUE(cell_.isLost());
}

TEST_F(LoadCellTest, LostIsAShareOfTheBricksWeight) {
  addFor(0.5, 0.3);
  cell_.hold(2.0, 2.0, *cell_.weigh(kStart_s));
  addFor(0.5, 0.3 - 0.98);
  EXPECT_FALSE(cell_.isLost());
  addFor(0.5, 0.3 - 1.02);
  EXPECT_TRUE(cell_.isLost());
  addFor(0.5, 0.3 + 2.0);
  EXPECT_FALSE(cell_.isLost()) << "more is not lost";
}

TEST_F(LoadCellTest, WhatSlidesOffTheBrickIsNoLossOfTheBrick) {
  addFor(0.5, 1.5);
  cell_.hold(2.0, 3.5, *cell_.weigh(kStart_s));
  addFor(0.5, 0.0);
  EXPECT_FALSE(cell_.isLost());
  addFor(0.5, -0.98);
  EXPECT_FALSE(cell_.isLost());
  addFor(0.5, -1.02);
  EXPECT_TRUE(cell_.isLost());
}

TEST_F(LoadCellTest, ResetForgetsSamplesNotTheBrick) {
  addFor(0.5, 0.0);
  cell_.hold(kBrick_kg, kBrick_kg, *cell_.weigh(kStart_s));
  addFor(0.5, -kBrick_kg);
  ASSERT_TRUE(cell_.isLost());
  cell_.reset();
  EXPECT_TRUE(cell_.isHolding());
  EXPECT_FALSE(cell_.isLost());
  EXPECT_FALSE(cell_.load().has_value());
  EXPECT_FALSE(cell_.weigh(kStart_s).has_value());
  addFor(0.1, -kBrick_kg);
  EXPECT_FALSE(cell_.isLost()) << "no samples for so long";
  addFor(0.01, -kBrick_kg);
  EXPECT_TRUE(cell_.isLost());
  cell_.release();
  EXPECT_FALSE(cell_.isHolding());
  EXPECT_FALSE(cell_.isLost());
}

TEST_F(LoadCellTest, HoldBeforeTheFirstSampleBeginsWithIt) {
  cell_.hold(kBrick_kg, kBrick_kg, LoadCell::Weight{});
  EXPECT_TRUE(cell_.isHolding());
  EXPECT_FALSE(cell_.isLost());
  addFor(0.3, -kBrick_kg);
  EXPECT_TRUE(cell_.isLost());
}

TEST_F(LoadCellTest, OneSampleAfterAGapIsNoLoss) {
  addFor(0.5, 0.0);
  cell_.hold(kBrick_kg, kBrick_kg, *cell_.weigh(kStart_s));
  now_s_ += 5.0;
  add(-kBrick_kg);
  EXPECT_FALSE(cell_.isLost());
  addFor(0.02, -kBrick_kg);
  EXPECT_TRUE(cell_.isLost());
}

TEST_F(LoadCellTest, RefusesToHoldWhatMakesNoSense) {
  EXPECT_THROW(cell_.hold(0.0, 1.0, {}), std::invalid_argument);
  EXPECT_THROW(cell_.hold(-1.0, 1.0, {}), std::invalid_argument);
  EXPECT_THROW(cell_.hold(kNaN, 1.0, {}), std::invalid_argument);
  LoadCell::Weight weight;
  weight.mass_kg = kNaN;
  EXPECT_THROW(cell_.hold(1.0, 1.0, weight), std::invalid_argument);
  EXPECT_THROW(cell_.hold(1.0, kNaN, {}), std::invalid_argument);
  EXPECT_FALSE(cell_.isHolding());
}

TEST(LoadCellConfig, RefusesImpossibleValues) {
  LoadCellConfig config;
  config.max_spread_N = kNaN;
  EXPECT_THROW(LoadCell{config}, std::invalid_argument);
}

}  // namespace
}  // namespace ur_driver_bridge
