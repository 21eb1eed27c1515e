// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_TEST_EIGEN_ASSERTS_H
#define GPIS_MAPPING_TEST_EIGEN_ASSERTS_H

#include <Eigen/Core>
#include <gtest/gtest.h>

namespace gpis_mapping_test {

/// Every coefficient within `tolerance`; both sides are printed when not. NaN never matches.
template <typename A, typename B>
testing::AssertionResult isNear(const Eigen::MatrixBase<A>& actual, const Eigen::MatrixBase<B>& expected,
                                double tolerance) {
  const Eigen::MatrixXd a = actual.template cast<double>();
  const Eigen::MatrixXd b = expected.template cast<double>();
  if (a.rows() != b.rows() || a.cols() != b.cols()) {
    return testing::AssertionFailure() << a.rows() << " x " << a.cols() << ", expected " << b.rows() << " x "
                                       << b.cols();
  }
  const double worst = a.size() == 0 ? 0.0 : (a - b).cwiseAbs().maxCoeff();
  if ((a - b).allFinite() && worst <= tolerance) return testing::AssertionSuccess();
  return testing::AssertionFailure() << "differs by " << worst << " > " << tolerance << ":\n"
                                     << a.transpose() << "\nexpected\n"
                                     << b.transpose();
}

/// d function / dx by central differences.
template <typename Function>
Eigen::Vector3d centralDifference(const Function& function, const Eigen::Vector3d& x, double step) {
  Eigen::Vector3d result;
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d offset = step * Eigen::Vector3d::Unit(axis);
    const Eigen::Vector3d above = x + offset;
    const Eigen::Vector3d below = x - offset;
    result[axis] = (function(above) - function(below)) / (above[axis] - below[axis]);  // the step after rounding
  }
  return result;
}

}  // namespace gpis_mapping_test

#endif  // GPIS_MAPPING_TEST_EIGEN_ASSERTS_H
