// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/scene_view.h"

#include "collision/collision_scene_data.h"

namespace motion_planning {

Surface obstacleSurface(const CollisionScene& scene) {
  Surface surface;
  for (const std::shared_ptr<const SurfaceChunk>& chunk : scene.chunks) {
    const auto first = static_cast<std::uint32_t>(surface.vertices_map.size());
    surface.vertices_map.insert(surface.vertices_map.end(), chunk->displaced().begin(), chunk->displaced().end());
    for (const auto& triangle : chunk->triangles()) {
      surface.triangles.push_back({first + triangle[0], first + triangle[1], first + triangle[2]});
    }
  }
  return surface;
}

std::vector<Eigen::Vector3d> unknownBlocks(const CollisionScene& scene) {
  std::vector<Eigen::Vector3d> centres;
  for (std::size_t i = 0; i < scene.flags.size(); ++i) {
    if ((scene.flags[i] & kBlockUnknown) != 0) centres.push_back(scene.lattice.center(scene.lattice.position(i)));
  }
  return centres;
}

double blockSize(const CollisionScene& scene) {
  return scene.lattice.block();
}

}  // namespace motion_planning
