// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>

#include "motion_planning/surface.h"

namespace motion_planning {

constexpr double kMaxSigmas = 10.0;   // that can be asked for
constexpr double kMaxMargin_m = 0.1;  // the same

struct CollisionSceneConfig {
  double sigmas{2.0};
  double margin_m{0.010};
  double max_margin_m{0.05};
  double chunk_m{0.20};
  double block_m{0.05};
  double unknown_near_pile_m{0.15};
  double pile_min_height_m{0.05};
  double region_radius_m{1.7};

  static void fields(CollisionSceneConfig& c, interactive_mapping::Fields& f) {
    f("sigmas", c.sigmas, 0.0, kMaxSigmas, "", "the surface is assumed nearer by this many standard deviations");
    f("margin_m", c.margin_m, 0.0, kMaxMargin_m, "m",
      "added to that, for edges that the map rounds, the robot's pose in the map and the arm's accuracy");
    f("max_margin_m", c.max_margin_m, c.margin_m, 0.2, "m", "greatest sum of both; at least margin_m");
    f("chunk_m", c.chunk_m, 0.05, 2.0, "m",
      "edge of the cubes in which triangles are kept; a cube is rebuilt when its triangles change");
    f("block_m", c.block_m, 0.01, 0.2, "m", "edge of the lattice of free, occupied and unknown space");
    f("unknown_near_pile_m", c.unknown_near_pile_m, 0.0, 1.0, "m",
      "unknown space this near to the pile, or above a wall, is an obstacle, except up to eight blocks alone in free "
      "space");
    f("pile_min_height_m", c.pile_min_height_m, 0.0, 1.0, "m",
      "surface higher than this above the ground belongs to the pile");
    f("region_radius_m", c.region_radius_m, 0.5, 5.0, "m",
      "obstacles farther from base_link are ignored; the arm with a brick reaches 1.65 m");
  }
};

/// What is in the way, in the map frame. Surface in chunks (an FCL BVH each), displaced into free space by its margin.
/// Each triangle is displaced by no less than the least of its vertices', at edges and corners too. A vertex keeps the
/// sigma it was first given as long as it stays bitwise where it is; more looks only make it smaller. Lattice of the
/// map's signed distance and of unknown space near the pile or under its surface; below base_link's ground it is empty.
/// Immutable; shared by any number of checkers.
class CollisionScene;

struct SceneUpdate {
  std::size_t chunks{0};  // with triangles
  std::size_t chunks_rebuilt{0};
  std::size_t triangles{0};
  std::size_t degenerate{0};  // triangles left out: not finite, no area, or indices out of range
  std::size_t blocks_asked{0};
  std::size_t blocks_unknown{0};
  double mesh_ms{0.0};
  double lattice_ms{0.0};
};

/// A surface cleaned up and cut into chunks, about a robot: the same for builders that differ in their margins alone.
struct PreparedSurface;

/// The box of the map that obstacles are taken from while the robot is at `T_map_base`.
Eigen::AlignedBox3d regionBox(const Eigen::Isometry3d& T_map_base, const CollisionSceneConfig& config);

/// For builders of `config`'s region_radius_m and chunk_m. Throws std::invalid_argument as CollisionSceneBuilder::update().
std::shared_ptr<const PreparedSurface> prepareSurface(const Surface& surface, const Eigen::Isometry3d& T_map_base,
                                                      const CollisionSceneConfig& config);

/// Keeps a CollisionScene up to date with the map. One thread updates.
class CollisionSceneBuilder {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  explicit CollisionSceneBuilder(const CollisionSceneConfig& config);
  ~CollisionSceneBuilder();

  /// Takes in a surface; what has not changed since the last one is kept. `T_map_base`: where the robot stands (z of
  /// base_link is up, its xy plane the ground). The map is asked once, for new vertices and for blocks that are new,
  /// unknown or near a chunk that changed. Space that was free stays free until something stands there or the robot has
  /// moved on. An empty surface gives a scene where only floor and robot are in the way. Throws what `map` throws, and
  /// std::runtime_error if it answers less than it was asked. Throws std::invalid_argument unless there is a normal for
  /// each vertex (zero or NaN: that of its triangles) and the pose is rigid. The last scene then stays.
  SceneUpdate update(const Surface& surface, const MapView& map, const Eigen::Isometry3d& T_map_base);
  /// The same. Throws std::invalid_argument, too, if it was prepared for another region_radius_m or chunk_m.
  SceneUpdate update(const std::shared_ptr<const PreparedSurface>& surface, const MapView& map);

  /// Never null.
  std::shared_ptr<const CollisionScene> scene() const;

  const CollisionSceneConfig& config() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace motion_planning
