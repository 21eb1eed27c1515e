// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "motion_planning/collision_scene.h"

/// What a scene holds, to be looked at. Frame: map.
namespace motion_planning {

/// The surface that is planned against: the mapped one, moved by its margins. Vertices on the borders of chunks are there
/// once for each; no normals.
Surface obstacleSurface(const CollisionScene& scene);

/// Centres of the unseen blocks that are in the way.
std::vector<Eigen::Vector3d> unknownBlocks(const CollisionScene& scene);
double blockSize(const CollisionScene& scene);  // edge [m]

}  // namespace motion_planning
