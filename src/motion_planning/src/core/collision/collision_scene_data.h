// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include <Eigen/Geometry>
#include <fcl/geometry/bvh/BVH_model.h>
#include <fcl/math/bv/OBB.h>
#include <fcl/math/bv/RSS.h>

#include "collision/block_lattice.h"
#include "motion_planning/collision_checker.h"
#include "motion_planning/collision_scene.h"

namespace motion_planning {

/// The triangles of one cube of space. Frame: map. Immutable, safe for any number of threads.
class SurfaceChunk {
 public:
  using Bvh = fcl::BVHModel<fcl::OBBd>;        // for overlaps: half the time to build of one that serves both
  using MappedBvh = fcl::BVHModel<fcl::RSSd>;  // for distances
  using Triangles = std::vector<std::array<std::uint32_t, 3>>;

  /// `mapped`: vertices where the map has them; `displaced`: moved into free space by their margins. At least one
  /// triangle.
  SurfaceChunk(std::vector<Eigen::Vector3d> mapped, std::vector<Eigen::Vector3d> displaced, Triangles triangles);

  const Triangles& triangles() const { return triangles_; }
  const std::vector<Eigen::Vector3d>& mapped() const { return mapped_; }
  const std::vector<Eigen::Vector3d>& displaced() const { return displaced_; }
  const Eigen::AlignedBox3d& bounds() const { return bounds_; }               // of what is displaced
  const Eigen::AlignedBox3d& mappedBounds() const { return mapped_bounds_; }  // of what is mapped

  // Built when first asked for: most chunks are never near the arm.
  const Bvh& bvh() const;              // of what is displaced
  const MappedBvh& mappedBvh() const;  // of what is mapped

  /// Without the triangles whose mapped vertices all lie in the box. With `only_own`, those that face its middle stay:
  /// they belong to what is beside the box. This chunk itself if that changes nothing (`self`), null if nothing is left.
  static std::shared_ptr<const SurfaceChunk> without(const std::shared_ptr<const SurfaceChunk>& self,
                                                     const OrientedBox& box, bool only_own);

 private:
  std::vector<Eigen::Vector3d> mapped_;
  std::vector<Eigen::Vector3d> displaced_;
  Triangles triangles_;
  Eigen::AlignedBox3d bounds_;
  Eigen::AlignedBox3d mapped_bounds_;
  mutable std::once_flag once_;
  mutable Bvh bvh_;
  mutable std::once_flag mapped_once_;
  mutable MappedBvh mapped_bvh_;
};

/// What a block of the lattice is.
enum BlockFlag : std::uint8_t {
  kBlockInside = 1,    // its centre is under a mapped surface
  kBlockUnknown = 2,   // unseen, and near the pile or under it
  kBlockObserved = 4,  // has been asked for
  kBlockSpeck = 8,     // unseen, but too small to hide anything: no obstacle
};

class CollisionScene {
 public:
  Eigen::Isometry3d T_map_base{Eigen::Isometry3d::Identity()};
  std::vector<std::shared_ptr<const SurfaceChunk>> chunks;

  BlockLattice lattice;             // empty: no surface in reach
  std::vector<std::uint8_t> flags;  // BlockFlag
  std::vector<float> distance_m;    // signed, of the block's centre; NaN: not asked for or no answer
  std::vector<float>
      free_distance_m;  // from any point of the block to surface (mapped or displaced), inside or unknown
                        // space: never more than the true distance

  /// Never more than the distance from the point to anything that is in the way.
  double freeDistance(const Eigen::Vector3d& p_map) const;
};

}  // namespace motion_planning
