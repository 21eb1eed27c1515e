// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/surface_score.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/range_check.h>

namespace simulated_world {
namespace {

/// A triangle is cut into at most the square of this: one that covers the world must not stop the judge.
constexpr int kMaxCuts = 300;

double distanceToSegment(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  const Eigen::Vector3d edge = b - a;
  const double length_squared = edge.squaredNorm();
  const double t = length_squared > 0.0 ? std::clamp((p - a).dot(edge) / length_squared, 0.0, 1.0) : 0.0;
  return (p - (a + t * edge)).norm();
}

/// Points sorted into the cells of a regular grid around them.
class PointGrid {
 public:
  PointGrid(const std::vector<Eigen::Vector3d>& points, double cell_m) : cell_m_(cell_m) {
    Eigen::Vector3d high = points.front();
    low_ = points.front();
    for (const Eigen::Vector3d& p : points) {
      low_ = low_.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    // A brick that rolled far away must not make the grid huge: then its cells are larger.
    while (true) {
      const Eigen::Vector3d cells = ((high - low_) / cell_m_).array().floor() + 1.0;
      if (cells.prod() <= kMaxCells) {
        counts_ = cells.cast<int>();
        break;
      }
      cell_m_ *= 1.5;
    }
    std::vector<std::size_t> cell_of(points.size());
    starts_.assign(static_cast<std::size_t>(counts_.prod()) + 1, 0);
    for (std::size_t i = 0; i < points.size(); ++i) {
      cell_of[i] = indexOf(clampedCell(points[i]));
      ++starts_[cell_of[i] + 1];
    }
    for (std::size_t c = 1; c < starts_.size(); ++c) starts_[c] += starts_[c - 1];
    std::vector<std::size_t> next(starts_.begin(), starts_.end() - 1);
    items_.resize(points.size());
    for (std::size_t i = 0; i < points.size(); ++i) items_[next[cell_of[i]]++] = i;
  }

  /// Calls `visit(index)` at least for each point in the box.
  template <typename Visit>
  void visitBox(const Eigen::Vector3d& low, const Eigen::Vector3d& high, Visit visit) const {
    if (((low - low_) / cell_m_ - counts_.cast<double>()).maxCoeff() > 0.0 || (high - low_).minCoeff() < 0.0) {
      return;
    }
    const Eigen::Vector3i first = clampedCell(low);
    const Eigen::Vector3i last = clampedCell(high);
    for (int x = first.x(); x <= last.x(); ++x) {
      for (int y = first.y(); y <= last.y(); ++y) {
        // Cells in a column along z are neighbours in memory.
        const std::size_t from = starts_[indexOf({x, y, first.z()})];
        const std::size_t to = starts_[indexOf({x, y, last.z()}) + 1];
        for (std::size_t k = from; k < to; ++k) visit(items_[k]);
      }
    }
  }

 private:
  static constexpr double kMaxCells = 4e6;

  Eigen::Vector3i clampedCell(const Eigen::Vector3d& p) const {
    const Eigen::Vector3d cell = (p - low_) / cell_m_;
    return cell.cwiseMax(0.0).cwiseMin((counts_.array() - 1).matrix().cast<double>()).cast<int>();
  }

  std::size_t indexOf(const Eigen::Vector3i& cell) const {
    return (static_cast<std::size_t>(cell.x()) * static_cast<std::size_t>(counts_.y()) +
            static_cast<std::size_t>(cell.y())) *
               static_cast<std::size_t>(counts_.z()) +
           static_cast<std::size_t>(cell.z());
  }

  double cell_m_;
  Eigen::Vector3d low_;
  Eigen::Vector3i counts_;
  std::vector<std::size_t> starts_;
  std::vector<std::size_t> items_;
};

bool isRight(const Eigen::Vector3d& p_map, const std::vector<PileBrick>& bricks, double tolerance_m) {
  return std::any_of(bricks.begin(), bricks.end(), [&](const PileBrick& brick) {
    const double reach_m = 0.5 * brick.size_m.norm() + tolerance_m;
    return (p_map - brick.T_map_brick.translation()).squaredNorm() <= reach_m * reach_m &&
           distanceToFaces(p_map, brick) <= tolerance_m;
  });
}

bool isOnObstacle(const Eigen::Vector3d& p_map, const std::vector<Obstacle>& obstacles, double ground_height_m,
                  double tolerance_m) {
  return std::any_of(obstacles.begin(), obstacles.end(), [&](const Obstacle& obstacle) {
    // Beyond flank and top; the foot is on the ground, where no surface is judged.
    const Eigen::Vector2d excess((p_map.head<2>() - obstacle.xy_map).norm() - kObstacleRadius_m,
                                 p_map.z() - ground_height_m - kObstacleHeight_m);
    const double distance_m = excess.maxCoeff() > 0.0 ? excess.cwiseMax(0.0).norm() : -excess.maxCoeff();
    return distance_m <= tolerance_m;
  });
}

}  // namespace

void StrategySurface::check() const {
  if (!std::isfinite(stamp_s)) {
    throw std::invalid_argument("StrategySurface: stamp_s = " + std::to_string(stamp_s) + " s, must be finite");
  }
  for (std::size_t i = 0; i < points_map.size(); ++i) {
    if (!points_map[i].allFinite()) {
      throw std::invalid_argument("StrategySurface: points_map[" + std::to_string(i) + "], must be finite");
    }
  }
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    for (const std::uint32_t index : triangles[i]) {
      if (index >= points_map.size()) {
        throw std::invalid_argument("StrategySurface: triangles[" + std::to_string(i) + "] has index " +
                                    std::to_string(index) + ", must be < " + std::to_string(points_map.size()));
      }
    }
  }
}

double distanceToTriangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                          const Eigen::Vector3d& c) {
  const Eigen::Vector3d normal = (b - a).cross(c - a);
  const double area_squared = normal.squaredNorm();
  // The foot of the perpendicular is in the triangle if it is on the inner side of all three edges.
  if (area_squared > 0.0 && (b - a).cross(p - a).dot(normal) >= 0.0 && (c - b).cross(p - b).dot(normal) >= 0.0 &&
      (a - c).cross(p - c).dot(normal) >= 0.0) {
    return std::abs((p - a).dot(normal)) / std::sqrt(area_squared);
  }
  return std::min({distanceToSegment(p, a, b), distanceToSegment(p, b, c), distanceToSegment(p, c, a)});
}

