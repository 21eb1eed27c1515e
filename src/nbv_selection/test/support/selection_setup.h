// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "nbv_selection/view_selector.h"
#include "support/box_pile.h"

/// What a selection needs beside its scene, and eqs 8 and 9 once more.
namespace nbv_selection {

using base_navigation::NavigationGrid;
using base_navigation::Pose2d;
using base_navigation::SpaceState;

/// The base and about the sectors of the simulated robot.
inline RobotBody pickingRobot() {
  RobotBody robot;
  robot.footprint = {{0.296, 0.296}, {-0.527, 0.296}, {-0.527, -0.296}, {0.296, -0.296}};
  robot.sectors.emplace();
  robot.sectors->top = {0.2, 0.9, -0.5, 0.6, 1.5};
  robot.sectors->side = {0.4, 1.0, -0.4, 0.75, 1.2};
  robot.T_base_armbase.translation() << 0.186, 0.0, 0.5;
  // On its mast it looks down at 45 degrees and a little to the right; x right, y down, z ahead.
  Eigen::Matrix3d optical;
  optical << 0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0;
  robot.T_base_camera = Eigen::Translation3d(0.05, 0.24, 1.6) * Eigen::AngleAxisd(-0.0873, Eigen::Vector3d::UnitZ()) *
                        Eigen::AngleAxisd(0.25 * M_PI, Eigen::Vector3d::UnitY()) * Eigen::Isometry3d(optical);
  return robot;
}

/// Whether (x, y) is over the box, or within `margin_m` of where it is over it along one of its sides.
inline bool isBelow(const Box& box, const gpis_mapping::GroundPlane& ground, const Eigen::Vector2d& p_map,
                    double margin_m) {
  const Eigen::Vector3d foot(p_map.x(), p_map.y(), ground.zAt(p_map.x(), p_map.y()));
  const Eigen::Vector3d p_box = box.T_map_box.inverse() * foot;
  return std::abs(p_box.x()) <= 0.5 * box.size_m.x() + margin_m &&
         std::abs(p_box.y()) <= 0.5 * box.size_m.y() + margin_m;
}

/// A square about the origin: free, but for cells that a box may touch.
inline NavigationGrid gridAround(const BoxPile& pile, double half_m = 4.0, double cell_size_m = 0.05) {
  NavigationGrid grid;
  grid.cell_size_m = cell_size_m;
  grid.origin_m = Eigen::Vector2d::Constant(-half_m);
  grid.width = grid.height = static_cast<int>(std::lround(2.0 * half_m / cell_size_m));
  grid.state.assign(static_cast<std::size_t>(grid.width) * grid.height, SpaceState::kFree);
  for (int row = 0; row < grid.height; ++row) {
    for (int column = 0; column < grid.width; ++column) {
      for (const Box& box : pile.boxes) {
        if (isBelow(box, pile.ground, grid.centerOf(column, row), 0.71 * cell_size_m)) {
          grid.state[grid.index(column, row)] = SpaceState::kOccupied;
        }
      }
    }
  }
  return grid;
}

inline SelectionRequest requestOn(NavigationGrid grid, const Pose2d& T_map_base, double now_s = 0.0) {
  SelectionRequest request;
  request.ground = std::make_shared<const NavigationGrid>(std::move(grid));
  request.T_map_base = T_map_base;
  request.now_s = now_s;
  return request;
}

/// Eq 9 as it is printed.
inline double informationByHand(const Attributes& a, const UtilityConfig& config) {
  const std::array<double, 5> values{a.manipulability, a.height_m, -a.distance_m, a.uncertainty, a.frontier};
  double sum = 0.0;
  for (std::size_t i = 0; i < 5; ++i) {
    const FactorConfig& factor = config.factors.at(i);
    sum += factor.weight * factor.logistic.l / (1.0 + std::exp(-factor.logistic.a * values.at(i) + factor.logistic.b));
  }
  return sum;
}

/// Eq 8 as it is printed; `since_failure_s` infinite without a failure.
inline double utilityByHand(const Attributes& a, double since_failure_s, const UtilityConfig& config) {
  const double penalty = config.use_failures ? std::pow(config.gamma_per_s, std::max(0.0, since_failure_s)) : 0.0;
  return (1.0 - penalty) * informationByHand(a, config);
}

}  // namespace nbv_selection
