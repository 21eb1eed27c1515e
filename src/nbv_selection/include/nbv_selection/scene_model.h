// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <gpis_mapping/ground_projection.h>
#include <gpis_mapping/types.h>

namespace nbv_selection {

/// A surface as a map shows it: samples at most about half a grid cell apart. Frame: map.
struct MappedSurface {
  std::vector<Eigen::Vector3d> points_map;   // [m]
  std::vector<Eigen::Vector3f> normals_map;  // unit, into free space; as many
  std::vector<float> uncertainty;            // of each point, in the units of SceneModel::uncertainty(); as many
  std::uint64_t update{0};                   // images in the map
  double stamp_s{0.0};                       // of the last of them
};

/// A map's uncertainty u and how it changes at N points.
struct UncertaintyField {
  Eigen::VectorXd value;            // u; NaN: the map has no answer
  gpis_mapping::Points3d gradient;  // du / dx [u / m]
};

/// What stands at N points, as eq 14 asks.
struct OccupancyField {
  Eigen::VectorXd probability;     // that the point is inside of something, in [0, 1]
  gpis_mapping::Points3d normal;   // unit, outwards, of the nearest surface
  std::vector<bool> is_supported;  // false: the map has no data here, probability and normal mean nothing
};

/// What a strategy may ask its map. Every answer is of one state of the map; two answers may be of two.
/// Implementations throw std::runtime_error, in words for the user, if the map does not answer.
class SceneModel {
 public:
  virtual ~SceneModel() = default;

  virtual MappedSurface surface() const = 0;
  virtual UncertaintyField uncertainty(const gpis_mapping::Points3d& points_map) const = 0;
  virtual OccupancyField occupancy(const gpis_mapping::Points3d& points_map) const = 0;

  /// u where nothing was ever seen, > 0: the variance of the prior [m^2], or the entropy of an unknown voxel [bit].
  virtual double priorUncertainty() const = 0;
};

}  // namespace nbv_selection
