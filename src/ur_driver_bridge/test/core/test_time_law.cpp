// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/time_law.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>

#include "support/planned_trajectories.h"

namespace ur_driver_bridge {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

using Law = std::function<double(double)>;  // time of the original by the new time

double maxNorm(const ArmVector& v) {
  return v.lpNorm<Eigen::Infinity>();
}

/// Everything that holds for any result: `s` is the law written down once more, from the header.
void expectFollows(const JointTrajectory& original, const JointTrajectory& result, const Law& s) {
  const auto position = [&](double t) { return original.sample(s(t)).position_rad; };
  ASSERT_FALSE(result.empty());
  EXPECT_EQ(result.points.front().time_s, 0.0);
  const auto& points = result.points;
  const double end_s = result.duration();
  EXPECT_EQ(points.back().velocity_rad_s, ArmVector::Zero());
  EXPECT_EQ(points.back().acceleration_rad_s2, ArmVector::Zero());
  double worst_position = 0.0;
  double worst_velocity = 0.0;
  double worst_between = 0.0;
  double worst_acceleration = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double t = points[i].time_s;
    worst_position = std::max(worst_position, maxNorm(points[i].position_rad - position(t)));
    // Velocity by central differences; it has kinks at the original's points, so the error is up to a step's acceleration.
    constexpr double kStep_s = 1e-6;
    if (t > kStep_s && t < end_s - kStep_s) {
      const ArmVector slope = (position(t + kStep_s) - position(t - kStep_s)) / (2.0 * kStep_s);
      worst_velocity = std::max(worst_velocity, maxNorm(points[i].velocity_rad_s - slope));
    }
    if (i + 1 == points.size()) break;
    const double length_s = points[i + 1].time_s - t;
    ASSERT_GT(length_s, 0.0);
    for (const double share : {0.1, 0.3, 0.5, 0.7, 0.9}) {
      const double between_s = t + share * length_s;
      worst_between = std::max(worst_between, maxNorm(result.sample(between_s).position_rad - position(between_s)));
    }
    const ArmVector just_after = result.sample(t + 1e-9 * length_s).acceleration_rad_s2;
    worst_acceleration = std::max(worst_acceleration, maxNorm(points[i].acceleration_rad_s2 - just_after));
  }
  EXPECT_LT(worst_position, 1e-12) << "points are on the original, but for rounding";
  EXPECT_LT(worst_velocity, 1e-5) << "accelerations here are below 10 rad/s^2, times the step of 1e-6 s";
  // f'''' h^4 / 384 with f = q(s(t)): at 10 ms and the planner's jerks below a micrometre at the tip.
  EXPECT_LT(worst_between, 1e-6) << "between points the cubics leave the path";
  EXPECT_LT(worst_acceleration, 1e-4) << "of rounding in the shortest intervals";
}

void expectKeepsLimits(const JointTrajectory& result, double ramp_s, StartSpeed start) {
  TrajectoryLimits limits = armLimits();
  // q'' s'^2 + q' s'': to the acceleration of the path, speed / ramp is added.
  limits.acceleration_rad_s2 += limits.velocity_rad_s / ramp_s;
  Verdict verdict = checkTrajectory(result, limits, 0.01, start);
  EXPECT_TRUE(verdict.isFine()) << verdict.message;
  JointTrajectory sent = result;  // in a message
  for (TrajectoryPoint& point : sent.points) point.time_s = std::round(point.time_s * 1e9) * 1e-9;
  verdict = checkTrajectory(sent, limits, 0.01, start);
  EXPECT_TRUE(verdict.isFine()) << "times in nanoseconds: " << verdict.message;
}

class TimeLaw : public ::testing::Test {
 protected:
  std::mt19937_64 random_{7};
  std::uniform_real_distribution<double> share_{0.0, 1.0};
};

