// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/cell_gp.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "cell_kernels.h"

namespace gpis_mapping {
namespace {

// A normal this uncertain has half the say in the prior mean of a certain one (about 6 degrees).
constexpr float kNormalVarianceScale = 0.01f;

enum Array { kX, kY, kZ, kNormalX, kNormalY, kNormalZ, kQuality, kAlpha, kNumArrays };

/// Of this thread, to work in; what it holds is undefined.
float* scratch(int size) {
  thread_local std::vector<float> memory;
  if (memory.size() < static_cast<std::size_t>(size)) memory.resize(static_cast<std::size_t>(size));
  return memory.data();
}

/// Coordinates of places, one array each, as the kernels read them.
class Rows {
 public:
  explicit Rows(const Points3f& x) : count_(static_cast<int>(x.cols())), rows_(padded(count_), 3) {
    rows_.topRows(count_) = x.transpose();
    rows_.bottomRows(stride() - count_).setZero();
  }
  int count() const { return count_; }
  int stride() const { return static_cast<int>(rows_.rows()); }
  const float* x() const { return rows_.col(0).data(); }
  const float* y() const { return rows_.col(1).data(); }
  const float* z() const { return rows_.col(2).data(); }

 private:
  int count_;
  Eigen::MatrixX3f rows_;
};

}  // namespace

CellGp::CellGp(const LatticeKey& key, const GpisConfig& config, const std::vector<const SurfacePoint*>& points,
               std::size_t num_own, std::size_t num_training, const CellKernels& kernels)
    : key_(key),
      kernel_(static_cast<float>(config.surface.length_scale_m), static_cast<float>(config.signalStd())),
      blend_radius_(static_cast<float>(config.surface.blend_radius_m)),
      origin_(config.cells.center(key)),
      num_own_(static_cast<int>(num_own)),
      num_training_(static_cast<int>(num_training)),
      num_points_(static_cast<int>(points.size())),
      kernels_(&kernels) {
  const std::size_t stride = static_cast<std::size_t>(padded(num_points_));
  numbers_.resize((kNumArrays + 1) * stride + static_cast<std::size_t>(packedSize(num_training_)), 0.0f);
  const auto array = [&](int which) { return numbers_.data() + static_cast<std::size_t>(which) * stride; };
  float* const noise = array(kNumArrays);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const SurfacePoint& point = *points[i];
    const Eigen::Vector3f p = (point.position_map - origin_).cast<float>();
    for (int axis = 0; axis < 3; ++axis) {
      array(kX + axis)[i] = p[axis];
      array(kNormalX + axis)[i] = point.normal_map[axis];
    }
    array(kQuality)[i] = kNormalVarianceScale / (kNormalVarianceScale + point.normal_variance);
    noise[i] = point.variance_m2;
  }
  const auto fail = [&key](const std::string& what) {
    throw std::runtime_error("cell (" + std::to_string(key.x) + ", " + std::to_string(key.y) + ", " +
                             std::to_string(key.z) + "): " + what);
  };
  // The factorisation passes NaN on without complaint.
  if (!std::all_of(numbers_.begin(), numbers_.end(), [](float x) { return std::isfinite(x); })) {
    fail("a training point is not finite");
  }
  if (num_training_ == 0) return;
  const CellArrays cell = arrays();
  float* const alpha = array(kAlpha);
  kernels.means(cell, false, cell.x, cell.y, cell.z, num_training_, alpha);
  for (int i = 0; i < num_training_; ++i) alpha[i] = std::isnan(alpha[i]) ? 0.0f : -alpha[i];
  std::fill(alpha + num_training_, alpha + stride, 0.0f);
  // Of points that coincide and claim to be exact, rounding may leave a matrix that is not positive definite. Noise of
  // the size of that rounding mends it; ten times as much each time it does not.
  float* const factor = array(kNumArrays + 1);
  const float least_jitter = std::numeric_limits<float>::epsilon() * cell.signal_variance_m2 * num_training_;
  float jitter = 0.0f;
  for (int attempt = 0; attempt < 8; ++attempt) {
    if (kernels.factorise(cell, noise, jitter, scratch(factorScratch(num_training_)), factor)) {
      kernels.solve(factor, num_training_, alpha);
      return;
    }
    jitter = attempt == 0 ? least_jitter : 10.0f * jitter;
  }
  fail("covariance of " + std::to_string(num_training_) + " points is not positive definite");
}

CellArrays CellGp::arrays() const {
  const int stride = padded(num_points_);
  const auto array = [&](int which) { return numbers_.data() + which * stride; };
  return {num_points_,
          num_training_,
          array(kX),
          array(kY),
          array(kZ),
          array(kNormalX),
          array(kNormalY),
          array(kNormalZ),
          array(kQuality),
          array(kAlpha),
          array(kNumArrays + 1),
          1.0f / (blend_radius_ * blend_radius_),
          kernel_.decay(),
          kernel_.variance()};
}

CellGp::Mean CellGp::mean(const Eigen::Vector3d& x_map) const {
  const Eigen::Vector3f x = (x_map - origin_).cast<float>();
  float place[3][kCellPad];
  for (int axis = 0; axis < 3; ++axis) std::fill_n(place[axis], kCellPad, x[axis]);
  float f[4][kCellPad];
  kernels_->meansWithGradient(arrays(), place[0], place[1], place[2], 1, f[0], f[1], f[2], f[3]);
  if (std::isnan(f[0][0])) return {0.0f, Eigen::Vector3f::Zero(), false};
  return {f[0][0], {f[1][0], f[2][0], f[3][0]}, true};
}

void CellGp::meanValues(const Points3f& x, Eigen::VectorXf* values) const {
  const Rows rows(x);
  values->resize(rows.stride());
  kernels_->means(arrays(), true, rows.x(), rows.y(), rows.z(), rows.count(), values->data());
  values->conservativeResize(x.cols());
}

void CellGp::variance(const Points3d& x_map, Eigen::VectorXf* variance, Points3f* gradient) const {
  const Rows rows((x_map.colwise() - origin_).cast<float>());
  variance->resize(rows.stride());
  Eigen::MatrixX3f slopes;
  if (gradient != nullptr) slopes.resize(rows.stride(), 3);
  const auto slope = [&](int axis) { return gradient != nullptr ? slopes.col(axis).data() : nullptr; };
  kernels_->variances(arrays(), rows.x(), rows.y(), rows.z(), rows.count(), scratch(varianceScratch(num_training_)),
                      variance->data(), slope(0), slope(1), slope(2));
  variance->conservativeResize(x_map.cols());
  if (gradient != nullptr) *gradient = slopes.topRows(x_map.cols()).transpose();
}

Eigen::Vector3f CellGp::vectorAt(int first_array, std::size_t i) const {
  const std::size_t stride = static_cast<std::size_t>(padded(num_points_));
  const float* const p = numbers_.data() + static_cast<std::size_t>(first_array) * stride + i;
  return {p[0], p[stride], p[2 * stride]};
}

Eigen::Vector3d CellGp::position(std::size_t i) const {
  return origin_ + vectorAt(kX, i).cast<double>();
}

Eigen::Vector3f CellGp::normal(std::size_t i) const {
  return vectorAt(kNormalX, i);
}

float CellGp::noiseVariance(std::size_t i) const {
  return numbers_[static_cast<std::size_t>(kNumArrays * padded(num_points_)) + i];
}

std::size_t CellGp::memoryBytes() const {
  return sizeof(*this) + sizeof(float) * numbers_.size();
}

}  // namespace gpis_mapping
