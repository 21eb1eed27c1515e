// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/cell_gp.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <Eigen/Cholesky>

namespace gpis_mapping {
namespace {

using ArrayX = Eigen::ArrayXf;

// A normal this uncertain has half the say in the prior mean of a certain one (about 6 degrees).
constexpr float kNormalVarianceScale = 0.01f;

}  // namespace

CellGp::CellGp(const LatticeKey& key, const GpisConfig& config, const std::vector<const SurfacePoint*>& points,
               std::size_t num_own)
    : key_(key),
      kernel_(static_cast<float>(config.surface.length_scale_m), static_cast<float>(config.signalStd())),
      blend_radius_(static_cast<float>(config.surface.blend_radius_m)),
      origin_(key.center(config.cells.size_m)),
      num_own_(num_own) {
  const Eigen::Index n = static_cast<Eigen::Index>(points.size());
  for (ArrayX* array : {&px_, &py_, &pz_, &nx_, &ny_, &nz_, &quality_, &noise_}) array->resize(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const SurfacePoint& point = *points[static_cast<std::size_t>(i)];
    const Eigen::Vector3f p = (point.position_map - origin_).cast<float>();
    px_[i] = p.x();
    py_[i] = p.y();
    pz_[i] = p.z();
    nx_[i] = point.normal_map.x();
    ny_[i] = point.normal_map.y();
    nz_[i] = point.normal_map.z();
    quality_[i] = kNormalVarianceScale / (kNormalVarianceScale + point.normal_variance);
    noise_[i] = point.variance_m2;
  }
  cholesky_.resize(n, n);
  alpha_.resize(n);
  const float a = kernel_.decay();
  const float signal = kernel_.variance();
  ArrayX dx, dy, dz, squared, scaled;
  for (Eigen::Index i = 0; i < n; ++i) {
    dx = px_[i] - px_;
    dy = py_[i] - py_;
    dz = pz_[i] - pz_;
    squared = dx.square() + dy.square() + dz.square();
    const Eigen::Index below = n - i;
    scaled = a * squared.tail(below).sqrt();
    cholesky_.col(i).tail(below) = (signal * (1.0f + scaled) * (-scaled).exp()).matrix();
    cholesky_(i, i) += noise_[i];
    alpha_[i] = -priorMean(dx, dy, dz, squared).value;
  }
  if (n > 0) {
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXf>, Eigen::Lower> llt(cholesky_);  // in place
    if (llt.info() != Eigen::Success || !alpha_.allFinite()) {
      throw std::runtime_error("cell (" + std::to_string(key.x) + ", " + std::to_string(key.y) + ", " +
                               std::to_string(key.z) + "): covariance of " + std::to_string(n) +
                               " points is not positive definite");
    }
    llt.solveInPlace(alpha_);
  }
}

CellGp::Mean CellGp::priorMean(const ArrayX& dx, const ArrayX& dy, const ArrayX& dz, const ArrayX& squared) const {
  const float inverse_radius2 = 1.0f / (blend_radius_ * blend_radius_);
  thread_local ArrayX base, weight, slope, along;
  base = (1.0f - inverse_radius2 * squared).max(0.0f);
  slope = quality_ * base.square();
  weight = slope * base;
  const float sum = weight.sum();
  if (!(sum > 1e-12f)) return {0.0f, Eigen::Vector3f::Zero(), false};
  along = nx_ * dx + ny_ * dy + nz_ * dz;
  const float value = (weight * along).sum() / sum;
  // Quotient rule; dw/dx = -(6 / h^2) (1 - d^2/h^2)^2 (x - p).
  slope *= -6.0f * inverse_radius2 * (along - value);
  const Eigen::Vector3f gradient((weight * nx_ + slope * dx).sum(), (weight * ny_ + slope * dy).sum(),
                                 (weight * nz_ + slope * dz).sum());
  return {value, gradient / sum, true};
}

CellGp::Mean CellGp::mean(const Eigen::Vector3d& x_map) const {
  const Eigen::Vector3f x = (x_map - origin_).cast<float>();
  thread_local ArrayX dx, dy, dz, squared, scaled, decay;
  dx = x.x() - px_;
  dy = x.y() - py_;
  dz = x.z() - pz_;
  squared = dx.square() + dy.square() + dz.square();
  Mean result = priorMean(dx, dy, dz, squared);
  if (!result.valid) return result;
  const float a = kernel_.decay();
  scaled = a * squared.sqrt();
  decay = alpha_.array() * (-scaled).exp();
  result.value += kernel_.variance() * (decay * (1.0f + scaled)).sum();
  result.gradient -= kernel_.variance() * a * a *
                     Eigen::Vector3f((decay * dx).sum(), (decay * dy).sum(), (decay * dz).sum());
  return result;
}

void CellGp::variance(const Points3d& x_map, Eigen::VectorXf* variance, Points3f* gradient) const {
  const Eigen::Index n = alpha_.size();
  const Eigen::Index count = x_map.cols();
  const float a = kernel_.decay();
  const float signal = kernel_.variance();
  Eigen::MatrixXf cross(n, count);
  Eigen::MatrixXf decay;
  if (gradient != nullptr) decay.resize(n, count);
  ArrayX scaled(n);
  for (Eigen::Index c = 0; c < count; ++c) {
    const Eigen::Vector3f x = (x_map.col(c) - origin_).cast<float>();
    scaled = a * ((x.x() - px_).square() + (x.y() - py_).square() + (x.z() - pz_).square()).sqrt();
    const ArrayX e = (-scaled).exp();
    cross.col(c) = (signal * (1.0f + scaled) * e).matrix();
    if (gradient != nullptr) decay.col(c) = e.matrix();
  }
  const auto lower = cholesky_.triangularView<Eigen::Lower>();
  lower.solveInPlace(cross);
  *variance = (signal - cross.colwise().squaredNorm().array()).max(0.0f).matrix().transpose();
  if (gradient == nullptr) return;
  lower.transpose().solveInPlace(cross);  // now (K + K_x)^-1 k*
  gradient->resize(3, count);
  for (Eigen::Index c = 0; c < count; ++c) {
    const Eigen::Vector3f x = (x_map.col(c) - origin_).cast<float>();
    const ArrayX weight = cross.col(c).array() * decay.col(c).array();
    gradient->col(c) = 2.0f * signal * a * a *
                       Eigen::Vector3f((weight * (x.x() - px_)).sum(), (weight * (x.y() - py_)).sum(),
                                       (weight * (x.z() - pz_)).sum());
  }
}

std::size_t CellGp::memoryBytes() const {
  return sizeof(*this) + sizeof(float) * static_cast<std::size_t>(9 * alpha_.size() + cholesky_.size());
}

}  // namespace gpis_mapping
