// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/ground_projection.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <stdexcept>

#include <pcl/ModelCoefficients.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/segmentation/sac_segmentation.h>

#include "gpis_mapping/cell_gp.h"

namespace gpis_mapping {
namespace {

constexpr std::size_t kMinGroundPoints = 50;
constexpr int kMaxPlanes = 4;           // floor, and what else is large and level: pallets, tables
constexpr double kLargeShare = 0.25;    // of the largest plane's points
constexpr int kMaxSide = 4000;          // cells
constexpr int kRansacIterations = 300;  // finds a plane of a quarter of the points with probability 1 - 1e-2

/// With room, for normals are noisier than planes.
bool looksUp(const Eigen::Vector3f& normal, const GroundOptions& options) {
  return normal.z() > static_cast<float>(std::cos(1.5 * options.max_tilt_rad));
}

/// The lowest of the large planes of points that look up.
std::optional<GroundPlane> lowestPlane(const std::vector<Eigen::Vector3d>& points, const GroundOptions& options) {
  if (points.size() < kMinGroundPoints) return std::nullopt;
  // PCL computes in float: relative to the first point.
  const Eigen::Vector3d origin = points.front();
  auto cloud = pcl::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
  for (const Eigen::Vector3d& p : points) {
    const Eigen::Vector3f local = (p - origin).cast<float>();
    cloud->push_back({local.x(), local.y(), local.z()});
  }
  std::optional<GroundPlane> ground;
  std::size_t largest = 0;
  for (int n = 0; n < kMaxPlanes && cloud->size() >= kMinGroundPoints; ++n) {
    pcl::SACSegmentation<pcl::PointXYZ> segmentation;  // seeds its random numbers with a constant
    segmentation.setModelType(pcl::SACMODEL_PERPENDICULAR_PLANE);
    segmentation.setMethodType(pcl::SAC_RANSAC);
    segmentation.setAxis(Eigen::Vector3f::UnitZ());
    segmentation.setEpsAngle(options.max_tilt_rad);
    segmentation.setDistanceThreshold(options.plane_tolerance_m);
    segmentation.setMaxIterations(kRansacIterations);
    segmentation.setInputCloud(cloud);
    pcl::PointIndices inliers;
    pcl::ModelCoefficients coefficients;
    segmentation.segment(inliers, coefficients);
    if (inliers.indices.size() < kMinGroundPoints ||
        static_cast<double>(inliers.indices.size()) < kLargeShare * static_cast<double>(largest)) {
      break;
    }
    largest = std::max(largest, inliers.indices.size());
    Eigen::Vector3d normal(coefficients.values[0], coefficients.values[1], coefficients.values[2]);
    double offset = -static_cast<double>(coefficients.values[3]);
    const double sign = (normal.z() < 0.0 ? -1.0 : 1.0) / normal.norm();
    normal *= sign;
    offset = offset * sign + normal.dot(origin);
    const GroundPlane plane{normal, offset, inliers.indices.size()};
    std::vector<bool> is_inlier(cloud->size(), false);
    Eigen::Vector3d center = Eigen::Vector3d::Zero();
    auto rest = pcl::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
    for (const int i : inliers.indices) {
      is_inlier[static_cast<std::size_t>(i)] = true;
      center += (*cloud)[static_cast<std::size_t>(i)].getVector3fMap().cast<double>();
    }
    center = center / static_cast<double>(inliers.indices.size()) + origin;
    for (std::size_t i = 0; i < cloud->size(); ++i) {
      if (!is_inlier[i]) rest->push_back((*cloud)[i]);
    }
    // Lower where it is, not where it would be if it went on for ever.
    if (!ground || ground->heightOf(center) < 0.0) ground = plane;
    cloud = rest;
  }
  return ground;
}

struct Points {
  std::vector<Eigen::Vector3d> all;
  std::vector<Eigen::Vector3d> level;  // of these, the ones that look up
};

Points pointsOf(const MapSnapshot& snapshot, const GroundOptions& options) {
  // In the order of their keys: the hash map's order depends on its history, the ground must not.
  std::vector<const CellGp*> cells;
  for (const auto& entry : snapshot.cells()) cells.push_back(entry.second.get());
  std::sort(cells.begin(), cells.end(), [](const CellGp* a, const CellGp* b) { return a->key() < b->key(); });
  Points points;
  for (const CellGp* cell : cells) {
    for (std::size_t i = 0; i < cell->numOwn(); ++i) {
      points.all.push_back(cell->position(i));
      if (looksUp(cell->normal(i), options)) points.level.push_back(points.all.back());
    }
  }
  return points;
}

}  // namespace

std::optional<GroundPlane> estimateGround(const MapSnapshot& snapshot, const GroundOptions& options) {
  return lowestPlane(pointsOf(snapshot, options).level, options);
}

std::optional<GroundPlane> estimateGround(const std::vector<Eigen::Vector3d>& points_map,
                                          const std::vector<Eigen::Vector3f>& normals_map,
                                          const GroundOptions& options) {
  if (points_map.size() != normals_map.size()) {
    throw std::invalid_argument(std::to_string(points_map.size()) + " points have " +
                                std::to_string(normals_map.size()) + " normals, must be as many");
  }
  std::vector<Eigen::Vector3d> points;
  for (std::size_t i = 0; i < points_map.size(); ++i) {
    if (points_map[i].allFinite() && looksUp(normals_map[i], options)) points.push_back(points_map[i]);
  }
  return lowestPlane(points, options);
}

std::optional<GroundGrid> projectToGround(const MapSnapshot& snapshot, const GroundOptions& options) {
  const Points points = pointsOf(snapshot, options);
  const std::optional<GroundPlane> plane = lowestPlane(points.level, options);
  if (!plane) return std::nullopt;
  Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Vector2d high = -low;
  for (const Eigen::Vector3d& p : points.all) {
    low = low.cwiseMin(p.head<2>());
    high = high.cwiseMax(p.head<2>());
  }
  const double cell = options.cell_size_m;
  const Eigen::Vector2d first = (low / cell).array().floor();
  const Eigen::Vector2d count = (high / cell).array().floor().matrix() - first + Eigen::Vector2d::Ones();
  if (!(count.maxCoeff() <= kMaxSide)) return std::nullopt;
  GroundGrid grid;
  grid.plane = *plane;
  grid.cell_size_m = cell;
  grid.origin_x_m = first.x() * cell;
  grid.origin_y_m = first.y() * cell;
  grid.width = static_cast<int>(count.x());
  grid.height = static_cast<int>(count.y());
  const auto num_cells = static_cast<std::size_t>(grid.width) * static_cast<std::size_t>(grid.height);
  grid.state.assign(num_cells, SpaceState::kUnknown);
  grid.max_height_m.assign(num_cells, std::numeric_limits<float>::quiet_NaN());
  enum Seen : std::uint8_t { kGround = 1, kObstacle = 2, kBelow = 4 };
  std::vector<std::uint8_t> seen(num_cells, 0);
  for (const Eigen::Vector3d& p : points.all) {
    const double height = plane->heightOf(p);
    if (height > options.max_obstacle_height_m) continue;
    const int column = std::min(grid.width - 1, static_cast<int>(std::floor(p.x() / cell) - first.x()));
    const int row = std::min(grid.height - 1, static_cast<int>(std::floor(p.y() / cell) - first.y()));
    const std::size_t at = grid.index(column, row);
    seen[at] |= height > options.min_obstacle_height_m    ? kObstacle
                : height < -options.min_obstacle_height_m ? kBelow
                                                          : kGround;
    grid.max_height_m[at] = std::fmax(grid.max_height_m[at], static_cast<float>(height));  // the other if one is NaN
  }
  const double just_above = snapshot.config().observed.block_size_m;
  for (int row = 0; row < grid.height; ++row) {
    for (int column = 0; column < grid.width; ++column) {
      const std::size_t at = grid.index(column, row);
      const double x = grid.origin_x_m + (column + 0.5) * cell;
      const double y = grid.origin_y_m + (row + 0.5) * cell;
      if (seen[at] & kObstacle) {
        grid.state[at] = SpaceState::kOccupied;
      } else if (seen[at] & kGround) {
        grid.state[at] = SpaceState::kFree;
      } else if (seen[at] & kBelow) {
        grid.state[at] = SpaceState::kOccupied;  // a step down is as bad as one up
      } else if (snapshot.observed().isFree({x, y, plane->zAt(x, y) + just_above})) {
        grid.state[at] = SpaceState::kFree;
      }
    }
  }
  return grid;
}

}  // namespace gpis_mapping
