// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "simulated_world/obstacle.h"
#include "simulated_world/pile_surface.h"

namespace simulated_world {

/// What a strategy publishes as its map's surface, in the map frame: a mesh, or with no triangles a cloud of points.
struct StrategySurface {
  double stamp_s{0.0};  ///< of the data that it shows
  std::vector<Eigen::Vector3d> points_map;
  std::vector<std::array<std::uint32_t, 3>> triangles;

  /// Throws std::invalid_argument for an index out of range, or a stamp or point that is not finite.
  void check() const;
};

double distanceToTriangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                          const Eigen::Vector3d& c);

/// Distance from a point inside or outside to the nearest face of a brick, >= 0.
double distanceToFaces(const Eigen::Vector3d& p_map, const PileBrick& brick);

/// For each point, whether the surface comes as close as `radius_m` > 0; exact. Cost: the surface's triangles (or
/// points) times the points around each of them; the surface need not be indexed, and may reach far beyond the points.
std::vector<bool> isNearSurface(const std::vector<Eigen::Vector3d>& points_map, const StrategySurface& surface,
                                double radius_m);

/// Rectangle on the ground, in the map frame.
struct GroundRegion {
  Eigen::Vector2d min_xy_m{0.0, 0.0};
  Eigen::Vector2d max_xy_m{0.0, 0.0};

  bool contains(const Eigen::Vector2d& xy_m) const {
    return (xy_m - min_xy_m).minCoeff() >= 0.0 && (max_xy_m - xy_m).minCoeff() >= 0.0;
  }
};

struct ScoreConfig {
  double tolerance_m{0.02};     ///< what is as close as this to the truth is right
  double min_height_m{0.03};    ///< surface lower than this over the ground is not pile
  double region_margin_m{0.5};  ///< the pile's surroundings: so far around the bricks' places at the start
  double patch_size_m{0.01};    ///< triangles are judged in pieces no longer than this

  std::vector<std::string> validate() const;
};

/// Surface this near to a wall is taken for it. In a mission in a corner 94 % of the map's points of walls were within 2 cm of
/// them, 99.7 % within 4 cm: the map has walls from farther away than the pile, where localisation and calibration err more.
constexpr double kWallTolerance_m = 0.05;

/// Share of the surface's area (of its points, without triangles), over the ground and in the region, that is right.
/// Nothing if there is no surface there. Faces between two bricks count as faces. What lies on an obstacle is neither
/// right nor wrong, on a wall likewise (kWallTolerance_m): it shows what is there, which is not the pile.
std::optional<double> surfacePrecision(const StrategySurface& surface, const std::vector<PileBrick>& bricks,
                                       const GroundRegion& region, double ground_height_m, const ScoreConfig& config,
                                       const std::vector<Obstacle>& obstacles = {},
                                       const std::vector<PileWall>& walls = {});

}  // namespace simulated_world
