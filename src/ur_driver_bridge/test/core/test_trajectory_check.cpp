// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/trajectory_check.h"

#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>

#include "support/planned_trajectories.h"
#include "ur_driver_bridge/time_law.h"

namespace ur_driver_bridge {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Joint 2 from rest at 0 to rest at `way_rad` in `duration_s`, by a point at full speed in the middle.
JointTrajectory oneJoint(double way_rad = 0.2, double duration_s = 1.0) {
  JointTrajectory trajectory;
  trajectory.points.resize(3);
  trajectory.points[1].time_s = 0.5 * duration_s;
  trajectory.points[1].position_rad[2] = 0.5 * way_rad;
  trajectory.points[1].velocity_rad_s[2] = 2.0 * way_rad / duration_s;
  trajectory.points[2].time_s = duration_s;
  trajectory.points[2].position_rad[2] = way_rad;
  return trajectory;
}

/// Largest and smallest values of one joint by dense sampling.
struct Extremes {
  double lower_rad{kInfinity};
  double upper_rad{-kInfinity};
  double velocity_rad_s{0.0};
  double acceleration_rad_s2{0.0};
};

Extremes sampled(const JointTrajectory& trajectory, int joint) {
  Extremes extremes;
  constexpr int kSamples = 1000;  // between points; an extreme between two of these is missed by < 1e-6 of the range
  const auto& points = trajectory.points;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    for (int k = 0; k <= kSamples; ++k) {
      // Just inside the end, where the next cubic has not begun.
      const double share = std::min(static_cast<double>(k) / kSamples, 1.0 - 1e-9);
      const auto sample =
          trajectory.sample(points[i].time_s + share * (points[i + 1].time_s - points[i].time_s) + (k == 0 ? 1e-9 : 0));
      extremes.lower_rad = std::min(extremes.lower_rad, sample.position_rad[joint]);
      extremes.upper_rad = std::max(extremes.upper_rad, sample.position_rad[joint]);
      extremes.velocity_rad_s = std::max(extremes.velocity_rad_s, std::abs(sample.velocity_rad_s[joint]));
      extremes.acceleration_rad_s2 =
          std::max(extremes.acceleration_rad_s2, std::abs(sample.acceleration_rad_s2[joint]));
    }
  }
  return extremes;
}

TrajectoryLimits generous() {
  TrajectoryLimits limits;
  limits.joints = armJoints();
  limits.lower_rad.setConstant(-100.0);
  limits.upper_rad.setConstant(100.0);
  limits.velocity_rad_s.setConstant(100.0);
  limits.acceleration_rad_s2.setConstant(1000.0);
  return limits;
}

TEST(TrajectoryCheck, WhatThePlannerTimesWithinTheLimitsPasses) {
  std::mt19937_64 random(1);
  for (int n = 0; n < 150; ++n) {
    const JointTrajectory trajectory = plannedTrajectory(&random);
    const Verdict verdict = checkTrajectory(trajectory, armLimits());
    EXPECT_TRUE(verdict.isFine()) << n << ": " << verdict.message;
    EXPECT_THAT(verdict.message, "");
  }
}

TEST(TrajectoryCheck, TimesRoundedToNanosecondsByAMessagePass) {
  std::mt19937_64 random(2);
  for (int n = 0; n < 150; ++n) {
    JointTrajectory trajectory = plannedTrajectory(&random);
    for (TrajectoryPoint& point : trajectory.points) point.time_s = std::round(point.time_s * 1e9) * 1e-9;
    const Verdict verdict = checkTrajectory(trajectory, armLimits());
    EXPECT_TRUE(verdict.isFine()) << n << ": " << verdict.message;
  }
}