/// Joint 0 at 0.5 rad/s for two seconds, in 0.1 s from rest and to rest; 1.05 rad in all.
JointTrajectory steady() {
  JointTrajectory trajectory;
  const auto add = [&](double t, double q, double v) {
    TrajectoryPoint point;
    point.time_s = t;
    point.position_rad[0] = q;
    point.velocity_rad_s[0] = v;
    trajectory.points.push_back(point);
  };
  add(0.0, 0.0, 0.0);
  add(0.1, 0.025, 0.5);
  add(2.1, 1.025, 0.5);
  add(2.2, 1.05, 0.0);
  return trajectory;
}

TEST_F(TimeLaw, BrakeIsTheLawOfTheHeader) {
  for (int n = 0; n < 30; ++n) {
    const JointTrajectory original = plannedTrajectory(&random_);
    const double duration_s = 0.1 + 0.9 * share_(random_);
    const double at_s = (0.02 + 0.95 * share_(random_)) * original.duration();
    SCOPED_TRACE("trajectory " + std::to_string(n));
    const JointTrajectory result = brake(original, at_s, duration_s);
    const Law law = [=](double t) { return at_s + t - t * t / (2.0 * duration_s); };
    expectFollows(original, result, law);
    EXPECT_EQ(result.points[0].position_rad, original.sample(at_s).position_rad);
    EXPECT_EQ(result.points[0].velocity_rad_s, original.sample(at_s).velocity_rad_s) << "no jump of speed";
    for (std::size_t i = 1; i < result.points.size(); ++i) {
      EXPECT_LE(result.points[i].time_s - result.points[i - 1].time_s, 0.01 + 1e-9);
    }
    if (at_s + 0.5 * duration_s < original.duration()) {
      EXPECT_NEAR(result.duration(), duration_s, 1e-12);
    } else {
      EXPECT_LE(result.duration(), duration_s);
      EXPECT_LT(maxNorm(result.points.back().position_rad - original.points.back().position_rad), 1e-12);
    }
    expectKeepsLimits(result, duration_s, StartSpeed::kMoving);
  }
}

TEST_F(TimeLaw, BrakeAtConstantSpeedTakesHalfTheWay) {
  const JointTrajectory result = brake(steady(), 1.0, 0.4);
  EXPECT_NEAR(result.points.front().position_rad[0], 0.475, 1e-12);
  EXPECT_NEAR(result.points.back().position_rad[0], 0.475 + 0.5 * 0.5 * 0.4, 1e-12);
  EXPECT_NEAR(result.sample(0.2).velocity_rad_s[0], 0.25, 1e-12);
  EXPECT_NEAR(result.sample(0.2).acceleration_rad_s2[0], -0.5 / 0.4, 1e-9);
}

TEST_F(TimeLaw, BrakeCanBeBraked) {
  const JointTrajectory first = brake(steady(), 1.0, 0.8);
  const JointTrajectory second = brake(first, 0.3, 0.1);
  expectFollows(first, second, [](double t) { return 0.3 + t - t * t / 0.2; });
  EXPECT_EQ(second.points[0].velocity_rad_s, first.sample(0.3).velocity_rad_s);
  // At its very beginning, where a trajectory from rest would not begin at all.
  const JointTrajectory third = brake(first, 0.0, 0.1);
  EXPECT_EQ(third.points[0].velocity_rad_s, first.points[0].velocity_rad_s);
}

TEST_F(TimeLaw, BrakeBeforeTheStartAndAfterTheEndStands) {
  const JointTrajectory original = steady();
  for (const double at_s : {-1.0, 0.0}) {
    const JointTrajectory result = brake(original, at_s, 0.3);
    ASSERT_EQ(result.points.size(), 1u);
    EXPECT_EQ(result.points[0].position_rad, original.points.front().position_rad);
    EXPECT_EQ(result.points[0].velocity_rad_s, ArmVector::Zero());
  }
  for (const double at_s : {2.2, 2.2 - 1e-12, 5.0}) {
    const JointTrajectory result = brake(original, at_s, 0.3);
    ASSERT_EQ(result.points.size(), 1u);
    EXPECT_LT(maxNorm(result.points[0].position_rad - original.points.back().position_rad), 1e-12);
    EXPECT_EQ(result.points[0].velocity_rad_s, ArmVector::Zero());
    EXPECT_EQ(result.points[0].time_s, 0.0);
  }
}

