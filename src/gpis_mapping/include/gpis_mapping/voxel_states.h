// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_VOXEL_STATES_H
#define GPIS_MAPPING_VOXEL_STATES_H

#include <cstddef>
#include <vector>

#include "gpis_mapping/map_snapshot.h"
#include "gpis_mapping/types.h"

namespace gpis_mapping {

/// Known voxels of the lattice with side `size_m` [m]; see LatticeKey. Unknown voxels are in neither list.
struct VoxelStates {
  double size_m{0.0};
  std::vector<LatticeKey> occupied;
  std::vector<LatticeKey> free;
};

/// The map as voxels, each in at most one list. A voxel is occupied when MapSnapshot::query() says so at its centre. So
/// is one that holds the inside of a mapped surface: a place `shellDepth()` below a training point. Objects thinner
/// than a voxel are kept that way. Otherwise a voxel has the state of its centre. Cost: one query for each voxel within
/// some 0.2 m of a surface; the free space beyond costs a look-up. Throws std::invalid_argument for a size that is not
/// in [0.005, 10] m, or when more than `max_voxels` voxels would have to be looked at.
VoxelStates classifyVoxels(const MapSnapshot& snapshot, double size_m, std::size_t max_voxels);

/// How far below a training point classifyVoxels() marks a voxel [m], at most half a voxel. It is more than the noise
/// of surfaces, so that a floor on the border of two voxels does not mark the upper one.
double shellDepth(const GpisConfig& config, double size_m);

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_VOXEL_STATES_H