TEST(TrajectoryCheck, RoundingOfTimesIsNoAccelerationEvenWherePointsAreNear) {
  // Steady motion at 1 rad/s; in its midst two points 10 us apart, each rounded the other way: 6 * 0.8 ns / (10 us)^2 =
  // 48 rad/s^2 if the times were exact.
  JointTrajectory trajectory;
  trajectory.points.resize(6);
  const double times_s[] = {0.0, 1.0, 1.5, 1.50001, 2.0, 3.0};
  const double rounding_s[] = {0.0, 0.0, 0.4e-9, -0.4e-9, 0.0, 0.0};
  for (int i = 0; i < 6; ++i) {
    const double t = times_s[i];
    const bool is_steady = i > 0 && i < 5;
    trajectory.points[i].position_rad[2] = is_steady ? t - 0.5 : i == 0 ? 0.0 : 2.0;
    trajectory.points[i].velocity_rad_s[2] = is_steady ? 1.0 : 0.0;
    trajectory.points[i].time_s = t + rounding_s[i];
  }
  EXPECT_EQ(checkTrajectory(trajectory, armLimits()).message, "");
  // The same, as resume(), upTo() and reversed() make it of what came in a message.
  const JointTrajectory turned = reversed(trajectory);
  EXPECT_GT(std::abs(turned.points[2].acceleration_rad_s2[2]), 40.0);
  EXPECT_EQ(checkTrajectory(turned, armLimits()).message, "");
  trajectory.points[3].time_s -= 4e-9;
  EXPECT_EQ(checkTrajectory(trajectory, armLimits()).status, ArmStatus::kBeyondLimits) << "more than rounding";
}

TEST(TrajectoryCheck, LimitsAreExactBetweenThePointsToo) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::uniform_int_distribution<int> any_joint(0, 5);
  constexpr double kJust = 1e-4;  // share by which a limit is above or below what dense sampling finds
  int overshoots = 0;
  for (int n = 0; n < 200; ++n) {
    JointTrajectory trajectory;
    trajectory.points.resize(4);
    double time_s = 0.0;
    for (TrajectoryPoint& point : trajectory.points) {
      for (int i = 0; i < 6; ++i) {
        point.position_rad[i] = 2.0 * uniform(random);
        point.velocity_rad_s[i] = 3.0 * uniform(random);
      }
      point.time_s = time_s;
      time_s += 0.7 + 0.5 * uniform(random);
    }
    trajectory.points.front().velocity_rad_s.setZero();
    trajectory.points.back().velocity_rad_s.setZero();
    ASSERT_TRUE(checkTrajectory(trajectory, generous(), 0.0).isFine());
    const int joint = any_joint(random);
    const Extremes extremes = sampled(trajectory, joint);
    double at_points_rad = -kInfinity;
    for (const auto& point : trajectory.points) at_points_rad = std::max(at_points_rad, point.position_rad[joint]);
    if (extremes.upper_rad > at_points_rad + 1e-3) ++overshoots;

    const auto expect = [&](const std::function<void(TrajectoryLimits*, double)>& set, const std::string& what) {
      SCOPED_TRACE(what + " of trajectory " + std::to_string(n));
      TrajectoryLimits limits = generous();
      set(&limits, 1.0 + kJust);
      Verdict verdict = checkTrajectory(trajectory, limits, 0.0);
      EXPECT_TRUE(verdict.isFine()) << verdict.message;
      set(&limits, 1.0 - kJust);
      verdict = checkTrajectory(trajectory, limits, 0.0);
      EXPECT_EQ(verdict.status, ArmStatus::kBeyondLimits);
      EXPECT_THAT(verdict.message, AllOf(HasSubstr(what), HasSubstr(armJoints()[joint])));
    };
    const double range_rad = extremes.upper_rad - extremes.lower_rad;
    expect([&](auto* limits, double f) { limits->upper_rad[joint] = extremes.lower_rad + f * range_rad; }, "position");
    expect([&](auto* limits, double f) { limits->lower_rad[joint] = extremes.upper_rad - f * range_rad; }, "position");
    expect([&](auto* limits, double f) { limits->velocity_rad_s[joint] = f * extremes.velocity_rad_s; }, "velocity");
    expect([&](auto* limits, double f) { limits->acceleration_rad_s2[joint] = f * extremes.acceleration_rad_s2; },
           "acceleration");
  }
  EXPECT_GT(overshoots, 50) << "too few trajectories that are beyond the points between them";
}

