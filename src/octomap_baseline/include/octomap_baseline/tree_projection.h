// SPDX-License-Identifier: BSD-3-Clause
#ifndef OCTOMAP_BASELINE_TREE_PROJECTION_H
#define OCTOMAP_BASELINE_TREE_PROJECTION_H

#include <vector>

#include <octomap/OcTree.h>

#include "gpis_mapping/types.h"

namespace octomap_baseline {

/// The map seen from above: one cell per column of voxels, row by row along x. Aligned with the map's axes.
struct TreeProjection {
  double cell_size_m{0.0};
  double origin_x_m{0.0};  // corner of the first cell
  double origin_y_m{0.0};
  int width{0};
  int height{0};
  std::vector<gpis_mapping::SpaceState> state;
};

/// An occupied voxel of the smallest size none of whose 26 neighbours is occupied: noise, as octomap_server's filter_speckles
/// has it.
bool isSpeck(const octomap::OcTree& tree, const octomap::OcTreeKey& key);

/// A column is occupied when any of its voxels with z in [min_z_m, max_z_m] is, else free when any is, else unknown.
/// The grid is as large as what is known in that range; empty when nothing is. With `without_specks` specks
/// count as free.
TreeProjection projectDown(const octomap::OcTree& tree, double min_z_m, double max_z_m, bool without_specks = false);

}  // namespace octomap_baseline

#endif  // OCTOMAP_BASELINE_TREE_PROJECTION_H
