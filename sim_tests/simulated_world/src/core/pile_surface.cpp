// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/pile_surface.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <stdexcept>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>

namespace simulated_world {
namespace {

/// A sample lower than this over the ground stands on it.
constexpr double kGroundContact_m = 1e-3;

/// Whether a ray of length `reach_m` that starts outside of or in the box goes through it. Sliding along a face is no hit.
bool hits(const Eigen::Vector3d& origin_map, const Eigen::Vector3d& direction_map, const Eigen::Isometry3d& T_map_box,
          const Eigen::Vector3d& size_m, double reach_m = std::numeric_limits<double>::infinity()) {
  const Eigen::Vector3d offset_map = T_map_box.translation() - origin_map;
  const double radius_m = 0.5 * size_m.norm();
  const double along_m = offset_map.dot(direction_map);
  if (along_m < -radius_m || offset_map.squaredNorm() - along_m * along_m > radius_m * radius_m) {
    return false;  // misses the sphere around the box
  }
  const Eigen::Vector3d origin = -(T_map_box.linear().transpose() * offset_map);
  const Eigen::Vector3d direction = T_map_box.linear().transpose() * direction_map;
  double enter_m = 0.0;
  double leave_m = reach_m;
  for (int axis = 0; axis < 3; ++axis) {
    const double half_m = 0.5 * size_m[axis];
    if (std::abs(direction[axis]) < 1e-12) {
      if (std::abs(origin[axis]) >= half_m) return false;
      continue;
    }
    const double a = (-half_m - origin[axis]) / direction[axis];
    const double b = (half_m - origin[axis]) / direction[axis];
    enter_m = std::max(enter_m, std::min(a, b));
    leave_m = std::min(leave_m, std::max(a, b));
  }
  return leave_m - enter_m > 1e-9;
}

bool hits(const Eigen::Vector3d& origin_map, const Eigen::Vector3d& direction_map, const PileBrick& box,
          double reach_m = std::numeric_limits<double>::infinity()) {
  return hits(origin_map, direction_map, box.T_map_brick, box.size_m, reach_m);
}

bool hitsAny(const Eigen::Vector3d& origin_map, const Eigen::Vector3d& direction_map,
             const std::vector<PileWall>& walls, double reach_m = std::numeric_limits<double>::infinity()) {
  return std::any_of(walls.begin(), walls.end(), [&](const PileWall& wall) {
    return hits(origin_map, direction_map, wall.T_map_wall, wall.size_m, reach_m);
  });
}

}  // namespace

std::vector<std::string> PileSurfaceConfig::validate() const {
  interactive_mapping::RangeCheck check;
  check("sample_spacing_m", sample_spacing_m, 0.001, 1.0, "m");
  check("max_view_angle_rad", max_view_angle_rad, 0.001, 0.499 * M_PI, "rad");
  check("num_directions", num_directions, 1, 10000, "");
  check("ground_height_m", ground_height_m, -1000.0, 1000.0, "m");
  check("moved_distance_m", moved_distance_m, 0.0, 1.0, "m");
  check("moved_angle_rad", moved_angle_rad, 0.0, M_PI, "rad");
  return check.problems();
}

std::vector<FaceSample> sampleFaces(const Eigen::Vector3d& size_m, double spacing_m) {
  std::vector<FaceSample> samples;
  for (int axis = 0; axis < 3; ++axis) {
    const int u = (axis + 1) % 3;
    const int v = (axis + 2) % 3;
    const int num_u = std::max(1, static_cast<int>(std::ceil(size_m[u] / spacing_m - 1e-9)));
    const int num_v = std::max(1, static_cast<int>(std::ceil(size_m[v] / spacing_m - 1e-9)));
    for (const double side : {-1.0, 1.0}) {
      for (int i = 0; i < num_u; ++i) {
        for (int j = 0; j < num_v; ++j) {
          FaceSample sample;
          sample.p_brick[axis] = 0.5 * side * size_m[axis];
          sample.p_brick[u] = ((i + 0.5) / num_u - 0.5) * size_m[u];
          sample.p_brick[v] = ((j + 0.5) / num_v - 0.5) * size_m[v];
          sample.normal_brick = side * Eigen::Vector3d::Unit(axis);
          sample.area_m2 = size_m[u] * size_m[v] / (num_u * num_v);
          samples.push_back(sample);
        }
      }
    }
  }
  return samples;
}

std::vector<Eigen::Vector3d> upwardDirections(int count) {
  const double golden_angle_rad = M_PI * (3.0 - std::sqrt(5.0));
  std::vector<Eigen::Vector3d> directions;
  for (int i = 0; i < count; ++i) {
    const double z = (i + 0.5) / count;  // bands of equal height on a sphere have equal areas
    const double radius = std::sqrt(1.0 - z * z);
    directions.emplace_back(radius * std::cos(i * golden_angle_rad), radius * std::sin(i * golden_angle_rad), z);
  }
  return directions;
}

bool isVisibleFrom(const Eigen::Vector3d& eye_map, const PileTruth::Sample& sample, const PileTruth& truth,
                   double max_view_angle_rad) {
  const Eigen::Vector3d to_eye_map = eye_map - sample.p_map;
  const double distance_m = to_eye_map.norm();
  if (!(to_eye_map.dot(sample.normal_map) >= distance_m * std::cos(max_view_angle_rad))) {
    return false;
  }
  const bool is_blocked = std::any_of(truth.bricks.begin(), truth.bricks.end(), [&](const PileBrick& brick) {
    // A brick is convex: it never hides its own faces.
    return brick.id != sample.brick_id && hits(sample.p_map, to_eye_map / distance_m, brick, distance_m);
  });
  return !is_blocked && !hitsAny(sample.p_map, to_eye_map / distance_m, truth.walls, distance_m);
}

PileSurface::PileSurface(const PileSurfaceConfig& config) : config_(config), truth_(std::make_shared<PileTruth>()) {
  interactive_mapping::refuseIfAny("PileSurfaceConfig:", config.validate());
  directions_map_ = upwardDirections(config.num_directions);
}

bool PileSurface::hasMoved(const PileBrick& before, const PileBrick& now) const {
  const double angle_rad =
      Eigen::Quaterniond(before.T_map_brick.linear()).angularDistance(Eigen::Quaterniond(now.T_map_brick.linear()));
  return (before.T_map_brick.translation() - now.T_map_brick.translation()).norm() > config_.moved_distance_m ||
         angle_rad > config_.moved_angle_rad || before.size_m != now.size_m;
}

std::shared_ptr<const std::vector<FaceSample>> PileSurface::samplesFor(const Eigen::Vector3d& size_m) {
  const auto found = std::find_if(samples_by_size_.begin(), samples_by_size_.end(),
                                  [&size_m](const auto& entry) { return entry.first == size_m; });
  if (found != samples_by_size_.end()) {
    return found->second;
  }
  samples_by_size_.emplace_back(
      size_m, std::make_shared<const std::vector<FaceSample>>(sampleFaces(size_m, config_.sample_spacing_m)));
  return samples_by_size_.back().second;
}

int PileSurface::findWitness(const Tracked& tracked, const FaceSample& sample) const {
  const Eigen::Vector3d p_map = tracked.brick.T_map_brick * sample.p_brick;
  if (p_map.z() <= config_.ground_height_m + kGroundContact_m) {
    return kHidden;
  }
  const Eigen::Vector3d normal_map = tracked.brick.T_map_brick.linear() * sample.normal_brick;
  const double min_cosine = std::cos(config_.max_view_angle_rad);
  for (std::size_t d = 0; d < directions_map_.size(); ++d) {
    const Eigen::Vector3d& direction = directions_map_[d];
    if (direction.dot(normal_map) < min_cosine) {
      continue;
    }
    // A brick is convex: it never hides its own faces.
    const bool is_blocked = std::any_of(bricks_.begin(), bricks_.end(), [&](const auto& entry) {
      return entry.first != tracked.brick.id && hits(p_map, direction, entry.second.brick);
    });
    if (!is_blocked && !hitsAny(p_map, direction, config_.walls)) {
      return static_cast<int>(d);
    }
  }
  return kHidden;
}

void PileSurface::review(Tracked& tracked, const std::vector<PileBrick>& gone,
                         const std::vector<PileBrick>& come) const {
  const double min_cosine = std::cos(config_.max_view_angle_rad);
  for (std::size_t i = 0; i < tracked.witness.size(); ++i) {
    const int witness = tracked.witness[i];
    if (witness == kUnknown) {
      continue;
    }
    const FaceSample& sample = (*tracked.samples)[i];
    const Eigen::Vector3d p_map = tracked.brick.T_map_brick * sample.p_brick;
    const auto isIn = [&](const std::vector<PileBrick>& boxes, const Eigen::Vector3d& direction) {
      return std::any_of(boxes.begin(), boxes.end(), [&](const PileBrick& box) {
        return box.id != tracked.brick.id && hits(p_map, direction, box);
      });
    };
    if (witness >= 0) {
      if (isIn(come, directions_map_[static_cast<std::size_t>(witness)])) {
        tracked.witness[i] = kUnknown;
      }
      continue;
    }
    // Hidden: it can only be uncovered by a brick that was in the way of a direction from which it may be seen.
    const Eigen::Vector3d normal_map = tracked.brick.T_map_brick.linear() * sample.normal_brick;
    const bool may_be_uncovered =
        std::any_of(directions_map_.begin(), directions_map_.end(), [&](const Eigen::Vector3d& direction) {
          return direction.dot(normal_map) >= min_cosine && isIn(gone, direction);
        });
    if (may_be_uncovered) {
      tracked.witness[i] = kUnknown;
    }
  }
}

bool PileSurface::update(const std::vector<PileBrick>& bricks) {
  std::set<int> ids;
  for (const PileBrick& brick : bricks) {
    if (!ids.insert(brick.id).second || !(brick.size_m.minCoeff() > 0.0) || !brick.size_m.allFinite() ||
        !brick.T_map_brick.matrix().allFinite()) {
      throw std::invalid_argument("PileSurface: brick id = " + std::to_string(brick.id) +
                                  ", must be unique, with a size > 0 m and a finite pose");
    }
  }
  std::vector<PileBrick> gone;
  std::vector<PileBrick> come;
  bool has_changed = false;
  for (auto it = bricks_.begin(); it != bricks_.end();) {
    if (ids.count(it->first) == 0) {
      gone.push_back(it->second.brick);
      it = bricks_.erase(it);
    } else {
      ++it;
    }
  }
  for (const PileBrick& brick : bricks) {
    const auto known = bricks_.find(brick.id);
    if (known != bricks_.end() && !hasMoved(known->second.brick, brick)) {
      has_changed = has_changed || known->second.brick.is_resting != brick.is_resting;
      known->second.brick.is_resting = brick.is_resting;
      continue;
    }
    if (known != bricks_.end()) {
      gone.push_back(known->second.brick);
    }
    come.push_back(brick);
    Tracked& tracked = bricks_[brick.id];
    tracked.brick = brick;
    tracked.samples = samplesFor(brick.size_m);
    tracked.witness.assign(tracked.samples->size(), kUnknown);
  }
  if (!has_changed && gone.empty() && come.empty()) {
    return false;
  }

  auto truth = std::make_shared<PileTruth>();
  truth->walls = config_.walls;
  for (auto& [id, tracked] : bricks_) {
    review(tracked, gone, come);
    truth->bricks.push_back(tracked.brick);
    if (!tracked.brick.is_resting) {
      continue;  // what is unknown stays so until somebody asks
    }
    for (std::size_t i = 0; i < tracked.witness.size(); ++i) {
      const FaceSample& sample = (*tracked.samples)[i];
      if (tracked.witness[i] == kUnknown) {
        tracked.witness[i] = findWitness(tracked, sample);
      }
      if (tracked.witness[i] >= 0) {
        truth->exposed.push_back({id, i, tracked.brick.T_map_brick * sample.p_brick,
                                  tracked.brick.T_map_brick.linear() * sample.normal_brick, sample.area_m2});
      }
    }
  }
  truth_ = std::move(truth);
  return true;
}

}  // namespace simulated_world
