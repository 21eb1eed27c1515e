// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <utility>
#include <vector>

#include <Eigen/Geometry>

#include "synthetic_depth/scene_distance.h"

namespace experiments {

/// What the exact surface is like at a place: flat, an edge with free space around, or where two solids meet.
enum class SurfacePlace { kFace, kConvexEdge, kConcaveEdge };

/// Tells places of one frame's exact surface apart. Immutable once built: safe for concurrent use.
class SurfacePlaces {
 public:
  static constexpr double kEdgeWidth_m = 0.02;  ///< places this near to an edge count as the edge

  SurfacePlaces(const synthetic_depth::Scene& scene, int frame);

  /// Of the surface's point that is nearest to `p_map` [m]. At a concave edge more than half of what lies within 5 mm of
  /// the edge is solid. Throws std::invalid_argument for a point that is not finite and for an empty scene.
  SurfacePlace at(const Eigen::Vector3d& p_map) const;

 private:
  bool isSolid(const Eigen::Vector3d& p_scene) const;
  bool isConcave(const Eigen::Vector3d& edge_scene) const;

  std::vector<synthetic_depth::Box> boxes_;
  bool has_ground_;
  Eigen::Isometry3d T_scene_map_;
  synthetic_depth::SceneDistance distance_;
  std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> edges_scene_;
};

}  // namespace experiments
