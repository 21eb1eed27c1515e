// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_TEST_DENSE_GP_H
#define GPIS_MAPPING_TEST_DENSE_GP_H

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Dense>

#include "gpis_mapping/cell_gp.h"
#include "gpis_mapping/gpis_config.h"

namespace gpis_mapping_test {

/// Matern 3/2 from its definition, in double: an oracle must not call the code under test.
struct DenseKernel {
  double length_m;
  double signal_std_m;

  double a() const { return std::sqrt(3.0) / length_m; }
  double s2() const { return signal_std_m * signal_std_m; }
  double value(const Eigen::Vector3d& r) const { return s2() * (1.0 + a() * r.norm()) * std::exp(-a() * r.norm()); }
  /// Covariance of (f, df/dx)(x) with (f, df/dx')(x'), r = x - x' (table of method section 1).
  Eigen::Matrix4d joint(const Eigen::Vector3d& r) const {
    const double d = r.norm();
    const double e = s2() * a() * a() * std::exp(-a() * d);
    Eigen::Matrix4d k;
    k(0, 0) = value(r);
    for (int i = 0; i < 3; ++i) {
      k(i + 1, 0) = -e * r[i];
      k(0, i + 1) = e * r[i];
      for (int j = 0; j < 3; ++j)
        k(i + 1, j + 1) = e * ((i == j ? 1.0 : 0.0) - (d > 0.0 ? a() * r[i] * r[j] / d : 0.0));
    }
    return k;
  }
};

inline DenseKernel denseKernel(const gpis_mapping::GpisConfig& config) {
  return {config.surface.length_scale_m, config.surface.signal_std_m > 0.0
                                             ? config.surface.signal_std_m
                                             : config.surface.length_scale_m / std::sqrt(3.0)};
}

/// The cell's GP once more: n value rows, prior mean from the tangent planes; dense, double, LDLT.
class DenseCellGp {
 public:
  DenseCellGp(const gpis_mapping::GpisConfig& config, const std::vector<const gpis_mapping::SurfacePoint*>& points,
              std::size_t num_training)
      : kernel_(denseKernel(config)), radius_(config.surface.blend_radius_m), points_(points), rows_(num_training) {
    const Eigen::Index n = static_cast<Eigen::Index>(rows_);
    Eigen::MatrixXd k(n, n);
    Eigen::VectorXd residual(n);
    for (std::size_t i = 0; i < rows_; ++i) {
      for (std::size_t j = 0; j < rows_; ++j) {
        k(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) =
            kernel_.value(points_[i]->position_map - points_[j]->position_map) +
            (i == j ? static_cast<double>(points_[i]->variance_m2) : 0.0);
      }
      residual[static_cast<Eigen::Index>(i)] = 0.0 - priorMean(points_[i]->position_map);
    }
    solver_.compute(k);
    alpha_ = solver_.solve(residual);
  }

  bool hasPriorMean(const Eigen::Vector3d& x) const { return weightSum(x) > 0.0; }
  double weightSum(const Eigen::Vector3d& x) const {
    double sum = 0.0;
    for (const auto* point : points_) sum += weight(*point, x);
    return sum;
  }
  double priorMean(const Eigen::Vector3d& x) const {
    double sum = 0.0;
    double weighted = 0.0;
    for (const auto* point : points_) {
      const double w = weight(*point, x);
      sum += w;
      weighted += w * point->normal_map.cast<double>().dot(x - point->position_map);
    }
    return weighted / sum;
  }
  double mean(const Eigen::Vector3d& x) const { return priorMean(x) + cross(x).dot(alpha_); }
  double variance(const Eigen::Vector3d& x) const {
    const Eigen::VectorXd k = cross(x);
    return kernel_.s2() - k.dot(solver_.solve(k));
  }

 private:
  double weight(const gpis_mapping::SurfacePoint& point, const Eigen::Vector3d& x) const {
    const double base = 1.0 - (x - point.position_map).squaredNorm() / (radius_ * radius_);
    // A normal with variance 0.01 (0.1 rad) has half the say of a certain one.
    return base <= 0.0 ? 0.0 : 0.01 / (0.01 + static_cast<double>(point.normal_variance)) * base * base * base;
  }
  Eigen::VectorXd cross(const Eigen::Vector3d& x) const {
    Eigen::VectorXd k(static_cast<Eigen::Index>(rows_));
    for (std::size_t i = 0; i < rows_; ++i)
      k[static_cast<Eigen::Index>(i)] = kernel_.value(x - points_[i]->position_map);
    return k;
  }

