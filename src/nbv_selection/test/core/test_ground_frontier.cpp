// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/ground_frontier.h"

#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>

#include <gmock/gmock.h>

#include "support/selection_setup.h"

namespace nbv_selection {
namespace {

using base_navigation::wrapAngle;
using ::testing::IsEmpty;
using ::testing::SizeIs;

const std::vector<Eigen::Vector2d> kSquare{{-2.0, -2.0}, {2.0, -2.0}, {2.0, 2.0}, {-2.0, 2.0}};
const Eigen::Isometry3d kCamera = *pickingRobot().T_base_camera;

/// The square's ground where `is_seen`, and what stands on it.
MappedSurface groundWhere(const std::function<bool(const Eigen::Vector2d&)>& is_seen, const BoxPile& pile = {}) {
  SamplingOptions sampling;
  sampling.ground_margin_m = 2.5;
  sampling.is_seen = [&](const Eigen::Vector3d& p_map, const Eigen::Vector3d&) {
    return p_map.z() > 0.01 || is_seen(p_map.head<2>());
  };
  return sampleSurface(pile, sampling);
}

GroundFrontier frontierOf(const MappedSurface& surface, const NavigationGrid& grid = gridAround({}),
                          const GroundFrontierConfig& config = {}) {
  return {surface, gpis_mapping::GroundPlane(), kSquare, grid, kCamera, config};
}

double sumOf(const std::vector<double>& areas_m2) {
  return std::accumulate(areas_m2.begin(), areas_m2.end(), 0.0);
}

TEST(GroundFrontier, SeenGroundHasNoPatches) {
  EXPECT_THAT(frontierOf(groundWhere([](const auto&) { return true; })).patches(), IsEmpty());
}

TEST(GroundFrontier, EachHoleIsAPatchOfItsArea) {
  // Corners in the middle between samples 2 cm apart, on borders of cells.
  const auto isHole = [](const Eigen::Vector2d& p) {
    const bool is_large = p.x() > 0.49 && p.x() < 1.11 && p.y() > -1.01 && p.y() < 0.01;
    const bool is_small = p.x() > -1.51 && p.x() < -0.99 && p.y() > 0.99 && p.y() < 1.51;
    const bool is_tiny = p.x() > -0.01 && p.x() < 0.21 && p.y() > 0.99 && p.y() < 1.21;  // below min_area_m2
    return is_large || is_small || is_tiny;
  };
  const GroundFrontier frontier = frontierOf(groundWhere([&](const auto& p) { return !isHole(p); }));
  ASSERT_THAT(frontier.patches(), SizeIs(2));
  EXPECT_NEAR(frontier.patches()[0].area_m2, 0.6, 1e-9);
  EXPECT_NEAR(frontier.patches()[1].area_m2, 0.25, 1e-9);
  for (const Eigen::Vector2d& cell : frontier.patches()[0].cells_map) EXPECT_TRUE(isHole(cell)) << cell.transpose();
}

TEST(GroundFrontier, OccupiedCellsAreNoGround) {
  NavigationGrid grid = gridAround({});
  for (int row = 0; row < grid.height; ++row) {
    for (int column = 0; column < grid.width; ++column) {
      if (grid.centerOf(column, row).x() > 0.0) grid.state[grid.index(column, row)] = SpaceState::kOccupied;
    }
  }
  const GroundFrontier frontier = frontierOf(groundWhere([](const auto&) { return false; }), grid);
  ASSERT_THAT(frontier.patches(), SizeIs(1));
  EXPECT_NEAR(frontier.patches()[0].area_m2, 8.0, 1e-9);
}

// By angles in the camera's frame.
TEST(GroundFrontier, SeesWhatIsInTheFieldOfView) {
  const GroundFrontierConfig config;
  const GroundFrontier frontier = frontierOf(groundWhere([](const auto&) { return false; }));
  ASSERT_THAT(frontier.patches(), SizeIs(1));
  int num_some = 0;
  for (const Pose2d pose : {Pose2d{-2.0, 0.0, 0.0}, Pose2d{0.3, -1.0, 2.0}, Pose2d{1.9, 1.9, 0.8}}) {
    const Eigen::Vector3d eye(pose.x_m + std::cos(pose.yaw_rad) * 0.05 - std::sin(pose.yaw_rad) * 0.24,
                              pose.y_m + std::sin(pose.yaw_rad) * 0.05 + std::cos(pose.yaw_rad) * 0.24, 1.6);
    const double heading_rad = pose.yaw_rad - 0.0873;
    const Eigen::Vector3d axis(std::cos(heading_rad) * std::sqrt(0.5), std::sin(heading_rad) * std::sqrt(0.5),
                               -std::sqrt(0.5));
    const Eigen::Vector3d right(std::sin(heading_rad), -std::cos(heading_rad), 0.0);
    int count = 0;
    for (const Eigen::Vector2d& cell : frontier.patches()[0].cells_map) {
      const Eigen::Vector3d way(cell.x() - eye.x(), cell.y() - eye.y(), -eye.z());
      const double ahead = way.dot(axis), aside = way.dot(right), down = way.dot(axis.cross(right));
      if (ahead > 0.0 && std::abs(std::atan2(aside, ahead)) <= 0.5 * config.horizontal_fov_rad &&
          std::abs(std::atan2(down, ahead)) <= 0.5 * config.vertical_fov_rad && way.norm() <= config.max_range_m) {
        ++count;
      }
    }
    // A cell on the border of the view may be taken for either: the camera's turn is rounded here.
    EXPECT_NEAR(sumOf(frontier.areasSeenFrom(pose)), 0.01 * count, 0.03);
    if (count > 20) ++num_some;
  }
  EXPECT_GE(num_some, 2);
}

TEST(GroundFrontier, SeesNothingBehindAWall) {
  for (const double x_m : {0.0, -2.3}) {  // in the workspace, and before it
    BoxPile wall;
    wall.add({x_m, 0.0}, {0.1, 4.4, 2.0});
    const auto isNear = [x_m](const Eigen::Vector2d& p) { return p.x() < x_m + 0.05; };
    const Pose2d before{x_m - 1.0, 0.0, 0.0};
    EXPECT_EQ(sumOf(frontierOf(groundWhere(isNear, wall)).areasSeenFrom(before)), 0.0) << x_m;
    EXPECT_GT(sumOf(frontierOf(groundWhere(isNear)).areasSeenFrom(before)), 1.0) << x_m << " without the wall";
  }
}

TEST(GroundFrontier, FullAreaCountsAsAFrontierOfNineTenths) {
  for (const Logistic& logistic : {UtilityConfig().of(Factor::kFrontier).logistic, Logistic{0.7, 3.0, 2.6}}) {
    EXPECT_NEAR(logistic(frontierOfArea(1.5, 1.5, logistic)), 0.9 * logistic.l, 1e-9);
    EXPECT_LT(frontierOfArea(0.3, 1.5, logistic), frontierOfArea(0.6, 1.5, logistic));
  }
  EXPECT_EQ(frontierOfArea(1.5, 1.5, {1.0, 0.0, 0.0}), 0.0) << "of a constant nothing can be asked";
}

TEST(GroundFrontier, RejectsCornersThatAreNoPolygon) {
  const MappedSurface surface = groundWhere([](const auto&) { return true; });
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const std::vector<Eigen::Vector2d>& corners : {std::vector<Eigen::Vector2d>{},
                                                      {{0.0, 0.0}, {1.0, 0.0}},
                                                      {{0.0, 0.0}, {1.0, nan}, {1.0, 1.0}},
                                                      {{0.0, 0.0}, {1.0, 1.0}, {1.0, 0.0}, {0.0, 1.0}}}) {
    EXPECT_THROW(GroundFrontier(surface, {}, corners, gridAround({}), kCamera, {}), std::invalid_argument)
        << corners.size();
  }
}

}  // namespace
}  // namespace nbv_selection
