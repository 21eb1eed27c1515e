// SPDX-License-Identifier: BSD-3-Clause
#include "surface_picking/picking.h"

#include <algorithm>

namespace surface_picking {

std::vector<brick_detection::FaceAccess> pickableFaces(const std::vector<Body>& bodies, std::size_t index,
                                                       const mp700_ur5e_description::BrickType& type,
                                                       const SpaceQuery& space,
                                                       const brick_detection::FaceAccessConfig& config) {
  const Cuboid& cuboid = bodies.at(index).cuboid;
  std::vector<brick_detection::BrickBox> others;
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    if (i != index) others.push_back({bodies[i].cuboid.T_map_body, bodies[i].cuboid.size_m});
  }
  // Only the seen faces are asked about.
  mp700_ur5e_description::BrickType seen = type;
  seen.plate_faces.erase(std::remove_if(seen.plate_faces.begin(), seen.plate_faces.end(),
                                        [&](mp700_ur5e_description::BrickFace face) {
                                          return cuboid.faces[static_cast<std::size_t>(face)].radius_m <
                                                 config.tool_radius_m;
                                        }),
                         seen.plate_faces.end());
  return brick_detection::graspableFaces(cuboid.T_map_body, seen, others, space, config);
}

}  // namespace surface_picking