double distanceToFaces(const Eigen::Vector3d& p_map, const PileBrick& brick) {
  const Eigen::Vector3d p_brick = brick.T_map_brick.linear().transpose() * (p_map - brick.T_map_brick.translation());
  const Eigen::Vector3d excess = p_brick.cwiseAbs() - 0.5 * brick.size_m;
  return excess.maxCoeff() > 0.0 ? excess.cwiseMax(0.0).norm() : -excess.maxCoeff();
}

std::vector<bool> isNearSurface(const std::vector<Eigen::Vector3d>& points_map, const StrategySurface& surface,
                                double radius_m) {
  std::vector<bool> is_near(points_map.size(), false);
  if (points_map.empty()) {
    return is_near;
  }
  const PointGrid grid(points_map, radius_m);
  const Eigen::Vector3d margin = Eigen::Vector3d::Constant(radius_m);
  if (surface.triangles.empty()) {
    for (const Eigen::Vector3d& p : surface.points_map) {
      grid.visitBox(p - margin, p + margin, [&](std::size_t i) {
        is_near[i] = is_near[i] || (points_map[i] - p).squaredNorm() <= radius_m * radius_m;
      });
    }
    return is_near;
  }
  for (const auto& [ia, ib, ic] : surface.triangles) {
    const Eigen::Vector3d& a = surface.points_map[ia];
    const Eigen::Vector3d& b = surface.points_map[ib];
    const Eigen::Vector3d& c = surface.points_map[ic];
    grid.visitBox(a.cwiseMin(b).cwiseMin(c) - margin, a.cwiseMax(b).cwiseMax(c) + margin, [&](std::size_t i) {
      is_near[i] = is_near[i] || distanceToTriangle(points_map[i], a, b, c) <= radius_m;
    });
  }
  return is_near;
}

