// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_PARTITION_OF_UNITY_H
#define GPIS_MAPPING_PARTITION_OF_UNITY_H

#include <Eigen/Core>

#include "gpis_mapping/gpis_config.h"
#include "gpis_mapping/types.h"

namespace gpis_mapping {

/// Share of one lattice cell in the value at a point, with its derivative.
struct BlendWeight {
  LatticeKey key;
  double weight;             // all weights of a point sum to 1
  Eigen::Vector3d gradient;  // d weight / dx [1/m]; all gradients of a point sum to 0
};

/// Smooth (C2) partition of unity over the lattice of cells. Inside a cell its own weight is 1. Across a band of half
/// width `blend_margin_m` round each face the neighbours' weights rise. Writes up to 8 entries, returns how many.
int blendWeights(const Eigen::Vector3d& x_map, const GpisConfig::Cells& cells, BlendWeight result[8]);

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_PARTITION_OF_UNITY_H
