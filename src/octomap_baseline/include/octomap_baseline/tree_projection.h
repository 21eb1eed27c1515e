// SPDX-License-Identifier: BSD-3-Clause
#ifndef OCTOMAP_BASELINE_TREE_PROJECTION_H
#define OCTOMAP_BASELINE_TREE_PROJECTION_H

#include <octomap/OcTree.h>

#include "gpis_mapping/ground_projection.h"

namespace octomap_baseline {

/// An occupied voxel of the smallest size none of whose 26 neighbours is occupied: noise, as octomap_server's filter_speckles
/// has it.
bool isSpeck(const octomap::OcTree& tree, const octomap::OcTreeKey& key);

/// The map seen from above, the ground at z = 0. A column is occupied when any of its voxels with z in [min_z_m, max_z_m]
/// is, else free when any is, else unknown. The grid is as large as what is known in that range; empty when nothing is.
/// With `without_specks` specks count as free.
gpis_mapping::GroundGrid projectDown(const octomap::OcTree& tree, double min_z_m, double max_z_m,
                                     bool without_specks = false);

}  // namespace octomap_baseline

#endif  // OCTOMAP_BASELINE_TREE_PROJECTION_H
