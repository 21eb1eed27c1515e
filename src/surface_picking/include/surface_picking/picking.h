// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include <brick_detection/face_access.h>
#include <mp700_ur5e_description/brick_types.h>

#include "surface_picking/bodies.h"

namespace surface_picking {

/// The faces of body `index` at which a tool can hold it, easiest first. They are those of brick_detection's
/// graspableFaces(), with the other bodies as obstacles. The surface of a face must be seen and flat in a circle of the
/// tool's radius about the middle. Throws as graspableFaces(), and std::out_of_range for an index that is none.
std::vector<brick_detection::FaceAccess> pickableFaces(const std::vector<Body>& bodies, std::size_t index,
                                                       const mp700_ur5e_description::BrickType& type,
                                                       const SpaceQuery& space,
                                                       const brick_detection::FaceAccessConfig& config);

}  // namespace surface_picking
