// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/ground_frontier.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <interactive_mapping_common/geometry/polygon.h>

#include "nbv_selection/manipulability_score.h"

namespace nbv_selection {
namespace {

/// A ray that passes a surface by less is not blocked: the map's noise and the height of a cell's middle.
constexpr float kClearance_m = 0.03F;

/// The cells of the box and of what is within reach of it, from where it can be seen.
base_navigation::NavigationGrid latticeAround(const Eigen::AlignedBox2d& box, double reach_m) {
  base_navigation::NavigationGrid lattice;
  lattice.cell_size_m = GroundFrontier::kCell_m;
  const double border = std::ceil(reach_m / lattice.cell_size_m);  // in cells
  lattice.origin_m = box.min().array() - border * lattice.cell_size_m;
  lattice.width = static_cast<int>(std::ceil(box.sizes().x() / lattice.cell_size_m) + 2.0 * border);
  lattice.height = static_cast<int>(std::ceil(box.sizes().y() / lattice.cell_size_m) + 2.0 * border);
  return lattice;
}

}  // namespace

GroundFrontier::GroundFrontier(const MappedSurface& surface, const gpis_mapping::GroundPlane& ground,
                               const std::vector<Eigen::Vector2d>& workspace_map,
                               const base_navigation::NavigationGrid& grid, const Eigen::Isometry3d& T_base_camera,
                               const GroundFrontierConfig& config)
    : ground_(ground), T_base_camera_(T_base_camera), config_(config) {
  const std::string problem = interactive_mapping::problemOfPolygon(workspace_map);
  if (!problem.empty()) throw std::invalid_argument("the workspace " + problem);
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& corner : workspace_map) box.extend(corner);
  lattice_ = latticeAround(box, config_.max_range_m);
  const auto num_cells = static_cast<std::size_t>(lattice_.width) * static_cast<std::size_t>(lattice_.height);
  top_m_.assign(num_cells, std::numeric_limits<float>::quiet_NaN());
  for (const Eigen::Vector3d& p_map : surface.points_map) {
    if (!p_map.allFinite()) continue;
    const Eigen::Vector2i cell = lattice_.cellOf(p_map.head<2>());
    if (!lattice_.contains(cell.x(), cell.y())) continue;
    float& top_m = top_m_[lattice_.index(cell.x(), cell.y())];
    top_m = std::fmax(top_m, static_cast<float>(ground_.heightOf(p_map)));  // of a NaN and a number the number
  }

  std::vector<bool> is_unseen(num_cells, false);
  for (int row = 0; row < lattice_.height; ++row) {
    for (int column = 0; column < lattice_.width; ++column) {
      const Eigen::Vector2d middle = lattice_.centerOf(column, row);
      const Eigen::Vector2i below = grid.cellOf(middle);
      is_unseen[lattice_.index(column, row)] = std::isnan(top_m_[lattice_.index(column, row)]) &&
                                               interactive_mapping::isInside(workspace_map, middle) &&
                                               grid.at(below.x(), below.y()) != base_navigation::SpaceState::kOccupied;
    }
  }
  // Patches: cells that share a side or a corner.
  for (int row = 0; row < lattice_.height; ++row) {
    for (int column = 0; column < lattice_.width; ++column) {
      if (!is_unseen[lattice_.index(column, row)]) continue;
      Patch patch;
      std::vector<Eigen::Vector2i> open{{column, row}};
      is_unseen[lattice_.index(column, row)] = false;
      while (!open.empty()) {
        const Eigen::Vector2i cell = open.back();
        open.pop_back();
        patch.cells_map.push_back(lattice_.centerOf(cell.x(), cell.y()));
        for (int y = cell.y() - 1; y <= cell.y() + 1; ++y) {
          for (int x = cell.x() - 1; x <= cell.x() + 1; ++x) {
            if (!lattice_.contains(x, y) || !is_unseen[lattice_.index(x, y)]) continue;
            is_unseen[lattice_.index(x, y)] = false;
            open.emplace_back(x, y);
          }
        }
      }
      patch.area_m2 = static_cast<double>(patch.cells_map.size()) * kCell_m * kCell_m;
      if (patch.area_m2 >= config_.min_area_m2) patches_.push_back(std::move(patch));
    }
  }
  std::stable_sort(patches_.begin(), patches_.end(),
                   [](const Patch& a, const Patch& b) { return a.area_m2 > b.area_m2; });
}

std::vector<double> GroundFrontier::areasSeenFrom(const base_navigation::Pose2d& T_map_base) const {
  const Eigen::Isometry3d T_map_camera = standOn(ground_, T_map_base) * T_base_camera_;
  const Eigen::Isometry3d T_camera_map = T_map_camera.inverse();
  const double max_x = std::tan(0.5 * config_.horizontal_fov_rad), max_y = std::tan(0.5 * config_.vertical_fov_rad);
  std::vector<double> areas_m2;
  for (const Patch& patch : patches_) {
    int count = 0;
    for (const Eigen::Vector2d& cell : patch.cells_map) {
      const Eigen::Vector3d p_map(cell.x(), cell.y(), ground_.zAt(cell.x(), cell.y()));
      const Eigen::Vector3d p_camera = T_camera_map * p_map;
      const bool is_in_view = p_camera.z() > 0.0 && std::abs(p_camera.x()) <= max_x * p_camera.z() &&
                              std::abs(p_camera.y()) <= max_y * p_camera.z() && p_camera.norm() <= config_.max_range_m;
      if (is_in_view && !isHidden(T_map_camera.translation(), p_map)) ++count;
    }
    areas_m2.push_back(count * kCell_m * kCell_m);
  }
  return areas_m2;
}

/// Whether the surface in a cell between them is higher than the ray.
bool GroundFrontier::isHidden(const Eigen::Vector3d& eye_map, const Eigen::Vector3d& p_map) const {
  const Eigen::Vector3d way = eye_map - p_map;
  const auto steps = static_cast<int>(std::ceil(way.head<2>().norm() / (0.5 * kCell_m)));
  for (int i = 1; i < steps; ++i) {
    const Eigen::Vector3d at = p_map + way * (static_cast<double>(i) / steps);
    const Eigen::Vector2i cell = lattice_.cellOf(at.head<2>());
    if (!lattice_.contains(cell.x(), cell.y())) continue;
    const float top_m = top_m_[lattice_.index(cell.x(), cell.y())];  // NaN: nothing is known that could hide it
    if (top_m > static_cast<float>(ground_.heightOf(at)) + kClearance_m) return true;
  }
  return false;
}

double frontierOfArea(double area_m2, double full_area_m2, const Logistic& frontier) {
  if (frontier.a == 0.0) return 0.0;  // a constant, whatever the attribute is
  const double at_nine_tenths = (frontier.b + std::log(9.0)) / frontier.a;
  return at_nine_tenths * area_m2 / full_area_m2;
}

}  // namespace nbv_selection
