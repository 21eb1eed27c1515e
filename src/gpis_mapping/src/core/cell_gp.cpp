// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/cell_gp.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include <Eigen/Cholesky>

namespace gpis_mapping {
namespace {

using ArrayX = Eigen::ArrayXf;

// A normal this uncertain has half the say in the prior mean of a certain one (about 6 degrees).
constexpr float kNormalVarianceScale = 0.01f;

}  // namespace

CellGp::CellGp(const LatticeKey& key, const GpisConfig& config, const std::vector<const SurfacePoint*>& points,
               std::size_t num_own, std::size_t num_training)
    : key_(key),
      kernel_(static_cast<float>(config.surface.length_scale_m), static_cast<float>(config.signalStd())),
      blend_radius_(static_cast<float>(config.surface.blend_radius_m)),
      origin_(config.cells.center(key)),
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
  const auto fail = [&key](const std::string& what) {
    throw std::runtime_error("cell (" + std::to_string(key.x) + ", " + std::to_string(key.y) + ", " +
                             std::to_string(key.z) + "): " + what);
  };
  // The factorisation passes NaN on without complaint.
  for (const ArrayX* array : {&px_, &py_, &pz_, &nx_, &ny_, &nz_, &quality_, &noise_}) {
    if (!array->allFinite()) fail("a training point is not finite");
  }
  const Eigen::Index rows = static_cast<Eigen::Index>(num_training);
  cholesky_.resize(rows, rows);
  alpha_.resize(rows);
  const float a = kernel_.decay();
  const float signal = kernel_.variance();
  const auto fillCovariance = [&](float jitter) {
    ArrayX scaled;
    for (Eigen::Index i = 0; i < rows; ++i) {
      const Eigen::Index below = rows - i;
      scaled = a * ((px_[i] - px_.segment(i, below)).square() + (py_[i] - py_.segment(i, below)).square() +
                    (pz_[i] - pz_.segment(i, below)).square())
                       .sqrt();
      cholesky_.col(i).tail(below) = (signal * (1.0f + scaled) * (-scaled).exp()).matrix();
      cholesky_(i, i) += noise_[i] + jitter;
    }
  };
  ArrayX squares;
  for (Eigen::Index i = 0; i < rows; ++i) {
    squares = (px_[i] - px_).square() + (py_[i] - py_).square() + (pz_[i] - pz_).square();
    alpha_[i] = -priorMean<false>({px_[i], py_[i], pz_[i]}, squares).value;
  }
  if (rows == 0) return;
  // Of points that coincide and claim to be exact, rounding may leave a matrix that is not positive definite. Noise of
  // the size of that rounding mends it; ten times as much each time it does not.
  float jitter = 0.0f;
  for (int attempt = 0; attempt < 8; ++attempt) {
    fillCovariance(jitter);
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXf>, Eigen::Lower> llt(cholesky_);  // in place
    if (llt.info() == Eigen::Success) {
      llt.solveInPlace(alpha_);
      return;
    }
    jitter = attempt == 0 ? std::numeric_limits<float>::epsilon() * signal * static_cast<float>(rows) : 10.0f * jitter;
  }
  fail("covariance of " + std::to_string(rows) + " points is not positive definite");
}

template <bool kWithGradient>
CellGp::Mean CellGp::priorMean(const Eigen::Vector3f& x, const Eigen::ArrayXf& squares) const {
  const float inverse_radius2 = 1.0f / (blend_radius_ * blend_radius_);
  // Only a few points are within the radius: the sums run over those.
  float sum = 0.0f;
  float weighted = 0.0f;
  Eigen::Vector3f weighted_normal = Eigen::Vector3f::Zero();
  Eigen::Vector3f slope_along = Eigen::Vector3f::Zero();  // sum of dw/dx along, without its factor -6 / h^2
  Eigen::Vector3f slope = Eigen::Vector3f::Zero();        // sum of dw/dx, likewise
  for (Eigen::Index i = 0; i < squares.size(); ++i) {
    const float base = 1.0f - inverse_radius2 * squares[i];
    if (base <= 0.0f) continue;
    const Eigen::Vector3f r(x.x() - px_[i], x.y() - py_[i], x.z() - pz_[i]);
    const Eigen::Vector3f n(nx_[i], ny_[i], nz_[i]);
    const float square = quality_[i] * base * base;
    const float weight = square * base;
    const float along = n.dot(r);
    sum += weight;
    weighted += weight * along;
    if constexpr (kWithGradient) {
      weighted_normal += weight * n;
      slope_along += square * along * r;
      slope += square * r;
    }
  }
  if (!(sum > 1e-12f)) return {0.0f, Eigen::Vector3f::Zero(), false};
  const float value = weighted / sum;
  if constexpr (!kWithGradient) return {value, Eigen::Vector3f::Zero(), true};
  // Quotient rule; dw/dx = -(6 / h^2) (1 - d^2/h^2)^2 (x - p).
  return {value, (weighted_normal - 6.0f * inverse_radius2 * (slope_along - value * slope)) / sum, true};
}

template <bool kWithGradient>
CellGp::Mean CellGp::posteriorMean(const Eigen::Vector3d& x_map) const {
  const Eigen::Vector3f x = (x_map - origin_).cast<float>();
  thread_local ArrayX squares, scaled, decay;
  squares = (x.x() - px_).square() + (x.y() - py_).square() + (x.z() - pz_).square();
  Mean result = priorMean<kWithGradient>(x, squares);
  if (!result.valid) return result;
  const Eigen::Index rows = alpha_.size();
  const float a = kernel_.decay();
  scaled = a * squares.head(rows).sqrt();
  decay = alpha_.array() * (-scaled).exp();
  result.value += kernel_.variance() * (decay * (1.0f + scaled)).sum();
  if constexpr (kWithGradient) {
    result.gradient -=
        kernel_.variance() * a * a *
        Eigen::Vector3f((decay * (x.x() - px_.head(rows))).sum(), (decay * (x.y() - py_.head(rows))).sum(),
                        (decay * (x.z() - pz_.head(rows))).sum());
  }
  return result;
}

CellGp::Mean CellGp::mean(const Eigen::Vector3d& x_map) const {
  return posteriorMean<true>(x_map);
}

CellGp::Mean CellGp::meanValue(const Eigen::Vector3d& x_map) const {
  return posteriorMean<false>(x_map);
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
    scaled =
        a * ((x.x() - px_.head(n)).square() + (x.y() - py_.head(n)).square() + (x.z() - pz_.head(n)).square()).sqrt();
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
                       Eigen::Vector3f((weight * (x.x() - px_.head(n))).sum(), (weight * (x.y() - py_.head(n))).sum(),
                                       (weight * (x.z() - pz_.head(n))).sum());
  }
}

std::size_t CellGp::memoryBytes() const {
  return sizeof(*this) + sizeof(float) * static_cast<std::size_t>(8 * px_.size() + alpha_.size() + cholesky_.size());
}

}  // namespace gpis_mapping