TEST(TrajectoryCheck, NamesWhatMakesNoSense) {
  struct Case {
    std::string what;
    std::function<void(JointTrajectory*)> spoil;
    ArmStatus status;
    std::vector<std::string> says;
  };
  const ArmStatus bad = ArmStatus::kBadRequest;
  const ArmStatus beyond = ArmStatus::kBeyondLimits;
  const std::vector<Case> cases = {
      {"empty", [](auto* t) { t->points.clear(); }, bad, {"0 points"}},
      {"time NaN", [](auto* t) { t->points[1].time_s = kNaN; }, bad, {"time of point 1"}},
      {"time infinite", [](auto* t) { t->points[2].time_s = kInfinity; }, bad, {"time of point 2"}},
      {"position NaN", [](auto* t) { t->points[1].position_rad[3] = kNaN; }, bad, {"wrist_1", "position", "point 1"}},
      {"velocity inf", [](auto* t) { t->points[1].velocity_rad_s[0] = kInfinity; }, bad, {"shoulder_pan", "velocity"}},
      {"acceleration NaN",
       [](auto* t) { t->points[2].acceleration_rad_s2[5] = kNaN; },
       bad,
       {"wrist_3", "acceleration"}},
      {"early", [](auto* t) { t->points[0].time_s = -0.1; }, bad, {"begins at -0.1 s", ">= 0 s"}},
      {"same time", [](auto* t) { t->points[1].time_s = t->points[2].time_s; }, bad, {"point 2", "not later"}},
      {"back in time", [](auto* t) { t->points[1].time_s = 2.0; }, bad, {"point 2", "not later", "2 s"}},
      {"moves at start", [](auto* t) { t->points[0].velocity_rad_s[4] = 0.01; }, bad, {"wrist_2", "0.01", "start"}},
      {"moves at end", [](auto* t) { t->points[2].velocity_rad_s[4] = -0.01; }, bad, {"wrist_2", "-0.01", "end"}},
      {"too far", [](auto* t) { t->points[1].position_rad[5] = 3.5; }, beyond, {"wrist_3", "3.5", "[-3, 3] rad"}},
      {"too fast", [](auto* t) { t->points[1].velocity_rad_s[0] = 1.1; }, beyond, {"shoulder_pan", "1.1", "[-1, 1]"}},
      {"told to accelerate too much",
       [](auto* t) { t->points[1].acceleration_rad_s2[0] = -1.6; },
       beyond,
       {"shoulder_pan", "acceleration -1.6", "point 1", "[-1.5, 1.5] rad/s^2"}},
      {"overflow", [](auto* t) { t->points[1].position_rad[1] = 1e308; }, beyond, {"shoulder_lift", "1e+308"}},
  };
  ASSERT_TRUE(checkTrajectory(oneJoint(), armLimits()).isFine());
  for (const Case& one : cases) {
    SCOPED_TRACE(one.what);
    JointTrajectory trajectory = oneJoint();
    one.spoil(&trajectory);
    const Verdict verdict = checkTrajectory(trajectory, armLimits());
    EXPECT_EQ(verdict.status, one.status) << verdict.message;
    for (const std::string& text : one.says) EXPECT_THAT(verdict.message, HasSubstr(text));
  }
}

