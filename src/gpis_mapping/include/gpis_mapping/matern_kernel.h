// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_MATERN_KERNEL_H
#define GPIS_MAPPING_MATERN_KERNEL_H

#include <cmath>

#include <Eigen/Core>

namespace gpis_mapping {

/// Matern 3/2 covariance (eq 4) and its derivatives. With r = x - x', d = |r|, a = sqrt(3)/l: k = s^2 (1 + a d) exp(-a
/// d). s is the signal standard deviation [m], l the length scale [m].
template <typename Scalar>
class MaternKernel {
 public:
  using Vector = Eigen::Matrix<Scalar, 3, 1>;

  MaternKernel(Scalar length_scale_m, Scalar signal_std_m)
      : a_(std::sqrt(Scalar(3)) / length_scale_m), variance_(signal_std_m * signal_std_m) {}

  Scalar variance() const { return variance_; }  // k(x, x) [m^2]
  Scalar decay() const { return a_; }            // a [1/m]

  Scalar value(Scalar d) const { return variance_ * (Scalar(1) + a_ * d) * std::exp(-a_ * d); }

  /// dk/dx for r = x - x': eq 11 in the direction of r.
  Vector gradient(const Vector& r) const { return -variance_ * a_ * a_ * std::exp(-a_ * r.norm()) * r; }

 private:
  Scalar a_;
  Scalar variance_;
};

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_MATERN_KERNEL_H
