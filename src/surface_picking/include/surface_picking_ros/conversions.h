// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include <brick_detection/face_access.h>
#include <interactive_mapping_msgs/Brick.h>
#include <interactive_mapping_msgs/SurfaceMesh.h>
#include <mp700_ur5e_description/brick_types.h>

#include "surface_picking/bodies.h"
#include "surface_picking/patches.h"

namespace surface_picking_ros {

/// Throws std::invalid_argument for numbers of normals or variances that do not fit the vertices. What else may be wrong
/// with a mesh, findPatches() tells.
surface_picking::TriangleMesh toMesh(const interactive_mapping_msgs::SurfaceMesh& message);

/// `faces`: those that can be picked at.
interactive_mapping_msgs::Brick toMessage(const surface_picking::Body& body,
                                          const mp700_ur5e_description::BrickType& type,
                                          const std::vector<brick_detection::FaceAccess>& faces);

}  // namespace surface_picking_ros