  DenseKernel kernel_;
  double radius_;
  std::vector<const gpis_mapping::SurfacePoint*> points_;
  std::size_t rows_;
  Eigen::LDLT<Eigen::MatrixXd> solver_;
  Eigen::VectorXd alpha_;
};

/// The GPIS of the literature: constant prior mean m0, every point a value row (0) and three gradient rows (its normal).
class DenseGpis {
 public:
  DenseGpis(const gpis_mapping::GpisConfig& config, const std::vector<const gpis_mapping::SurfacePoint*>& points,
            double prior_mean_m)
      : kernel_(denseKernel(config)), points_(points), prior_mean_(prior_mean_m) {
    const Eigen::Index n = static_cast<Eigen::Index>(points_.size());
    Eigen::MatrixXd k(4 * n, 4 * n);
    Eigen::VectorXd y(4 * n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const gpis_mapping::SurfacePoint& point = *points_[static_cast<std::size_t>(i)];
      for (Eigen::Index j = 0; j < n; ++j) {
        k.block<4, 4>(4 * i, 4 * j) =
            kernel_.joint(point.position_map - points_[static_cast<std::size_t>(j)]->position_map);
      }
      k(4 * i, 4 * i) += static_cast<double>(point.variance_m2);
      for (int axis = 1; axis < 4; ++axis) k(4 * i + axis, 4 * i + axis) += static_cast<double>(point.normal_variance);
      y[4 * i] = -prior_mean_;
      y.segment<3>(4 * i + 1) = point.normal_map.cast<double>();
    }
    alpha_ = k.ldlt().solve(y);
  }

  double mean(const Eigen::Vector3d& x) const {
    double sum = prior_mean_;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      sum +=
          kernel_.joint(x - points_[i]->position_map).row(0).dot(alpha_.segment<4>(4 * static_cast<Eigen::Index>(i)));
    }
    return sum;
  }

 private:
  DenseKernel kernel_;
  std::vector<const gpis_mapping::SurfacePoint*> points_;
  double prior_mean_;
  Eigen::VectorXd alpha_;
};

/// One tile of the 2.5D^-1 map once more: linear least-squares trend, Ornstein-Uhlenbeck residual over bearings.
class DenseFrameTile {
 public:
  struct Posterior {
    double mean;
    double variance;
  };

  /// `values`: window x window, row major, of the image from pixel (start_u, start_v) on.
  DenseFrameTile(const gpis_mapping::CameraModel& camera, double alpha, double prior_variance, double noise_variance,
                 int window, int start_u, int start_v, const std::vector<double>& values)
      : camera_(camera), alpha_(alpha), prior_variance_(prior_variance) {
    const Eigen::Index n = window * window;
    Eigen::MatrixXd basis(n, 3);
    Eigen::VectorXd y(n);
    Eigen::MatrixXd k(n, n);
    for (Eigen::Index i = 0; i < n; ++i) {
      pixels_.emplace_back(start_u + static_cast<double>(i % window), start_v + static_cast<double>(i / window));
      basis.row(i) << 1.0, pixels_.back().x(), pixels_.back().y();
      y[i] = values[static_cast<std::size_t>(i)];
    }
    for (Eigen::Index i = 0; i < n; ++i) {
      for (Eigen::Index j = 0; j < n; ++j) {
        k(i, j) = covariance(pixels_[static_cast<std::size_t>(i)], pixels_[static_cast<std::size_t>(j)]) +
                  (i == j ? noise_variance : 0.0);
      }
    }
    trend_ = basis.colPivHouseholderQr().solve(y);
    solver_.compute(k);
    weights_ = solver_.solve(y - basis * trend_);
  }

  Posterior infer(double u, double v) const {
    Eigen::VectorXd cross(static_cast<Eigen::Index>(pixels_.size()));
    for (std::size_t i = 0; i < pixels_.size(); ++i) {
      cross[static_cast<Eigen::Index>(i)] = covariance({u, v}, pixels_[i]);
    }
    return {trend_[0] + trend_[1] * u + trend_[2] * v + cross.dot(weights_),
            prior_variance_ - cross.dot(solver_.solve(cross))};
  }

 private:
  double covariance(const Eigen::Vector2d& a, const Eigen::Vector2d& b) const {
    const Eigen::Vector2d bearing((a.x() - b.x()) / camera_.fx, (a.y() - b.y()) / camera_.fy);
    return prior_variance_ * std::exp(-alpha_ * bearing.norm());
  }

  gpis_mapping::CameraModel camera_;
  double alpha_;
  double prior_variance_;
  std::vector<Eigen::Vector2d> pixels_;
  Eigen::Vector3d trend_;
  Eigen::LDLT<Eigen::MatrixXd> solver_;
  Eigen::VectorXd weights_;
};

}  // namespace gpis_mapping_test

#endif  // GPIS_MAPPING_TEST_DENSE_GP_H
