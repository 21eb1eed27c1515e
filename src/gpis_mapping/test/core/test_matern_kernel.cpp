// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/matern_kernel.h"

#include <cmath>
#include <random>
#include <vector>

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include "analytic_surfaces.h"
#include "eigen_asserts.h"

namespace gpis_mapping {
namespace {

using gpis_mapping_test::centralDifference;
using gpis_mapping_test::isNear;
using gpis_mapping_test::randomUnit;
using gpis_mapping_test::randomVector;

constexpr double kLength = 0.05;  // m
constexpr double kSignal = 0.03;  // m

const MaternKernel<double>& kernel() {
  static const MaternKernel<double> kKernel(kLength, kSignal);
  return kKernel;
}

/// Separations from a nanometre to ten length scales, in random directions, and zero.
std::vector<Eigen::Vector3d> separations() {
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> exponent(-9.0, std::log10(10.0 * kLength));
  std::vector<Eigen::Vector3d> result{Eigen::Vector3d::Zero()};
  for (int i = 0; i < 500; ++i) result.push_back(std::pow(10.0, exponent(rng)) * randomUnit(&rng));
  return result;
}

TEST(MaternKernel, ValueMatchesItsDefinition) {
  EXPECT_DOUBLE_EQ(kernel().value(0.0), kSignal * kSignal);
  EXPECT_DOUBLE_EQ(kernel().variance(), kSignal * kSignal);
  for (const Eigen::Vector3d& r : separations()) {
    const double x = std::sqrt(3.0) * r.norm() / kLength;
    // 1e-14: a handful of roundings.
    EXPECT_NEAR(kernel().value(r.norm()), kSignal * kSignal * (1.0 + x) * std::exp(-x), 1e-14 * kSignal * kSignal);
  }
  // One length scale apart: (1 + sqrt 3) exp(-sqrt 3) = 0.4833577..., worked out by hand.
  EXPECT_NEAR(kernel().value(kLength) / kernel().variance(), 0.48335772, 1e-8);
}

TEST(MaternKernel, GradientMatchesEquation11) {
  for (const Eigen::Vector3d& r : separations()) {
    const double slope = 3.0 / (kLength * kLength) * std::exp(-std::sqrt(3.0) * r.norm() / kLength);
    const Eigen::Vector3d expected = -kSignal * kSignal * slope * r;
    EXPECT_TRUE(isNear(kernel().gradient(r), expected, 1e-13 * expected.norm())) << "at " << r.transpose();
  }
}

TEST(MaternKernel, GradientMatchesCentralDifferenceAndPointsTowardsTheOtherPoint) {
  for (const Eigen::Vector3d& r : separations()) {
    const auto value = [](const Eigen::Vector3d& x) { return kernel().value(x.norm()); };
    const double step = 1e-7;
    const Eigen::Vector3d gradient = kernel().gradient(r);
    // Truncation step^2 k''' / 6 (k''' at most 2 a^3 s^2), rounding eps k / step, and 1e-6 of the gradient itself. Below the
    // step the kernel is quadratic and only rounding counts.
    const double bound = 1e-6 * gradient.norm() + step * step * std::pow(kernel().decay(), 3) * kernel().variance() +
                         4e-16 * kernel().variance() / step;
    EXPECT_TRUE(isNear(gradient, centralDifference(value, r, step), bound)) << "at " << r.transpose();
    if (r.norm() > 0.0) {
      EXPECT_LE(gradient.dot(r), 0.0);
    }
  }
}

TEST(MaternKernel, CovarianceOfValuesIsPositiveSemidefinite) {
  std::mt19937 rng(2);
  for (int trial = 0; trial < 5; ++trial) {
    std::vector<Eigen::Vector3d> x;
    for (int i = 0; i < 30; ++i) x.push_back(randomVector(&rng, -0.05, 0.05));
    x.push_back(x[0] + Eigen::Vector3d::Constant(1e-5));  // nearly the same point twice
    const Eigen::MatrixXd k = Eigen::MatrixXd::NullaryExpr(31, 31, [&x](Eigen::Index i, Eigen::Index j) {
      return kernel().value((x[static_cast<std::size_t>(i)] - x[static_cast<std::size_t>(j)]).norm());
    });
    const Eigen::VectorXd eigenvalues = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(k).eigenvalues();
    // 1e-13: rounding of the eigenvalue solver relative to the largest one.
    EXPECT_GT(eigenvalues.minCoeff(), -1e-13 * eigenvalues.maxCoeff());
  }
}

TEST(MaternKernel, FloatAgreesWithDouble) {
  const MaternKernel<float> single(static_cast<float>(kLength), static_cast<float>(kSignal));
  for (const Eigen::Vector3d& r : separations()) {
    // exp amplifies the rounding of its argument (up to 17 here, eps 6e-8) while its value falls below it.
    EXPECT_NEAR(single.value(static_cast<float>(r.norm())), kernel().value(r.norm()), 1e-6 * kernel().variance());
    EXPECT_TRUE(isNear(single.gradient(r.cast<float>()), kernel().gradient(r), 1e-6 * kSignal));
  }
}

}  // namespace
}  // namespace gpis_mapping
