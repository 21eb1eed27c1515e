// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_CELL_GP_H
#define GPIS_MAPPING_CELL_GP_H

#include <cstdint>
#include <limits>
#include <vector>

#include <Eigen/Core>

#include "gpis_mapping/gpis_config.h"
#include "gpis_mapping/matern_kernel.h"
#include "gpis_mapping/types.h"

namespace gpis_mapping {

/// A training point of the map: a small piece of surface.
struct SurfacePoint {
  Eigen::Vector3d position_map;
  Eigen::Vector3f normal_map;   // unit, towards free space
  float variance_m2{0.0f};      // of the position along the normal
  float normal_variance{0.0f};  // of each tangential component of the normal
  float last_seen_s{0.0f};      // since the map's epoch
  // Where the camera stood when it last measured the point, map frame; NaN after a restore. Not saved.
  Eigen::Vector3f seen_from_map = Eigen::Vector3f::Constant(std::numeric_limits<float>::quiet_NaN());
  std::uint16_t num_looks{1};
  std::uint16_t num_misses{0};  // looks since the last confirmation that spoke against it without deciding
};

struct CellArrays;
struct CellKernels;

/// The arithmetic for this processor (src/core/cell_kernels.h).
const CellKernels& cellKernels();

/// The GP of one cell (eq 3): observations f(p_i) = 0 with noise, prior mean from the local normals
///   m(x) = sum_i w_i(x) n_i . (x - p_i) / sum_i w_i(x),   w_i = q_i (1 - |x - p_i|^2 / h^2)^3 inside h,
/// and Matern 3/2 covariance: f(x) = m(x) - k*^T (K + K_x)^-1 m(X). The mean carries what derivative observations of
/// the surface normal would (n rows instead of 4 n). It is linear across a plane. So f does not return to a constant a
/// few centimetres inside an object. Immutable once built.
class CellGp {
 public:
  struct Mean {
    float value;               // f [m], positive outside
    Eigen::Vector3f gradient;  // df/dx
    bool valid;                // false: no training point within the blend radius
  };

  /// `points` has first the `num_own` points of the cell, then the rest of the `num_training` that train the GP. Then
  /// come those that only shape the prior mean. Throws std::runtime_error naming the cell if a point is not finite or
  /// the covariance is not positive definite.
  CellGp(const LatticeKey& key, const GpisConfig& config, const std::vector<const SurfacePoint*>& points,
         std::size_t num_own, std::size_t num_training, const CellKernels& kernels = cellKernels());

  const LatticeKey& key() const { return key_; }
  std::size_t size() const { return static_cast<std::size_t>(num_points_); }
  std::size_t numTraining() const { return static_cast<std::size_t>(num_training_); }
  std::size_t numOwn() const { return static_cast<std::size_t>(num_own_); }

  /// Posterior mean at one point.
  Mean mean(const Eigen::Vector3d& x_map) const;
  /// Its value at N points relative to the cell's centre [m], NaN where it is not valid: a tenth of the time per point.
  void meanValues(const Points3f& x, Eigen::VectorXf* values) const;

  /// Posterior variance [m^2] at N points and, when `gradient` is not null, its derivative [m]
  /// (sec. 7: -2 (grad k*)^T (K + K_x)^-1 k*). Shapes N and 3 x N.
  void variance(const Points3d& x_map, Eigen::VectorXf* variance, Points3f* gradient) const;

  Eigen::Vector3d position(std::size_t i) const;
  Eigen::Vector3f normal(std::size_t i) const;
  float noiseVariance(std::size_t i) const;

  std::size_t memoryBytes() const;

  /// For the kernels; valid as long as the cell.
  CellArrays arrays() const;
  const CellKernels& kernels() const { return *kernels_; }

 private:
  Eigen::Vector3f vectorAt(int first_array, std::size_t i) const;

  LatticeKey key_;
  MaternKernel<float> kernel_;
  float blend_radius_;
  Eigen::Vector3d origin_;  // the cell's centre: positions are relative to it, so that floats suffice anywhere
  int num_own_;
  int num_training_;
  int num_points_;
  const CellKernels* kernels_;
  std::vector<float> numbers_;  // arrays of the points, then the packed factor of K + K_x
};

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_CELL_GP_H
