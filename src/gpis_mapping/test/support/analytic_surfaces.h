// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_TEST_ANALYTIC_SURFACES_H
#define GPIS_MAPPING_TEST_ANALYTIC_SURFACES_H

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <unordered_map>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "gpis_mapping/cell_gp.h"
#include "gpis_mapping/map_snapshot.h"

namespace gpis_mapping_test {

using gpis_mapping::CellGp;
using gpis_mapping::GpisConfig;
using gpis_mapping::LatticeKey;
using gpis_mapping::MapSnapshot;
using gpis_mapping::SurfacePoint;

inline Eigen::Vector3d randomVector(std::mt19937* rng, double low, double high) {
  std::uniform_real_distribution<double> uniform(low, high);
  const double x = uniform(*rng);
  const double y = uniform(*rng);
  const double z = uniform(*rng);
  return {x, y, z};
}

inline Eigen::Vector3d randomUnit(std::mt19937* rng) {
  std::normal_distribution<double> normal;
  const double x = normal(*rng);
  const double y = normal(*rng);
  const double z = normal(*rng);
  return Eigen::Vector3d(x, y, z).normalized();
}

inline SurfacePoint surfacePoint(const Eigen::Vector3d& p_map, const Eigen::Vector3d& n_map,
                                 double noise_std_m = 0.001) {
  SurfacePoint point;
  point.position_map = p_map;
  point.normal_map = n_map.normalized().cast<float>();
  point.variance_m2 = static_cast<float>(noise_std_m * noise_std_m);
  point.normal_variance = 4e-4f;  // 1.1 degrees: what the map gives to well seen points
  return point;
}

/// A rectangle spanned by `side_u`, `side_v` from `corner`; points in a grid of about `spacing_m`, half a step inside
/// the border. The normal is side_u x side_v.
inline void sampleRectangle(const Eigen::Vector3d& corner, const Eigen::Vector3d& side_u, const Eigen::Vector3d& side_v,
                            double spacing_m, double noise_std_m, std::vector<SurfacePoint>* points) {
  const int count_u = std::max(1, static_cast<int>(std::lround(side_u.norm() / spacing_m)));
  const int count_v = std::max(1, static_cast<int>(std::lround(side_v.norm() / spacing_m)));
  for (int i = 0; i < count_u; ++i) {
    for (int j = 0; j < count_v; ++j) {
      points->push_back(surfacePoint(corner + side_u * ((i + 0.5) / count_u) + side_v * ((j + 0.5) / count_v),
                                     side_u.cross(side_v), noise_std_m));
    }
  }
}

/// Fibonacci lattice: nearly equal spacing all over the sphere.
inline std::vector<SurfacePoint> sampleSphere(const Eigen::Vector3d& center, double radius_m, double spacing_m,
                                              double noise_std_m = 0.001) {
  const int count = static_cast<int>(4.0 * M_PI * radius_m * radius_m / (spacing_m * spacing_m));
  std::vector<SurfacePoint> points;
  for (int i = 0; i < count; ++i) {
    const double z = 1.0 - (2.0 * i + 1.0) / count;
    const double angle = i * M_PI * (3.0 - std::sqrt(5.0));
    const double r = std::sqrt(1.0 - z * z);
    const Eigen::Vector3d n(r * std::cos(angle), r * std::sin(angle), z);
    points.push_back(surfacePoint(center + radius_m * n, n, noise_std_m));
  }
  return points;
}

/// The faces of an axis-aligned box, normals outwards; `with_bottom` false leaves it open below.
inline std::vector<SurfacePoint> sampleBox(const Eigen::Vector3d& low, const Eigen::Vector3d& high, double spacing_m,
                                           bool with_bottom, double noise_std_m = 0.001) {
  const Eigen::Vector3d size = high - low;
  std::vector<SurfacePoint> points;
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d u = Eigen::Vector3d::Unit((axis + 1) % 3) * size[(axis + 1) % 3];
    const Eigen::Vector3d v = Eigen::Vector3d::Unit((axis + 2) % 3) * size[(axis + 2) % 3];
    sampleRectangle(low + size[axis] * Eigen::Vector3d::Unit(axis), u, v, spacing_m, noise_std_m, &points);
    if (axis == 2 && !with_bottom) continue;
    sampleRectangle(low, v, u, spacing_m, noise_std_m, &points);
  }
  return points;
}

