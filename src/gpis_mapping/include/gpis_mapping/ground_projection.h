// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_GROUND_PROJECTION_H
#define GPIS_MAPPING_GROUND_PROJECTION_H

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "gpis_mapping/map_snapshot.h"
#include "gpis_mapping/types.h"

namespace gpis_mapping {

/// normal . x = offset, normal upwards.
struct GroundPlane {
  Eigen::Vector3d normal_map{Eigen::Vector3d::UnitZ()};
  double offset_m{0.0};
  std::size_t num_points{0};  // of the map, within the fit's tolerance

  double heightOf(const Eigen::Vector3d& p_map) const { return normal_map.dot(p_map) - offset_m; }
  /// z of the plane at (x, y).
  double zAt(double x_m, double y_m) const {
    return (offset_m - normal_map.x() * x_m - normal_map.y() * y_m) / normal_map.z();
  }
};

struct GroundOptions {
  double cell_size_m{0.05};
  double max_tilt_rad{0.26};
  double plane_tolerance_m{0.02};
  double min_obstacle_height_m{0.05};
  double max_obstacle_height_m{2.0};

  static void fields(GroundOptions& c, interactive_mapping::Fields& f) {
    f("cell_size_m", c.cell_size_m, 0.01, 1.0, "m", "of the projection from above");
    f("max_tilt_rad", c.max_tilt_rad, 0.01, 0.8, "rad", "of the ground against the map's z axis");
    f("plane_tolerance_m", c.plane_tolerance_m, 0.002, 0.2, "m", "a point this near belongs to the ground");
    f("min_obstacle_height_m", c.min_obstacle_height_m, 0.01, 1.0, "m",
      "above the ground; what is lower is driven over");
    f("max_obstacle_height_m", c.max_obstacle_height_m, 0.05, 10.0, "m", "what is higher is driven under");
    f.require(c.min_obstacle_height_m < c.max_obstacle_height_m,
              "min_obstacle_height_m must be below max_obstacle_height_m");
  }
};

/// The map seen from above: cell (column, row) covers x in origin_x + [column, column + 1) cell sizes, y likewise.
struct GroundGrid {
  GroundPlane plane;
  double cell_size_m{0.05};
  double origin_x_m{0.0};
  double origin_y_m{0.0};
  int width{0};
  int height{0};
  std::vector<SpaceState> state;    // row by row; occupied: something to bump into; free: ground was seen
  std::vector<float> max_height_m;  // of the surface above the ground; NaN where there is none

  std::size_t index(int column, int row) const { return static_cast<std::size_t>(row) * width + column; }
};

/// The lowest of the large, nearly level planes of the map (RANSAC over points whose normals point up; the same answer
/// for the same map). Nothing when there are fewer than 50 such points.
std::optional<GroundPlane> estimateGround(const MapSnapshot& snapshot, const GroundOptions& options);

/// The same of any surface's samples [m, map frame] and their unit normals into free space. Samples that are not finite
/// count as none. Throws std::invalid_argument unless there are as many of both.
std::optional<GroundPlane> estimateGround(const std::vector<Eigen::Vector3d>& points_map,
                                          const std::vector<Eigen::Vector3f>& normals_map,
                                          const GroundOptions& options);

/// Projects the map along z onto the ground. A cell is occupied when a surface point lies between the obstacle heights
/// above the plane. It is also occupied when only points as far below the plane were seen (a step down). Otherwise it
/// is free when ground points lie in it or the space just above was seen free. Otherwise it is unknown. Nothing when
/// there is no ground, or the map spans more than 4000 cells along a side.
std::optional<GroundGrid> projectToGround(const MapSnapshot& snapshot, const GroundOptions& options);

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_GROUND_PROJECTION_H