TEST_F(TimeLaw, ResumeJoinsWhereTheStopEnded) {
  for (int n = 0; n < 30; ++n) {
    const JointTrajectory original = plannedTrajectory(&random_);
    const double ramp_s = 0.1 + 0.9 * share_(random_);
    const double at_s = 0.9 * share_(random_) * original.duration();
    SCOPED_TRACE("trajectory " + std::to_string(n));
    const JointTrajectory stop = brake(original, at_s, 0.2);
    const double stopped_s = std::min(at_s + 0.1, original.duration());
    const JointTrajectory result = resume(original, stopped_s, ramp_s);
    EXPECT_LT(maxNorm(result.points.front().position_rad - stop.points.back().position_rad), 1e-12);
    EXPECT_EQ(result.points.front().velocity_rad_s, ArmVector::Zero());
    const Law law = [=](double t) {
      return t < ramp_s ? stopped_s + t * t / (2.0 * ramp_s) : stopped_s + 0.5 * ramp_s + (t - ramp_s);
    };
    expectFollows(original, result, law);
    EXPECT_EQ(result.points.back().position_rad, original.points.back().position_rad);
    EXPECT_NEAR(law(result.duration()), original.duration(), 1e-9);
    expectKeepsLimits(result, ramp_s, StartSpeed::kAtRest);
  }
}

TEST_F(TimeLaw, ResumeAtTheEndIsOnePoint) {
  for (const double at_s : {2.2, 3.0}) {
    const JointTrajectory result = resume(steady(), at_s, 0.3);
    ASSERT_EQ(result.points.size(), 1u);
    EXPECT_EQ(result.points[0].position_rad, steady().points.back().position_rad);
  }
  const JointTrajectory almost = resume(steady(), 2.15, 0.3);
  EXPECT_NEAR(almost.duration(), std::sqrt(2.0 * 0.3 * 0.05), 1e-12) << "no room for the whole ramp";
}

TEST_F(TimeLaw, UpToComesToRestExactlyThere) {
  for (int n = 0; n < 30; ++n) {
    const JointTrajectory original = plannedTrajectory(&random_);
    const double ramp_s = 0.05 + 0.9 * share_(random_);
    const double at_s = (0.01 + 0.99 * share_(random_)) * original.duration();
    SCOPED_TRACE("trajectory " + std::to_string(n));
    const JointTrajectory result = upTo(original, at_s, ramp_s);
    const double full_s = std::max(at_s - 0.5 * ramp_s, 0.0);
    const double brake_s = 2.0 * (at_s - full_s);
    const Law law = [=](double t) {
      const double u = std::max(t - full_s, 0.0);
      return std::min(t, full_s) + u - u * u / (2.0 * brake_s);
    };
    expectFollows(original, result, law);
    EXPECT_EQ(result.points.back().position_rad, original.sample(at_s).position_rad);
    EXPECT_NEAR(result.duration(), full_s + brake_s, 1e-9);
    expectKeepsLimits(result, ramp_s, StartSpeed::kAtRest);
  }
}

TEST_F(TimeLaw, UpToNeverGoesBackAndNeverBeyond) {
  const JointTrajectory original = steady();
  for (double at_s = 0.0; at_s < 2.3; at_s += 0.013) {
    const JointTrajectory result = upTo(original, at_s, 0.5);
    const double end_rad = original.sample(at_s).position_rad[0];
    EXPECT_EQ(result.points.back().position_rad[0], end_rad);
    double last_rad = 0.0;
    for (double t = 0.0; t <= result.duration(); t += 0.001) {
      const double q = result.sample(t).position_rad[0];
      // f'''' h^4 / 384 with f'''' = 3 q'' s''^2 = 60 rad/s^4 is 1.6e-9 rad at 10 ms.
      ASSERT_GE(q, last_rad - 5e-9) << at_s << " " << t;
      ASSERT_LE(q, end_rad + 5e-9);
      last_rad = q;
    }
  }
}