std::vector<std::string> ScoreConfig::validate() const {
  interactive_mapping::RangeCheck check;
  check("tolerance_m", tolerance_m, 1e-4, 1.0, "m");
  check("min_height_m", min_height_m, 0.0, 1.0, "m");
  check("region_margin_m", region_margin_m, 0.0, 100.0, "m");
  check("patch_size_m", patch_size_m, 1e-4, 1.0, "m");
  return check.problems();
}

std::optional<double> surfacePrecision(const StrategySurface& surface, const std::vector<PileBrick>& bricks,
                                       const GroundRegion& region, double ground_height_m, const ScoreConfig& config,
                                       const std::vector<Obstacle>& obstacles, const std::vector<PileWall>& walls) {
  const auto isOnWall = [&](const Eigen::Vector3d& p_map) {
    return std::any_of(walls.begin(), walls.end(), [&](const PileWall& wall) {
      return distanceToFaces(p_map, {-1, wall.T_map_wall, wall.size_m}) <= kWallTolerance_m;
    });
  };
  const double min_z_m = ground_height_m + config.min_height_m;
  double total = 0.0;
  double right = 0.0;
  const auto judge = [&](const Eigen::Vector3d& p, double weight, const std::vector<PileBrick>& candidates) {
    if (p.z() > min_z_m && region.contains(p.head<2>())) {
      const bool is_right = isRight(p, candidates, config.tolerance_m);
      if (is_right || (!isOnObstacle(p, obstacles, ground_height_m, config.tolerance_m) && !isOnWall(p))) {
        total += weight;
        right += is_right ? weight : 0.0;
      }
    }
  };
  if (surface.triangles.empty()) {
    for (const Eigen::Vector3d& p : surface.points_map) judge(p, 1.0, bricks);
  }
  std::vector<PileBrick> near;  // bricks that any point of the triangle may be right by
  for (const auto& [ia, ib, ic] : surface.triangles) {
    const Eigen::Vector3d& a = surface.points_map[ia];
    const Eigen::Vector3d& b = surface.points_map[ib];
    const Eigen::Vector3d& c = surface.points_map[ic];
    const Eigen::Vector3d low = a.cwiseMin(b).cwiseMin(c);
    const Eigen::Vector3d high = a.cwiseMax(b).cwiseMax(c);
    if (high.z() <= min_z_m || (high.head<2>() - region.min_xy_m).minCoeff() < 0.0 ||
        (region.max_xy_m - low.head<2>()).minCoeff() < 0.0) {
      continue;
    }
    // Cut into n x n equal triangles, each judged at its centre.
    const double longest_m = std::sqrt(std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()}));
    const int n = std::clamp(static_cast<int>(std::ceil(longest_m / config.patch_size_m)), 1, kMaxCuts);
    const Eigen::Vector3d center = (a + b + c) / 3.0;
    near.clear();
    std::copy_if(bricks.begin(), bricks.end(), std::back_inserter(near), [&](const PileBrick& brick) {
      const double reach_m = 0.5 * brick.size_m.norm() + config.tolerance_m + longest_m;
      return (center - brick.T_map_brick.translation()).squaredNorm() <= reach_m * reach_m;
    });
    const double patch_area_m2 = 0.5 * (b - a).cross(c - a).norm() / (n * n);
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n - i; ++j) {
        judge(a + (b - a) * ((i + 1.0 / 3.0) / n) + (c - a) * ((j + 1.0 / 3.0) / n), patch_area_m2, near);
        if (j < n - i - 1) {
          judge(a + (b - a) * ((i + 2.0 / 3.0) / n) + (c - a) * ((j + 2.0 / 3.0) / n), patch_area_m2, near);
        }
      }
    }
  }
  if (!(total > 0.0)) {
    return std::nullopt;
  }
  return right / total;
}

}  // namespace simulated_world
