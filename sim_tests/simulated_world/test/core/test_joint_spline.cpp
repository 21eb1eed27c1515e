// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/joint_spline.h"

#include <cmath>
#include <random>
#include <stdexcept>
#include <vector>

#include <Eigen/LU>
#include <gtest/gtest.h>

namespace simulated_world {
namespace {

/// The polynomial of least degree with the given values and derivatives at both ends, by solving for its coefficients.
class PolynomialOracle {
 public:
  /// `start` and `end`: position, then velocity, then acceleration as far as given.
  PolynomialOracle(double T, const std::vector<double>& start, const std::vector<double>& end) {
    const auto order = static_cast<Eigen::Index>(start.size());
    Eigen::MatrixXd conditions(2 * order, 2 * order);
    Eigen::VectorXd values(2 * order);
    for (Eigen::Index d = 0; d < order; ++d) {
      for (Eigen::Index power = 0; power < 2 * order; ++power) {
        conditions(d, power) = derivative(power, d, 0.0);
        conditions(order + d, power) = derivative(power, d, T);
      }
      values[d] = start[static_cast<std::size_t>(d)];
      values[order + d] = end[static_cast<std::size_t>(d)];
    }
    coefficients_ = conditions.fullPivLu().solve(values);
  }

  double value(double t, Eigen::Index derivatives) const {
    double sum = 0.0;
    for (Eigen::Index power = 0; power < coefficients_.size(); ++power) {
      sum += coefficients_[power] * derivative(power, derivatives, t);
    }
    return sum;
  }

 private:
  /// The d-th derivative of t^power.
  static double derivative(Eigen::Index power, Eigen::Index d, double t) {
    double factor = 1.0;
    for (Eigen::Index i = 0; i < d; ++i) {
      factor *= static_cast<double>(power - i);
    }
    return power < d ? 0.0 : factor * std::pow(t, static_cast<double>(power - d));
  }

  Eigen::VectorXd coefficients_;
};

JointWaypoint waypoint(double time_s, const std::vector<double>& state) {
  const auto one = [](double value) { return Eigen::VectorXd::Constant(1, value); };
  JointWaypoint point;
  point.time_s = time_s;
  point.position_rad = one(state[0]);
  if (state.size() > 1) point.velocity_rad_s = one(state[1]);
  if (state.size() > 2) point.acceleration_rad_s2 = one(state[2]);
  return point;
}

TEST(JointSpline, IsThePolynomialThroughBothPoints) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> value(-2.0, 2.0);
  for (std::size_t order = 1; order <= 3; ++order) {
    for (int example = 0; example < 50; ++example) {
      const double T = 0.3 + 0.5 * std::abs(value(random));
      std::vector<double> start;
      std::vector<double> end;
      for (std::size_t d = 0; d < order; ++d) {
        start.push_back(value(random));
        end.push_back(value(random));
      }
      const double start_s = value(random);
      const JointSpline spline(waypoint(start_s, start), waypoint(start_s + T, end));
      const PolynomialOracle oracle(T, start, end);
      for (double t = 0.0; t < T; t += 0.05) {
        const JointMotion motion = spline.sample(start_s + t);
        // Rounding of the oracle's system of equations, whose condition is about 1e4 at T = 0.3 s.
        EXPECT_NEAR(motion.position_rad[0], oracle.value(t, 0), 1e-9) << order;
        EXPECT_NEAR(motion.velocity_rad_s[0], oracle.value(t, 1), 1e-8) << order;
        EXPECT_NEAR(motion.acceleration_rad_s2[0], oracle.value(t, 2), 1e-7) << order;
      }
    }
  }
}

TEST(JointSpline, UsesOnlyWhatBothPointsGive) {
  const JointSpline line(waypoint(0.0, {0.0, 5.0}), waypoint(2.0, {1.0}));
  EXPECT_NEAR(line.sample(0.5).position_rad[0], 0.25, 1e-12);  // rounding
  EXPECT_NEAR(line.sample(0.5).velocity_rad_s[0], 0.5, 1e-12);
  const JointSpline cubic(waypoint(0.0, {0.0, 0.0, 9.0}), waypoint(2.0, {1.0, 0.0}));
  EXPECT_NEAR(cubic.sample(1.0).position_rad[0], 0.5, 1e-12);
  EXPECT_NEAR(cubic.sample(1.0).velocity_rad_s[0], 0.75, 1e-12);  // 3/2 of the mean speed
}

TEST(JointSpline, RestsOutsideItsTime) {
  const JointSpline spline(waypoint(1.0, {0.5, 1.0}), waypoint(2.0, {1.5, 1.0}));
  EXPECT_EQ(spline.sample(0.9).position_rad[0], 0.5);
  EXPECT_EQ(spline.sample(0.9).velocity_rad_s[0], 0.0);
  EXPECT_NEAR(spline.sample(2.1).position_rad[0], 1.5, 1e-12);  // rounding
  EXPECT_EQ(spline.sample(2.1).velocity_rad_s[0], 0.0);
}

TEST(JointSpline, RefusesWhatIsNoMotion) {
  EXPECT_THROW(JointSpline(waypoint(1.0, {0.0}), waypoint(1.0, {0.0})), std::invalid_argument);
  JointWaypoint two = waypoint(1.0, {0.0});
  two.position_rad = Eigen::Vector2d::Zero();
  EXPECT_THROW(JointSpline(waypoint(0.0, {0.0}), two), std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