TEST_F(TimeLaw, UpToTheStartStands) {
  for (const double at_s : {-1.0, 0.0, 1e-9}) {
    const JointTrajectory result = upTo(steady(), at_s, 0.3);
    ASSERT_EQ(result.points.size(), 1u);
    EXPECT_EQ(result.points[0].velocity_rad_s, ArmVector::Zero());
  }
}

/// As it is sampled, of any joint.
double largestAcceleration(const JointTrajectory& trajectory) {
  double most = 0.0;
  for (std::size_t i = 0; i + 1 < trajectory.points.size(); ++i) {
    const double from_s = trajectory.points[i].time_s;
    const double length_s = trajectory.points[i + 1].time_s - from_s;
    for (const double share : {1e-6, 0.5, 1.0 - 1e-6}) {
      most = std::max(most, maxNorm(trajectory.sample(from_s + share * length_s).acceleration_rad_s2));
    }
  }
  return most;
}

TEST_F(TimeLaw, WithinAccelerationIsTheSameWaySlowerByWhatItMustBe) {
  for (int n = 0; n < 30; ++n) {
    SCOPED_TRACE("trajectory " + std::to_string(n));
    const JointTrajectory planned = plannedTrajectory(&random_);
    const JointTrajectory abrupt = upTo(planned, (0.3 + 0.4 * share_(random_)) * planned.duration(), 0.02);
    const double most_rad_s2 = largestAcceleration(abrupt);
    const double limit_rad_s2 = 0.3 * most_rad_s2;
    const JointTrajectory gentle = withinAcceleration(abrupt, limit_rad_s2);
    EXPECT_LE(largestAcceleration(gentle), limit_rad_s2 * (1.0 + 1e-7));
    EXPECT_GT(largestAcceleration(gentle), limit_rad_s2 * (1.0 - 1e-4));
    const double slower = std::sqrt(1.0 / 0.3);
    EXPECT_NEAR(gentle.duration(), slower * abrupt.duration(), 1e-4 * abrupt.duration());
    for (double t = 0.0; t < abrupt.duration(); t += 0.0137) {
      const double then_s = t * gentle.duration() / abrupt.duration();
      EXPECT_LT(maxNorm(gentle.sample(then_s).position_rad - abrupt.sample(t).position_rad), 1e-9);
      EXPECT_LT(maxNorm(gentle.sample(then_s).velocity_rad_s * slower - abrupt.sample(t).velocity_rad_s), 1e-5);
    }
    const JointTrajectory same = withinAcceleration(gentle, limit_rad_s2 * (1.0 + 1e-5));
    ASSERT_EQ(same.points.size(), gentle.points.size());
    EXPECT_EQ(same.duration(), gentle.duration());
  }
}

TEST_F(TimeLaw, ReversedIsTheSameWayBack) {
  for (int n = 0; n < 30; ++n) {
    const JointTrajectory original = plannedTrajectory(&random_);
    const JointTrajectory back = reversed(original);
    const Verdict verdict = checkTrajectory(back, armLimits());
    EXPECT_TRUE(verdict.isFine()) << verdict.message;
    EXPECT_EQ(back.points.front().time_s, 0.0);
    EXPECT_EQ(back.points.front().position_rad, original.points.back().position_rad);
    EXPECT_EQ(back.duration(), original.duration());
    for (int k = 0; k < 50; ++k) {
      const double t = share_(random_) * original.duration();
      const TrajectoryPoint there = original.sample(original.duration() - t);
      const TrajectoryPoint here = back.sample(t);
      EXPECT_LT(maxNorm(here.position_rad - there.position_rad), 1e-12);
      EXPECT_LT(maxNorm(here.velocity_rad_s + there.velocity_rad_s), 1e-9) << "of rounded times";
    }
  }
}