TEST(TrajectoryCheck, AllowsRatesBeyondTheLimitsByTheToleranceOnly) {
  // From rest to rest over a point at twice the mean speed: acceleration 4 way / duration^2 everywhere.
  TrajectoryLimits limits = armLimits();
  const auto withAcceleration = [&](double share) {
    return oneJoint(share * limits.acceleration_rad_s2[2] / 4.0, 1.0);
  };
  EXPECT_TRUE(checkTrajectory(withAcceleration(1.009), limits, 0.01).isFine());
  EXPECT_FALSE(checkTrajectory(withAcceleration(1.011), limits, 0.01).isFine());
  EXPECT_FALSE(checkTrajectory(withAcceleration(1.009), limits, 0.0).isFine());
  limits.acceleration_rad_s2.setConstant(1000.0);
  const auto withVelocity = [&](double share) { return oneJoint(share * limits.velocity_rad_s[2] / 2.0, 1.0); };
  EXPECT_TRUE(checkTrajectory(withVelocity(1.009), limits, 0.01).isFine());
  EXPECT_FALSE(checkTrajectory(withVelocity(1.011), limits, 0.01).isFine());
}

TEST(TrajectoryCheck, StepOfVelocityWithinANanosecondIsNoRounding) {
  for (const double gap_s : {1e-9, 1e-8, 1e-7, 1e-6, 1e-5}) {
    JointTrajectory trajectory = oneJoint(0.5, 2.0);
    trajectory.points.insert(trajectory.points.begin() + 1, trajectory.points[0]);
    trajectory.points[1].time_s = gap_s;
    trajectory.points[1].velocity_rad_s[2] = 0.3;
    trajectory.points[1].position_rad[2] = 0.15 * gap_s;
    const Verdict verdict = checkTrajectory(trajectory, armLimits());
    EXPECT_EQ(verdict.status, ArmStatus::kBeyondLimits) << gap_s;
    EXPECT_THAT(verdict.message, HasSubstr("acceleration"));
  }
}

TEST(TrajectoryCheck, RoundingIsNoAccelerationThatLasts) {
  // Joint 2 from rest to 0.5 rad/s within its limit, by 0.2 rad/s more at `rate` with points `gap_s` apart, and back.
  const TrajectoryLimits limits = armLimits();
  const double gentle_rad_s2 = 0.9 * limits.acceleration_rad_s2[2];
  const auto dense = [&](double rate_rad_s2, double gap_s, double sign) {
    JointTrajectory trajectory;
    double t = 0.0, position = 0.0, velocity = 0.0;
    const auto go = [&](double acceleration, double end_rad_s, int pieces) {
      const double h = (end_rad_s - velocity) / acceleration / pieces;
      for (int i = 0; i < pieces; ++i) {
        TrajectoryPoint point;
        point.time_s = t;
        point.position_rad[2] = sign * position;
        point.velocity_rad_s[2] = sign * velocity;
        trajectory.points.push_back(point);
        t += h;
        position += h * (velocity + 0.5 * h * acceleration);
        velocity += h * acceleration;
      }
    };
    go(gentle_rad_s2, 0.5, 50);
    go(rate_rad_s2, 0.7, static_cast<int>(std::round(0.2 / rate_rad_s2 / gap_s)));
    go(-gentle_rad_s2, 0.0, 50);
    go(1.0, 1e-9, 1);  // the last point, at rest
    return trajectory;
  };
  for (const double sign : {1.0, -1.0}) {
    for (const double gap_s : {2e-6, 1e-5, 5e-5}) {
      EXPECT_EQ(checkTrajectory(dense(gentle_rad_s2, gap_s, sign), limits).message, "") << gap_s;
      for (const double factor : {1.1, 4.0, 30.0}) {
        SCOPED_TRACE(std::to_string(sign * factor) + " times the limit, points " + std::to_string(gap_s) + " s apart");
        const Verdict verdict = checkTrajectory(dense(factor * limits.acceleration_rad_s2[2], gap_s, sign), limits);
        EXPECT_EQ(verdict.status, ArmStatus::kBeyondLimits);
        EXPECT_THAT(verdict.message, AllOf(HasSubstr("elbow_joint"), HasSubstr("acceleration")));
      }
    }
  }
}

