// SPDX-License-Identifier: BSD-3-Clause
#ifndef OCTOMAP_BASELINE_VOXEL_SURFACE_H
#define OCTOMAP_BASELINE_VOXEL_SURFACE_H

#include <octomap/OcTree.h>

#include "gpis_mapping/map_snapshot.h"
#include "gpis_mapping/mesh_extractor.h"

namespace octomap_baseline {

// The surface that an OctoMap stands for: the sides that occupied voxels share with free ones. It answers what the GPIS map
// is asked, so that planner and detection can use either. With `without_specks` isSpeck() voxels have no sides.

/// Two triangles per side of a voxel that meets `box_map`, open where nothing was seen. Corners [m], map frame, are shared,
/// their normals the mean of the sides'.
gpis_mapping::TriangleMesh meshOfSides(const octomap::OcTree& tree, bool without_specks = false,
                                       const Eigen::AlignedBox3d& box_map = gpis_mapping::kEverywhere);

/// 3 x n points [m], map frame. State and occupancy are the voxel's (unknown: NaN). Distances are to the nearest side,
/// with the sign of the state, in unknown space that of the side's front or back. They are NaN if there is no side or
/// the point is not finite. `surface_std` is that of a uniform distribution over a voxel. Variances are NaN: an OctoMap
/// has none.
gpis_mapping::QueryResult querySides(const octomap::OcTree& tree, bool without_specks,
                                     const gpis_mapping::Points3d& points_map,
                                     const gpis_mapping::QueryOptions& options);

}  // namespace octomap_baseline

#endif  // OCTOMAP_BASELINE_VOXEL_SURFACE_H