TEST_F(TimeLaw, ReversedTwiceIsTheSame) {
  for (int n = 0; n < 10; ++n) {
    const JointTrajectory original = plannedTrajectory(&random_);
    const JointTrajectory twice = reversed(reversed(original));
    ASSERT_EQ(twice.points.size(), original.points.size());
    for (std::size_t i = 0; i < twice.points.size(); ++i) {
      EXPECT_NEAR(twice.points[i].time_s, original.points[i].time_s, 1e-14);
      EXPECT_EQ(twice.points[i].position_rad, original.points[i].position_rad);
      EXPECT_EQ(twice.points[i].velocity_rad_s, original.points[i].velocity_rad_s);
      // Times that differ by rounding, over intervals down to the planner's shortest.
      EXPECT_LT(maxNorm(twice.points[i].acceleration_rad_s2 - original.points[i].acceleration_rad_s2), 1e-4);
    }
  }
}

TEST_F(TimeLaw, TimeOfIsTheInverseOfSample) {
  for (int n = 0; n < 10; ++n) {
    const JointTrajectory original = plannedTrajectory(&random_);
    for (int k = 0; k < 40; ++k) {
      const double t = share_(random_) * original.duration();
      const TrajectoryPoint sample = original.sample(t);
      const double near_s = t + 0.1 * (2.0 * share_(random_) - 1.0);
      const double found_s = timeOf(original, sample.position_rad, near_s, 0.2);
      // A tenth of a millisecond where the arm moves; at rest the place is what counts.
      EXPECT_LT((original.sample(found_s).position_rad - sample.position_rad).norm(), 1e-9);
      if (sample.velocity_rad_s.norm() > 1e-3) {
        EXPECT_NEAR(found_s, t, 1e-4);
      }
    }
  }
}

TEST_F(TimeLaw, TimeOfFindsTheNearestAsBruteForceDoes) {
  for (int n = 0; n < 10; ++n) {
    const JointTrajectory original = plannedTrajectory(&random_);
    for (int k = 0; k < 5; ++k) {
      const double near_s = share_(random_) * original.duration();
      const double window_s = 0.02 + 0.3 * share_(random_);
      ArmVector position_rad = original.sample(near_s + window_s * (2.0 * share_(random_) - 1.0)).position_rad;
      for (int i = 0; i < 6; ++i) position_rad[i] += 0.02 * (2.0 * share_(random_) - 1.0);
      const double found_s = timeOf(original, position_rad, near_s, window_s);
      EXPECT_LE(std::abs(found_s - near_s), window_s + 1e-12);
      double least_rad = 1e9;
      for (int m = 0; m <= 4000; ++m) {
        const double t = near_s - window_s + 2.0 * window_s * m / 4000.0;
        least_rad = std::min(least_rad, (original.sample(t).position_rad - position_rad).norm());
      }
      EXPECT_LE((original.sample(found_s).position_rad - position_rad).norm(), least_rad + 1e-12);
    }
  }
}

TEST_F(TimeLaw, TimeOfOffThePathIsToATenthOfAMillisecond) {
  // Off the way of joint 0 in joint 1, at low speed: the distance hardly changes around its minimum.
  JointTrajectory slow = steady();
  for (TrajectoryPoint& point : slow.points) {
    point.position_rad *= 0.02;
    point.velocity_rad_s *= 0.02;
  }
  for (double t = 0.2; t < 2.0; t += 0.0917) {
    ArmVector position_rad = slow.sample(t).position_rad;
    position_rad[1] = 0.02;
    EXPECT_NEAR(timeOf(slow, position_rad, t + 0.03, 0.1), t, 1e-4);
  }
}

