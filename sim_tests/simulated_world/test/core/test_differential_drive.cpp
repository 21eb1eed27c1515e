// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/differential_drive.h"

#include <cmath>
#include <limits>
#include <stdexcept>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

namespace simulated_world {
namespace {

using test_support::messageOf;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr double kDt = 0.002;

// Drives with a command renewed at every step; returns the true pose.
Pose2d drive(DifferentialDrive& base, const Twist2d& command, double from_s, double seconds, Pose2d pose = {}) {
  const int steps = static_cast<int>(std::lround(seconds / kDt));
  for (int i = 0; i < steps; ++i) {
    const double now_s = from_s + i * kDt;
    base.command(command, now_s);
    pose = moveAlongArc(pose, base.update(now_s, kDt), kDt);
  }
  return pose;
}

DifferentialDriveConfig instantConfig() {
  DifferentialDriveConfig config;
  config.linear_acceleration_m_s2 = 50.0;  // at full speed within the first steps
  config.angular_acceleration_rad_s2 = 50.0;
  return config;
}

// The oracle knows nothing of chords: centre of the circle, radius, angle.
Pose2d pointOnCircle(double linear_m_s, double angular_rad_s, double seconds) {
  const double radius = linear_m_s / angular_rad_s;
  const double angle = angular_rad_s * seconds;
  return {radius * std::sin(angle), radius * (1.0 - std::cos(angle)), angle};
}

TEST(DifferentialDrive, OdometryFollowsAnalyticArc) {
  DifferentialDrive base(instantConfig());
  const Pose2d truth = drive(base, {0.5, 0.4}, 0.0, 10.0);
  const Pose2d expected = pointOnCircle(0.5, 0.4, 10.0);
  // Ramps of 10 and 8 ms cost less than 0.5 m/s * 10 ms / 2 in path and 0.4 rad/s * 8 ms / 2 in heading, the latter
  // times a lever of at most 2.5 m.
  EXPECT_NEAR(base.odometry().x_m, expected.x_m, 0.006);
  EXPECT_NEAR(base.odometry().y_m, expected.y_m, 0.006);
  EXPECT_NEAR(base.odometry().yaw_rad, expected.yaw_rad, 0.0017);
  // Without slip and error the wheels tell the truth, to rounding of 5000 steps.
  EXPECT_NEAR(truth.x_m, base.odometry().x_m, 1e-9);
  EXPECT_NEAR(truth.y_m, base.odometry().y_m, 1e-9);
}

TEST(DifferentialDrive, ArcIsExactWhateverTheStep) {
  const Twist2d twist{0.3, -0.5};
  const Pose2d expected = pointOnCircle(0.3, -0.5, 3.0);
  for (const double dt : {3.0, 0.1, 0.001}) {
    Pose2d pose;
    for (int i = 0; i < std::lround(3.0 / dt); ++i) {
      pose = moveAlongArc(pose, twist, dt);
    }
    EXPECT_NEAR(pose.x_m, expected.x_m, 1e-10) << dt;
    EXPECT_NEAR(pose.y_m, expected.y_m, 1e-10) << dt;
  }
  const Pose2d straight = moveAlongArc({1.0, 2.0, M_PI_2}, {0.3, 0.0}, 2.0);
  EXPECT_NEAR(straight.x_m, 1.0, 1e-12);
  EXPECT_NEAR(straight.y_m, 2.6, 1e-12);
}

TEST(DifferentialDrive, AcceleratesAtTheRateOfTheProfile) {
  DifferentialDrive base(DifferentialDriveConfig{});
  drive(base, {0.8, 0.0}, 0.0, 1.0);
  EXPECT_NEAR(base.wheelTwist().linear_m_s, 0.2, 1e-9);
  drive(base, {0.8, 0.0}, 1.0, 3.0);
  EXPECT_NEAR(base.wheelTwist().linear_m_s, 0.8, 1e-9);
  // v^2 / 2a while ramping.
  EXPECT_NEAR(base.odometry().x_m, 0.8 * 0.8 / (2 * 0.2), 0.002);
}

TEST(DifferentialDrive, LimitsKeepTheCurvature) {
  DifferentialDrive base(instantConfig());
  base.command({4.0, 2.0}, 0.0);
  drive(base, {4.0, 2.0}, 0.0, 1.0);
  EXPECT_NEAR(base.wheelTwist().linear_m_s, 0.8, 1e-9);
  EXPECT_NEAR(base.wheelTwist().angular_rad_s, 0.4, 1e-9);
  drive(base, {-1.0, 0.0}, 1.0, 1.0);
  EXPECT_NEAR(base.wheelTwist().linear_m_s, -0.1, 1e-9);
  drive(base, {0.3, 3.0}, 2.0, 1.0);
  EXPECT_NEAR(base.wheelTwist().angular_rad_s, 0.6, 1e-9);
  EXPECT_NEAR(base.wheelTwist().linear_m_s, 0.06, 1e-9);
}

TEST(DifferentialDrive, BrakesWhenCommandsStop) {
  DifferentialDrive base(DifferentialDriveConfig{});
  drive(base, {0.4, 0.0}, 0.0, 3.0);
  ASSERT_NEAR(base.wheelTwist().linear_m_s, 0.4, 1e-9);
  double now_s = 3.0;
  for (; now_s < 3.9; now_s += kDt) {
    base.update(now_s, kDt);
  }
  EXPECT_NEAR(base.wheelTwist().linear_m_s, 0.4, 1e-9) << "within command_timeout_s the last command holds";
  for (; now_s < 6.5; now_s += kDt) {
    base.update(now_s, kDt);
  }
  EXPECT_EQ(base.wheelTwist().linear_m_s, 0.0);
}

TEST(DifferentialDrive, SlipShowsInMotionAndNotInOdometry) {
  DifferentialDrive base(instantConfig());
  base.setSlip(0.5, 0.5);
  const Pose2d truth = drive(base, {0.4, 0.0}, 0.0, 2.0);
  EXPECT_NEAR(truth.x_m, 0.5 * base.odometry().x_m, 1e-9);
  EXPECT_NEAR(base.odometry().x_m, 0.8, 0.003);

  DifferentialDrive turning(instantConfig());
  turning.setSlip(0.0, 0.2);
  const Pose2d turned = drive(turning, {0.4, 0.0}, 0.0, 1.0);
  EXPECT_NEAR(turned.yaw_rad, -0.2 * 0.4 / turning.config().track_m, 0.002) << "the slower right wheel turns it right";
  EXPECT_EQ(turning.odometry().yaw_rad, 0.0);
}

TEST(DifferentialDrive, WheelsTurnAsTheBaseMoves) {
  DifferentialDrive base(instantConfig());
  drive(base, {0.0, 0.5}, 0.0, 4.0);
  const double arc_m = 0.5 * base.config().track_m * base.odometry().yaw_rad;
  EXPECT_NEAR(base.rightWheelAngle() * base.config().wheel_radius_m, arc_m, 1e-9);
  EXPECT_NEAR(base.leftWheelAngle() * base.config().wheel_radius_m, -arc_m, 1e-9);
}

TEST(DifferentialDrive, OdometryDriftsByTheStatedAmount) {
  // Heading walk of 0.02 rad per sqrt(m) over 4 m: sigma 0.04 rad. Over 200 seeds the estimate of a standard deviation
  // has a relative error of 5 % (1 sigma); 20 % is four of those.
  constexpr int kSeeds = 200;
  double sum = 0.0;
  for (int seed = 0; seed < kSeeds; ++seed) {
    DifferentialDriveConfig config = instantConfig();
    config.odometry_walk_rad_per_sqrt_m = 0.02;
    config.seed = static_cast<std::uint64_t>(seed);
    DifferentialDrive base(config);
    drive(base, {0.8, 0.0}, 0.0, 5.0);
    sum += base.odometry().yaw_rad * base.odometry().yaw_rad;
  }
  EXPECT_NEAR(std::sqrt(sum / kSeeds), 0.04, 0.008);
}

TEST(DifferentialDrive, SameSeedSameDrift) {
  DifferentialDriveConfig config = instantConfig();
  config.odometry_scale_std = 0.01;
  config.odometry_walk_m_per_sqrt_m = 0.01;
  DifferentialDrive first(config);
  DifferentialDrive second(config);
  config.seed = 2;
  DifferentialDrive other(config);
  drive(first, {0.5, 0.1}, 0.0, 2.0);
  drive(second, {0.5, 0.1}, 0.0, 2.0);
  drive(other, {0.5, 0.1}, 0.0, 2.0);
  EXPECT_EQ(first.odometry().x_m, second.odometry().x_m);
  EXPECT_NE(first.odometry().x_m, other.odometry().x_m);
}

TEST(DifferentialDrive, RefusesWhatCannotBe) {
  DifferentialDrive base(DifferentialDriveConfig{});
  base.command({0.2, 0.0}, 0.0);
  EXPECT_FALSE(base.command({std::numeric_limits<double>::quiet_NaN(), 0.0}, 0.0));
  EXPECT_FALSE(base.command({0.0, std::numeric_limits<double>::infinity()}, 0.0));
  drive(base, {0.2, 0.0}, 0.0, 2.0);
  EXPECT_NEAR(base.wheelTwist().linear_m_s, 0.2, 1e-9);
  EXPECT_THROW(base.setSlip(1.1, 0.0), std::invalid_argument);
  DifferentialDriveConfig config;
  config.track_m = 0.0;
  config.linear_acceleration_m_s2 = -1.0;
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { DifferentialDrive refused(config); }),
              AllOf(HasSubstr("track_m = 0, must be in (0, 5] m"), HasSubstr("linear_acceleration_m_s2 = -1")));
}

TEST(Pose2d, ComposesWithItsInverseToNothing) {
  const Pose2d a{1.0, -2.0, 0.7};
  const Pose2d none = compose(a, inverse(a));
  EXPECT_NEAR(none.x_m, 0.0, 1e-15);
  EXPECT_NEAR(none.y_m, 0.0, 1e-15);
  EXPECT_NEAR(none.yaw_rad, 0.0, 1e-15);
  const Pose2d b = compose({1.0, 0.0, M_PI_2}, {2.0, 0.0, 0.0});
  EXPECT_NEAR(b.x_m, 1.0, 1e-15);
  EXPECT_NEAR(b.y_m, 2.0, 1e-15);
}

}  // namespace
}  // namespace simulated_world