inline double boxDistance(const Eigen::Vector3d& low, const Eigen::Vector3d& high, const Eigen::Vector3d& x) {
  const Eigen::Vector3d q = (x - 0.5 * (low + high)).cwiseAbs() - 0.5 * (high - low);
  return q.cwiseMax(0.0).norm() + std::min(0.0, q.maxCoeff());
}

inline std::vector<const SurfacePoint*> pointers(const std::vector<SurfacePoint>& points) {
  std::vector<const SurfacePoint*> result;
  for (const SurfacePoint& point : points) result.push_back(&point);
  return result;
}

/// Which points make up the GP of one cell.
struct CellSelection {
  std::vector<const SurfacePoint*> points;
  std::size_t num_own{0};
  std::size_t num_training{0};
};

/// By looking at every point: own, then within the training margin, then within reach of the prior mean.
inline CellSelection selectPoints(const GpisConfig& config, const LatticeKey& key,
                                  const std::vector<SurfacePoint>& points) {
  CellSelection selection;
  std::vector<const SurfacePoint*> training;
  std::vector<const SurfacePoint*> mean_only;
  const Eigen::AlignedBox3d box = config.cells.box(key);
  for (const SurfacePoint& point : points) {
    const double outside = box.exteriorDistance(point.position_map);
    if (config.cells.at(point.position_map) == key) {
      selection.points.push_back(&point);
    } else if (outside < config.cells.training_margin_m) {
      training.push_back(&point);
    } else if (outside < config.influenceMargin()) {
      mean_only.push_back(&point);
    }
  }
  selection.num_own = selection.points.size();
  selection.points.insert(selection.points.end(), training.begin(), training.end());
  selection.num_training = selection.points.size();
  selection.points.insert(selection.points.end(), mean_only.begin(), mean_only.end());
  return selection;
}

using CellTable = std::unordered_map<LatticeKey, std::shared_ptr<const CellGp>, gpis_mapping::LatticeKeyHash>;

/// Cells with points of their own and those a point is near, as the map keeps them. Slow and plain.
inline CellTable buildCells(const GpisConfig& config, const std::vector<SurfacePoint>& points,
                            const gpis_mapping::CellKernels& kernels = gpis_mapping::cellKernels()) {
  std::set<LatticeKey> keys;
  for (const SurfacePoint& point : points) {
    const LatticeKey key = config.cells.at(point.position_map);
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dz = -1; dz <= 1; ++dz) keys.insert(key.offset(dx, dy, dz));
      }
    }
  }
  CellTable cells;
  const double needed = std::min(config.influenceMargin(), 2.0 * config.surface.spacing_m);
  for (const LatticeKey& key : keys) {
    const CellSelection selection = selectPoints(config, key, points);
    const Eigen::AlignedBox3d box = config.cells.box(key);
    bool is_needed = false;
    for (const SurfacePoint* point : selection.points) {
      is_needed = is_needed || box.exteriorDistance(point->position_map) < needed;
    }
    if (!is_needed) continue;
    cells.emplace(key, std::make_shared<const CellGp>(key, config, selection.points, selection.num_own,
                                                      selection.num_training, kernels));
  }
  return cells;
}

inline gpis_mapping::CellPages pagesOf(const CellTable& cells) {
  return gpis_mapping::CellPages({cells.begin(), cells.end()});
}

}  // namespace gpis_mapping_test

#endif  // GPIS_MAPPING_TEST_ANALYTIC_SURFACES_H