TEST_F(TimeLaw, TimeOfStandingStillIsTheNearest) {
  JointTrajectory pause = steady();  // with a rest of one second in the middle of nothing: at its end
  TrajectoryPoint rest = pause.points.back();
  rest.time_s += 1.0;
  pause.points.push_back(rest);
  for (const double near_s : {2.3, 2.7, 3.1}) {
    EXPECT_EQ(timeOf(pause, rest.position_rad, near_s, 0.15), near_s);
  }
  EXPECT_EQ(timeOf(pause, rest.position_rad, 4.0, 0.15), 3.2) << "time stops at the end";
  EXPECT_EQ(timeOf(pause, ArmVector::Zero(), -1.0, 0.15), 0.0);
}

TEST_F(TimeLaw, TimeOfAPauseIsItsEndThatIsNearer) {
  JointTrajectory with_pause = steady();
  for (const TrajectoryPoint& point : reversed(steady()).points) {
    with_pause.points.push_back(point);
    with_pause.points.back().time_s += 3.2;
  }
  const ArmVector pause_rad = with_pause.sample(2.7).position_rad;
  EXPECT_NEAR(timeOf(with_pause, pause_rad, 2.1, 2.0), 2.2, 1e-4);
  EXPECT_NEAR(timeOf(with_pause, pause_rad, 3.3, 2.0), 3.2, 1e-4);
}

TEST_F(TimeLaw, TimeOfKeepsToTheWindowWhereTheArmPassesTwice) {
  JointTrajectory there_and_back = steady();
  const JointTrajectory back = reversed(steady());
  for (std::size_t i = 1; i < back.points.size(); ++i) {
    there_and_back.points.push_back(back.points[i]);
    there_and_back.points.back().time_s += 2.2;
  }
  const ArmVector place_rad = there_and_back.sample(1.0).position_rad;
  EXPECT_NEAR(timeOf(there_and_back, place_rad, 1.1, 0.5), 1.0, 1e-4);
  EXPECT_NEAR(timeOf(there_and_back, place_rad, 3.3, 0.5), 3.4, 1e-4);
  EXPECT_NEAR(timeOf(there_and_back, place_rad, 2.0, 0.5), 1.5, 1e-12) << "nearest within the window is its border";
}

TEST_F(TimeLaw, RefusesWhatMakesNoSense) {
  const JointTrajectory original = steady();
  for (const auto& law : {brake, resume, upTo}) {
    EXPECT_THROW(law({}, 0.5, 0.3, 0.01), std::invalid_argument);
    EXPECT_THROW(law(original, kNaN, 0.3, 0.01), std::invalid_argument);
    EXPECT_THROW(law(original, 0.5, kNaN, 0.01), std::invalid_argument);
    EXPECT_THROW(law(original, 0.5, 0.0, 0.01), std::invalid_argument);
    EXPECT_THROW(law(original, 0.5, -0.3, 0.01), std::invalid_argument);
    EXPECT_THROW(law(original, 0.5, 0.3, 0.0), std::invalid_argument);
    EXPECT_THROW(law(original, 0.5, 0.3, std::numeric_limits<double>::infinity()), std::invalid_argument);
  }
  EXPECT_THROW(withinAcceleration({}, 4.0), std::invalid_argument);
  EXPECT_THROW(withinAcceleration(original, 0.0), std::invalid_argument);
  EXPECT_THROW(withinAcceleration(original, kNaN), std::invalid_argument);
  EXPECT_THROW(withinAcceleration(brake(original, 1.0, 0.3), 4.0), std::invalid_argument);
  EXPECT_THROW(reversed({}), std::invalid_argument);
  EXPECT_THROW(timeOf({}, ArmVector::Zero(), 0.0, 0.1), std::invalid_argument);
  EXPECT_THROW(timeOf(original, ArmVector::Constant(kNaN), 0.0, 0.1), std::invalid_argument);
  EXPECT_THROW(timeOf(original, ArmVector::Zero(), kNaN, 0.1), std::invalid_argument);
  EXPECT_THROW(timeOf(original, ArmVector::Zero(), 0.0, -0.1), std::invalid_argument);
}

}  // namespace
}  // namespace ur_driver_bridge