TEST(TrajectoryCheck, StopMayBeginInMotion) {
  JointTrajectory trajectory = oneJoint();
  trajectory.points.erase(trajectory.points.begin());
  EXPECT_EQ(checkTrajectory(trajectory, armLimits()).status, ArmStatus::kBadRequest);
  EXPECT_TRUE(checkTrajectory(trajectory, armLimits(), 0.01, StartSpeed::kMoving).isFine());
  trajectory.points.back().velocity_rad_s[2] = 0.01;
  EXPECT_EQ(checkTrajectory(trajectory, armLimits(), 0.01, StartSpeed::kMoving).status, ArmStatus::kBadRequest);
}

TEST(TrajectoryCheck, OnePointAtRestIsATrajectory) {
  JointTrajectory trajectory;
  trajectory.points.resize(1);
  EXPECT_TRUE(checkTrajectory(trajectory, armLimits()).isFine());
  trajectory.points[0].position_rad[1] = -3.1;
  EXPECT_EQ(checkTrajectory(trajectory, armLimits()).status, ArmStatus::kBeyondLimits);
}

TEST(TrajectoryCheck, RefusesImpossibleLimits) {
  EXPECT_THROW(checkTrajectory(oneJoint(), TrajectoryLimits{}), std::invalid_argument) << "no names";
  TrajectoryLimits limits = armLimits();
  limits.upper_rad[1] = -3.5;
  limits.velocity_rad_s[2] = 0.0;
  limits.acceleration_rad_s2[3] = kNaN;
  EXPECT_EQ(limits.validate().size(), 3u);
  EXPECT_THROW(checkTrajectory(oneJoint(), limits), std::invalid_argument);
  EXPECT_THROW(checkTrajectory(oneJoint(), armLimits(), -0.1), std::invalid_argument);
  EXPECT_THROW(checkTrajectory(oneJoint(), armLimits(), kNaN), std::invalid_argument);
}

TEST(StartCheck, NamesTheWorstJoint) {
  ArmVector arm_rad = ArmVector::Zero();
  EXPECT_TRUE(checkStart(oneJoint(), arm_rad, armJoints(), 0.01).isFine());
  arm_rad[1] = 0.0099;
  EXPECT_TRUE(checkStart(oneJoint(), arm_rad, armJoints(), 0.01).isFine());
  arm_rad[1] = -0.02;
  arm_rad[4] = 0.05;
  arm_rad[5] = -0.03;
  const Verdict verdict = checkStart(oneJoint(), arm_rad, armJoints(), 0.01);
  EXPECT_EQ(verdict.status, ArmStatus::kStartMismatch);
  EXPECT_THAT(verdict.message, AllOf(HasSubstr("wrist_2_joint"), HasSubstr("0.05 rad"), HasSubstr("allowed 0.01 rad")));
}

TEST(StartCheck, AnotherTurnIsAnotherPlaceAndNoNumberIsNowhere) {
  ArmVector arm_rad = ArmVector::Zero();
  arm_rad[5] = 2.0 * M_PI;
  EXPECT_EQ(checkStart(oneJoint(), arm_rad, armJoints(), 0.01).status, ArmStatus::kStartMismatch);
  arm_rad[5] = kNaN;
  const Verdict verdict = checkStart(oneJoint(), arm_rad, armJoints(), 0.01);
  EXPECT_EQ(verdict.status, ArmStatus::kStartMismatch);
  EXPECT_THAT(verdict.message, HasSubstr("wrist_3_joint"));
}

TEST(StartCheck, RefusesWhatMakesNoSense) {
  EXPECT_EQ(checkStart({}, ArmVector::Zero(), armJoints(), 0.01).status, ArmStatus::kBadRequest);
  EXPECT_THROW(checkStart(oneJoint(), ArmVector::Zero(), {}, 0.01), std::invalid_argument);
  EXPECT_THROW(checkStart(oneJoint(), ArmVector::Zero(), armJoints(), -0.01), std::invalid_argument);
  EXPECT_THROW(checkStart(oneJoint(), ArmVector::Zero(), armJoints(), kNaN), std::invalid_argument);
}

}  // namespace
}  // namespace ur_driver_bridge
