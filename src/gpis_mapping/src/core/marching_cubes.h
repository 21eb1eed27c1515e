// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_MARCHING_CUBES_H
#define GPIS_MAPPING_MARCHING_CUBES_H

#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace gpis_mapping {

/// Where a function on a cubic lattice is zero.
struct Contour {
  std::vector<std::array<float, 3>> vertices;           // [voxels]
  std::vector<Eigen::Vector3f> normals;                 // unit, towards larger values: differences along the lattice
  std::vector<std::array<std::uint32_t, 3>> triangles;  // as VTK's table orders them
};

/// `values`: at (voxels + 1)^3 corners, `wanted`: which of voxels^3 cubes to look at, x fastest. Cubes with a corner
/// that is NaN are left out.
Contour contourOf(std::vector<float> values, const std::vector<std::uint8_t>& wanted, int voxels);

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_MARCHING_CUBES_H
