// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/joint_trajectory.h"

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

namespace motion_planning {
namespace {

using test_support::messageOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

ArmVector joints(double a, double b, double c, double d, double e, double f) {
  ArmVector q;
  q << a, b, c, d, e, f;
  return q;
}

MotionLimits urLimits() {
  MotionLimits limits;
  limits.velocity_rad_s.setConstant(0.35 * M_PI);
  limits.acceleration_rad_s2.setConstant(1.5);
  return limits;
}

/// Max norm; the distance is convex along the segment.
double distanceToSegment(const ArmVector& p, const ArmVector& a, const ArmVector& b) {
  const auto distance = [&](double t) { return (p - a - t * (b - a)).lpNorm<Eigen::Infinity>(); };
  double low = 0.0;
  double high = 1.0;
  for (int i = 0; i < 40; ++i) {
    const double left = low + (high - low) * 0.382;
    const double right = low + (high - low) * 0.618;
    (distance(left) < distance(right) ? high : low) = distance(left) < distance(right) ? right : left;
  }
  return distance(0.5 * (low + high));
}

double distanceToPath(const ArmVector& p, const JointPath& path) {
  double least = (p - path.front()).lpNorm<Eigen::Infinity>();
  for (std::size_t i = 0; i + 1 < path.size(); ++i) least = std::min(least, distanceToSegment(p, path[i], path[i + 1]));
  return least;
}

/// Time from rest to rest along a straight line, one trapezoid for all joints.
double straightTime(const ArmVector& a, const ArmVector& b, const MotionLimits& limits) {
  const double length = (b - a).norm();
  const ArmVector u = (b - a) / length;
  const double v = (limits.velocity_rad_s.array() / u.array().abs().max(1e-300)).minCoeff();
  const double acc = (limits.acceleration_rad_s2.array() / u.array().abs().max(1e-300)).minCoeff();
  return length < v * v / acc ? 2.0 * std::sqrt(length / acc) : length / v + v / acc;
}

/// No joint can travel its way faster than at its speed limit.
double lowerBound(const JointPath& path, const MotionLimits& limits) {
  ArmVector way = path.back() - path.front();
  return (way.array().abs() / limits.velocity_rad_s.array()).maxCoeff();
}

/// Everything that the header promises, by dense samples of JointTrajectory::sample.
void expectKeepsPromises(const JointPath& path, const MotionLimits& limits, const TimingConfig& config,
                         const JointTrajectory& trajectory, const std::string& what) {
  SCOPED_TRACE(what);
  const auto& points = trajectory.points;
  ASSERT_GE(points.size(), 2u);
  EXPECT_EQ(points.front().time_s, 0.0);
  EXPECT_EQ(points.front().position_rad, path.front());
  EXPECT_EQ(points.back().position_rad, path.back());
  EXPECT_EQ(points.front().velocity_rad_s, ArmVector::Zero());
  EXPECT_EQ(points.back().velocity_rad_s, ArmVector::Zero());
  double worst_velocity = 0.0;
  double worst_acceleration = 0.0;
  double worst_deviation = 0.0;
  double worst_jump = 0.0;
  double worst_slope = 0.0;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const double duration = points[i + 1].time_s - points[i].time_s;
    ASSERT_GT(duration, 0.0);
    ASSERT_LE(duration, config.sample_s * 1.001);
    for (int k = 0; k <= 4; ++k) {
      // Just inside the ends, so that the piece is this one.
      const double t = points[i].time_s + duration * std::min(std::max(k / 4.0, 1e-6), 1.0 - 1e-6);
      const TrajectoryPoint sample = trajectory.sample(t);
      worst_velocity =
          std::max(worst_velocity, (sample.velocity_rad_s.array().abs() / limits.velocity_rad_s.array()).maxCoeff());
      worst_acceleration =
          std::max(worst_acceleration,
                   (sample.acceleration_rad_s2.array().abs() / limits.acceleration_rad_s2.array()).maxCoeff());
      if (k == 2 && i % 5 == 0) worst_deviation = std::max(worst_deviation, distanceToPath(sample.position_rad, path));
    }
    // Position and velocity are continuous, and velocity is the derivative of position.
    const double h = 0.25 * duration;
    const double t = points[i].time_s + 0.5 * duration;
    const ArmVector slope = (trajectory.sample(t + h).position_rad - trajectory.sample(t - h).position_rad) / (2.0 * h);
    const ArmVector mean = (trajectory.sample(t + h).velocity_rad_s + trajectory.sample(t - h).velocity_rad_s +
                            4.0 * trajectory.sample(t).velocity_rad_s) /
                           6.0;  // Simpson: exact for a parabola
    worst_slope = std::max(worst_slope, (slope - mean).lpNorm<Eigen::Infinity>() * h);
    const double just_before = points[i + 1].time_s - 1e-6 * duration;
    worst_jump = std::max(worst_jump, (trajectory.sample(just_before).velocity_rad_s - points[i + 1].velocity_rad_s)
                                              .cwiseQuotient(limits.acceleration_rad_s2)
                                              .lpNorm<Eigen::Infinity>() /
                                          (1e-6 * duration + 1e-12));
  }
  EXPECT_LE(worst_velocity, 1.0 + 1e-6);
  EXPECT_LE(worst_acceleration, 1.0 + 1e-6);
  // Between points the cubic leaves the path by at most about a h^2 / 16 beyond what rounding does.
  const double interpolation = limits.acceleration_rad_s2.maxCoeff() * config.sample_s * config.sample_s / 8.0;
  EXPECT_LE(worst_deviation, config.max_deviation_rad + interpolation);
  EXPECT_LE(worst_slope, 1e-12);
  EXPECT_LE(worst_jump, 1.1);  // velocity changes by no more than acceleration allows, also at the points
  EXPECT_GE(trajectory.duration(), lowerBound(path, limits));
}

TEST(JointTrajectory, StraightLineTakesTheTimeOfABangBangMotion) {
  std::mt19937_64 rng(1);
  std::uniform_real_distribution<double> angle(-1.0, 1.0);
  std::uniform_real_distribution<double> power(-4.5, 1.0);
  for (int n = 0; n < 500; ++n) {
    MotionLimits limits;
    JointPath path(2, ArmVector::Zero());
    const double length = std::pow(10.0, power(rng));
    for (int i = 0; i < 6; ++i) {
      path[0][i] = angle(rng);
      path[1][i] = path[0][i] + length * angle(rng);
      limits.velocity_rad_s[i] = std::pow(10.0, 0.5 * angle(rng));
      limits.acceleration_rad_s2[i] = std::pow(10.0, angle(rng));
    }
    const JointTrajectory trajectory = timeParametrize(path, limits);
    expectKeepsPromises(path, limits, {}, trajectory, "line " + std::to_string(n));
    const double exact = straightTime(path[0], path[1], limits);
    EXPECT_GE(trajectory.duration(), exact * (1.0 - 1e-9));
    EXPECT_LE(trajectory.duration(), exact * 1.02) << "line " << n << ", length " << length;
  }
}

TEST(JointTrajectory, RandomPathsStayWithinLimitsAndDeviation) {
  std::mt19937_64 rng(2);
  std::uniform_real_distribution<double> angle(-3.0, 3.0);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  double seconds = 0.0;
  for (int n = 0; n < 1000; ++n) {
    MotionLimits limits = urLimits();
    TimingConfig config;
    if (n % 3 == 0) {
      for (int i = 0; i < 6; ++i) {
        limits.velocity_rad_s[i] = 0.1 + 3.0 * unit(rng);
        limits.acceleration_rad_s2[i] = 0.2 + 10.0 * unit(rng);
      }
      config.max_deviation_rad = std::pow(10.0, -4.0 + 3.5 * unit(rng));
      config.sample_s = 0.004 + 0.04 * unit(rng);
    }
    JointPath path(2 + rng() % 6, ArmVector::Zero());
    for (std::size_t k = 0; k < path.size(); ++k) {
      // Whole range, a single joint, tiny steps, repetitions, there and back.
      const int kind = static_cast<int>(rng() % 6);
      if (k > 0) path[k] = path[k - 1];
      if (kind == 0 && k > 1) path[k] = path[k - 2];
      if (kind == 1) path[k][static_cast<int>(rng() % 6)] += angle(rng);
      if (kind == 2) path[k][static_cast<int>(rng() % 6)] += std::pow(10.0, -7.0 + 5.0 * unit(rng));
      if (kind >= 3 || k == 0) {
        for (int i = 0; i < 6; ++i) path[k][i] = angle(rng);
      }
    }
    if ((path.front() - path.back()).norm() < 1e-6) path.back()[3] += 0.1;
    const JointTrajectory trajectory = timeParametrize(path, limits, config);
    expectKeepsPromises(path, limits, config, trajectory, "path " + std::to_string(n));
    seconds += trajectory.duration();
  }
  RecordProperty("mean_duration_s", std::to_string(seconds / 1000));
}

TEST(JointTrajectory, RoundingACornerIsFasterThanStoppingThere) {
  const JointPath path = {joints(0, 0, 0, 0, 0, 0), joints(1, 0, 0, 0, 0, 0), joints(1, 1, 0, 0, 0, 0)};
  const MotionLimits limits = urLimits();
  TimingConfig sharp;
  sharp.max_deviation_rad = 1e-6;
  const double stopping = straightTime(path[0], path[1], limits) + straightTime(path[1], path[2], limits);
  // Practically a stop: the corner is passed at millimetres of radius.
  EXPECT_NEAR(timeParametrize(path, limits, sharp).duration(), stopping, 0.02 * stopping);
  EXPECT_LT(timeParametrize(path, limits).duration(), 0.9 * stopping);
}

TEST(JointTrajectory, CornerIsRoundedByTheDeviationAllowedAndNoMore) {
  const JointPath path = {joints(0, 0, 0, 0, 0, 0), joints(1, 0, 0, 0, 0, 0), joints(1, 1, 0, 0, 0, 0)};
  double nearest = 1.0;
  for (const ArmVector& q : roundedPath(path, 1e-4))
    nearest = std::min(nearest, (q - path[1]).lpNorm<Eigen::Infinity>());
  EXPECT_NEAR(nearest, TimingConfig().max_deviation_rad, 1e-4);
}

TEST(JointTrajectory, TurnsBackAtAReversal) {
  const JointPath path = {joints(0, 0, 0, 0, 0, 0), joints(1, 0, 0, 0, 0, 0), joints(0.2, 0, 0, 0, 0, 0)};
  const JointTrajectory trajectory = timeParametrize(path, urLimits());
  double farthest = 0.0;
  double slowest = 1.0;
  for (double t = 0.0; t < trajectory.duration(); t += 1e-4) {
    const TrajectoryPoint point = trajectory.sample(t);
    farthest = std::max(farthest, point.position_rad[0]);
    if (point.position_rad[0] > 0.5) slowest = std::min(slowest, std::abs(point.velocity_rad_s[0]));
  }
  EXPECT_LE(farthest, 1.0);
  EXPECT_GE(farthest, 1.0 - TimingConfig().max_deviation_rad - 1e-3);
  EXPECT_LE(slowest, 1e-3);  // 1e-4 s from the stop at 1.5 rad/s^2
}

TEST(JointTrajectory, JointThatDoesNotMoveStaysExactly) {
  const JointPath path = {joints(0.1, 0.2, 0.3, 0.4, 0.5, 0.6), joints(0.1, 0.2, 1.3, 0.4, 0.5, 0.6)};
  for (const TrajectoryPoint& point : timeParametrize(path, urLimits()).points) {
    EXPECT_EQ(point.position_rad[0], 0.1);
    EXPECT_EQ(point.velocity_rad_s[5], 0.0);
  }
}

TEST(JointTrajectory, WaypointsOnALineCostNoTime) {
  JointPath path;
  for (int k = 0; k <= 50; ++k) path.push_back(joints(0.02 * k, -0.01 * k, 0, 0, 0, 0.005 * k));
  const double exact = straightTime(path.front(), path.back(), urLimits());
  EXPECT_NEAR(timeParametrize(path, urLimits()).duration(), exact, 0.02 * exact);
}

TEST(JointTrajectory, PointsNearerThanAMicroradianAreOne) {
  const JointPath path = {joints(0, 0, 0, 0, 0, 0), joints(5e-7, 0, 0, 0, 0, 0), joints(0, 5e-7, 0, 0, 0, 0)};
  EXPECT_THAT(timeParametrize(path, urLimits()).points, SizeIs(1));
  EXPECT_THAT(timeParametrize({path[0], joints(1.2e-6, 0, 0, 0, 0, 0), joints(4e-7, 0, 0, 0, 0, 0)}, urLimits()).points,
              SizeIs(1));
  const JointTrajectory moves =
      timeParametrize({path[0], joints(1, 0, 0, 0, 0, 0), joints(1, 5e-7, 0, 0, 0, 0)}, urLimits());
  EXPECT_EQ(moves.points.back().position_rad, joints(1, 5e-7, 0, 0, 0, 0));
}

TEST(JointTrajectory, OnePointTakesNoTime) {
  const JointTrajectory trajectory = timeParametrize({joints(1, 2, 3, 4, 5, 6)}, urLimits());
  ASSERT_THAT(trajectory.points, SizeIs(1));
  EXPECT_EQ(trajectory.duration(), 0.0);
  EXPECT_EQ(trajectory.sample(3.0).position_rad, joints(1, 2, 3, 4, 5, 6));
}

/// A planar arm of one link on joint 0, and a lift on joint 1: speed of the point is known.
PointSpeedLimit toyPoint(double speed_m_s) {
  return {[](const ArmVector& q) {
            Eigen::Matrix<double, 3, 6> jacobian = Eigen::Matrix<double, 3, 6>::Zero();
            jacobian(0, 0) = -std::sin(q[0]) * (1.0 + q[1]);
            jacobian(1, 0) = std::cos(q[0]) * (1.0 + q[1]);
            jacobian(0, 1) = std::cos(q[0]);
            jacobian(1, 1) = std::sin(q[0]);
            return jacobian;
          },
          speed_m_s};
}

TEST(JointTrajectory, PointSpeedLimitIsKeptAndUsed) {
  const JointPath path = {joints(0, 0, 0, 0, 0, 0), joints(1.0, 0.5, 0, 0, 0, 0), joints(1.5, -0.2, 0.2, 0, 0, 0)};
  const PointSpeedLimit limit = toyPoint(0.1);
  const JointTrajectory trajectory = timeParametrize(path, urLimits(), {}, limit);
  expectKeepsPromises(path, urLimits(), {}, trajectory, "point speed");
  double fastest = 0.0;
  double travelled = 0.0;
  for (double t = 0.0; t < trajectory.duration(); t += 1e-3) {
    const TrajectoryPoint point = trajectory.sample(t);
    const double speed = (limit.position_jacobian(point.position_rad) * point.velocity_rad_s).norm();
    fastest = std::max(fastest, speed);
    travelled += 1e-3 * speed;
  }
  EXPECT_LE(fastest, 0.1 * 1.005);
  // At this speed all the way but for two short ramps.
  EXPECT_LE(trajectory.duration(), travelled / 0.1 + 0.3);
}

TEST(JointTrajectory, SlowPointTakesTheTimeOfItsSpeed) {
  // 0.1 m at 0.05 m/s: the ramps at 1.5 rad/s^2 take 0.05 / 1.5 s.
  const JointPath path = {joints(0, 0, 0, 0, 0, 0), joints(0, 0.1, 0, 0, 0, 0)};
  EXPECT_NEAR(timeParametrize(path, urLimits(), {}, toyPoint(0.05)).duration(), 2.0 + 0.05 / 1.5, 0.02);
}

TEST(JointTrajectory, RoundedPathIsTheOneThatIsFollowed) {
  std::mt19937_64 rng(3);
  std::uniform_real_distribution<double> angle(-2.0, 2.0);
  for (int n = 0; n < 20; ++n) {
    JointPath path(4, ArmVector::Zero());
    for (ArmVector& q : path) {
      for (int i = 0; i < 6; ++i) q[i] = angle(rng);
    }
    const JointPath dense = roundedPath(path, 0.01);
    EXPECT_EQ(dense.front(), path.front());
    EXPECT_EQ(dense.back(), path.back());
    for (std::size_t i = 0; i + 1 < dense.size(); ++i) {
      ASSERT_LE((dense[i + 1] - dense[i]).lpNorm<Eigen::Infinity>(), 0.01 * (1.0 + 1e-9));
    }
    const JointTrajectory trajectory = timeParametrize(path, urLimits());
    for (double t = 0.0; t < trajectory.duration(); t += 0.02) {
      // Between dense points the blend's sagitta, between trajectory points interpolation: both below 1e-3.
      EXPECT_LE(distanceToPath(trajectory.sample(t).position_rad, dense), 1e-3);
    }
  }
}

TEST(JointTrajectory, AtRestBeforeAndAfter) {
  const JointTrajectory trajectory = timeParametrize({ArmVector::Zero(), ArmVector::Constant(1.0)}, urLimits());
  EXPECT_EQ(trajectory.sample(-1.0).position_rad, ArmVector::Zero());
  EXPECT_EQ(trajectory.sample(-1.0).velocity_rad_s, ArmVector::Zero());
  EXPECT_EQ(trajectory.sample(-1.0).acceleration_rad_s2, ArmVector::Zero());
  EXPECT_EQ(trajectory.sample(1e9).position_rad, ArmVector::Constant(1.0));
  EXPECT_EQ(trajectory.sample(1e9).acceleration_rad_s2, ArmVector::Zero());
  EXPECT_THROW(JointTrajectory().sample(0.0), std::logic_error);
}

TEST(JointTrajectory, RefusesBadArguments) {
  const JointPath path = {ArmVector::Zero(), ArmVector::Constant(1.0)};
  EXPECT_THAT(messageOf<std::invalid_argument>([] { timeParametrize({}, urLimits()); }),
              HasSubstr("path has 0 points"));
  EXPECT_THAT(messageOf<std::invalid_argument>([&] {
                timeParametrize({path[0], ArmVector::Constant(kNaN)}, urLimits());
              }),
              HasSubstr("path[1] has an angle that is not finite"));
  MotionLimits limits = urLimits();
  limits.velocity_rad_s[2] = 0.0;
  limits.acceleration_rad_s2[4] = kNaN;
  const std::string text = messageOf<std::invalid_argument>([&] { timeParametrize(path, limits); });
  EXPECT_THAT(text, HasSubstr("velocity_rad_s[2] = 0 rad/s, must be in [0.001, 100] rad/s"));
  EXPECT_THAT(text, HasSubstr("acceleration_rad_s2[4] = nan"));
  TimingConfig config;
  config.sample_s = 0.0;
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { timeParametrize(path, urLimits(), config); }),
              HasSubstr("sample_s = 0 s"));
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { roundedPath(path, 0.0); }), HasSubstr("step_rad = 0 rad"));
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { timeParametrize(path, urLimits(), {}, toyPoint(0.0)); }),
              HasSubstr("speed_m_s = 0 m/s"));
  EXPECT_THAT(MotionLimits().validate(), IsEmpty());
}

}  // namespace
}  // namespace motion_planning
