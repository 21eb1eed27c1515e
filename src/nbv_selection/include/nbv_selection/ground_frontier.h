// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Geometry>
#include <base_navigation/navigation_grid.h>
#include <base_navigation/planar.h>
#include <gpis_mapping/ground_projection.h>
#include <interactive_mapping_common/config/schema.h>

#include "nbv_selection/scene_model.h"
#include "nbv_selection/utility.h"

namespace nbv_selection {

struct GroundFrontierConfig {
  double max_range_m{3.0};
  double horizontal_fov_rad{1.0};
  double vertical_fov_rad{0.8};
  double min_area_m2{0.2};
  double full_area_m2{1.5};

  static void fields(GroundFrontierConfig& c, interactive_mapping::Fields& f) {
    f("max_range_m", c.max_range_m, 0.5, 20.0, "m", "range within which the map takes in what the camera sees");
    f("horizontal_fov_rad", c.horizontal_fov_rad, 0.1, 3.0, "rad", "of the camera, less a margin");
    f("vertical_fov_rad", c.vertical_fov_rad, 0.1, 3.0, "rad", "the same");
    f("min_area_m2", c.min_area_m2, 0.01, 100.0, "m^2", "a smaller patch of unseen ground is not driven to");
    f("full_area_m2", c.full_area_m2, 0.01, 100.0, "m^2",
      "newly seen ground that is worth as much as a frontier whose factor is 0.9");
  }
};

/// Ground of the workspace that was never seen, in cells of kCell_m, gathered in patches of neighbouring cells.
class GroundFrontier {
 public:
  static constexpr double kCell_m = 0.1;  // the surface has several samples in each cell that was seen

  struct Patch {
    std::vector<Eigen::Vector2d> cells_map;  // their middles
    double area_m2{0.0};
  };

  /// `workspace_map`: the corners of a polygon. A cell is seen if the surface has a sample over it; a cell that `grid` calls
  /// occupied is no ground. Patches below `min_area_m2` are left out. Throws std::invalid_argument for corners that make no
  /// polygon.
  GroundFrontier(const MappedSurface& surface, const gpis_mapping::GroundPlane& ground,
                 const std::vector<Eigen::Vector2d>& workspace_map, const base_navigation::NavigationGrid& grid,
                 const Eigen::Isometry3d& T_base_camera, const GroundFrontierConfig& config);

  const std::vector<Patch>& patches() const { return patches_; }  // the largest first

  /// The area [m^2] of each patch that the camera would see with the base at a pose. A cell counts if it is in field of
  /// view and range, with no mapped surface before it.
  std::vector<double> areasSeenFrom(const base_navigation::Pose2d& T_map_base) const;

 private:
  bool isHidden(const Eigen::Vector3d& eye_map, const Eigen::Vector3d& p_map) const;

  gpis_mapping::GroundPlane ground_;
  Eigen::Isometry3d T_base_camera_;
  GroundFrontierConfig config_;
  base_navigation::NavigationGrid lattice_;  // without states
  std::vector<float> top_m_;                 // height of the surface over the ground, by cell; NaN: never seen
  std::vector<Patch> patches_;
};

/// The frontier attribute of a pose that shows so much new ground: f = f_0.9 area / full_area_m2. f_0.9 is the
/// attribute at which the frontier factor is 0.9 l. So both kinds of frontier are weighed by one logistic function.
double frontierOfArea(double area_m2, double full_area_m2, const Logistic& frontier);

}  // namespace nbv_selection
