// SPDX-License-Identifier: BSD-3-Clause
#include "ground_truth.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_map>

#include "gpis_mapping/types.h"
#include "surface_comparison/mesh_distance.h"
#include "synthetic_depth/scene_distance.h"
#include "synthetic_depth/seeded_random.h"

namespace experiments {
namespace {

using gpis_mapping::LatticeKey;
using gpis_mapping::LatticeKeyHash;
using nlohmann::json;
using synthetic_depth::Scene;

constexpr double kGhostClearance_m = 0.05;  // a ghost point is this far from everything that is still there
constexpr double kGhostReach_m = 0.02;      // a ghost point with surface this near is a ghost
constexpr double kFreeMargin_m = 0.01;      // a point is seen as free when the frame sees this far past it
constexpr double kSampleSpacing_m = 0.005;  // of the claimed surface
constexpr double kVisibleSpacing_m = 0.02;
constexpr double kMinCosine = 0.1;  // flatter than 84 degrees no sensor measures

/// Is there a point within a fixed reach?
class NeighbourGrid {
 public:
  NeighbourGrid(const std::vector<Eigen::Vector3d>& points, double reach_m) : reach_m_(reach_m) {
    for (const Eigen::Vector3d& p : points) cells_[LatticeKey::of(p, reach_m)].push_back(p);
  }
  bool hasNear(const Eigen::Vector3d& p) const {
    const LatticeKey key = LatticeKey::of(p, reach_m_);
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dz = -1; dz <= 1; ++dz) {
          const auto cell = cells_.find(key.offset(dx, dy, dz));
          if (cell == cells_.end()) continue;
          for (const Eigen::Vector3d& other : cell->second) {
            if ((other - p).squaredNorm() <= reach_m_ * reach_m_) return true;
          }
        }
      }
    }
    return false;
  }
  double coveredShare(const std::vector<Eigen::Vector3d>& targets) const {
    if (targets.empty()) return 0.0;
    std::size_t covered = 0;
    for (const Eigen::Vector3d& p : targets) covered += hasNear(p);
    return static_cast<double>(covered) / static_cast<double>(targets.size());
  }

 private:
  double reach_m_;
  std::unordered_map<LatticeKey, std::vector<Eigen::Vector3d>, LatticeKeyHash> cells_;
};

}  // namespace

ClaimedSurface surfaceOf(const gpis_mapping::TriangleMesh& mesh) {
  ClaimedSurface surface;
  if (mesh.triangles.empty()) return surface;
  surface.samples = sampleEvenly({mesh.vertices_map, {}, mesh.triangles}, kSampleSpacing_m, 1);
  surface.cover = surface.samples;
  return surface;
}

ClaimedSurface surfaceOf(const octomap::OcTree& tree) {
  ClaimedSurface surface;
  const double resolution = tree.getResolution();
  for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) {
    if (!tree.isNodeOccupied(*leaf)) continue;
    // A pruned leaf stands for many voxels.
    const int across = static_cast<int>(std::lround(leaf.getSize() / resolution));
    const double first = 0.5 * (resolution - leaf.getSize());
    for (int x = 0; x < across; ++x) {
      for (int y = 0; y < across; ++y) {
        for (int z = 0; z < across; ++z) {
          surface.cover.emplace_back(leaf.getX() + first + x * resolution, leaf.getY() + first + y * resolution,
                                     leaf.getZ() + first + z * resolution);
        }
      }
    }
  }
  surface.samples = surface.cover;
  return surface;
}

GroundTruth::GroundTruth(const Scene& scene)
    : scene_(scene),
      last_before_(std::min(scene.firstRemovalFrame(), scene.numFrames()) - 1),
      places_(scene, last_before_) {
  for (int k = 0; k < scene.numFrames(); ++k) views_.emplace_back(scene, k, scene.T_scene_camera[k]);
  visible_before_ = visibleInRoi(last_before_, &normals_before_);
  if (!hasRemoval()) return;
  visible_after_ = visibleInRoi(last_before_ + 1);
  const synthetic_depth::SurfaceSamples seen = synthetic_depth::visibleSurfaceSamples(scene, 0, last_before_, 0.01);
  const std::vector<int> removed = scene.removedIds();
  const Eigen::VectorXd left = synthetic_depth::signedDistance(scene, last_before_ + 1, seen.points_map);
  for (Eigen::Index i = 0; i < seen.points_map.cols(); ++i) {
    const bool is_removed = std::binary_search(removed.begin(), removed.end(), seen.ids[static_cast<std::size_t>(i)]);
    const Eigen::Vector3d p = seen.points_map.col(i);
    if (is_removed && left[i] > kGhostClearance_m && seenFree(p, last_before_ + 1)) ghosts_.push_back(p);
  }
}

double GroundTruth::ghostShare(const ClaimedSurface& surface) const {
  return NeighbourGrid(surface.cover, kGhostReach_m).coveredShare(ghosts_);
}

json GroundTruth::quality(const ClaimedSurface& surface, bool after) const {
  Eigen::Matrix3Xd points(3, static_cast<Eigen::Index>(surface.samples.size()));
  Eigen::Index count = 0;
  for (const Eigen::Vector3d& p : surface.samples) {
    if (inRoi(p)) points.col(count++) = p;
  }
  points.conservativeResize(3, count);
  const Eigen::VectorXd errors_m = synthetic_depth::signedDistance(scene_, last_before_ + (after ? 1 : 0), points);
  const auto beyond = static_cast<double>((errors_m.array().abs() > 0.02).count());
  const double n = std::max<double>(1.0, static_cast<double>(count));
  const std::vector<Eigen::Vector3d>& targets = after ? visible_after_ : visible_before_;
  json result = {{"rmse_mm", 1e3 * errors_m.norm() / std::sqrt(n)},
                 {"share_off_by_2cm", beyond / n},
                 {"complete_1cm", NeighbourGrid(surface.cover, 0.01).coveredShare(targets)},
                 {"complete_2cm", NeighbourGrid(surface.cover, 0.02).coveredShare(targets)}};
  if (!after) result["places"] = byPlace(points, errors_m);
  return result;
}

json GroundTruth::byPlace(const Eigen::Matrix3Xd& points, const Eigen::VectorXd& errors_m) const {
  std::array<std::vector<double>, 3> errors;
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    errors[static_cast<std::size_t>(places_.at(points.col(i)))].push_back(errors_m[i]);
  }
  json result;
  for (const auto& [name, place] : {std::pair<const char*, SurfacePlace>{"face", SurfacePlace::kFace},
                                    {"convex", SurfacePlace::kConvexEdge},
                                    {"concave", SurfacePlace::kConcaveEdge}}) {
    const Statistics s = statisticsOf(errors[static_cast<std::size_t>(place)]);
    result[name] = {{"rmse_mm", 1e3 * s.rms},
                    {"mean_mm", 1e3 * s.mean},
                    {"median_mm", 1e3 * s.median_abs},
                    {"p95_mm", 1e3 * s.p95_abs},
                    {"area_share", static_cast<double>(s.count) / std::max<double>(1.0, points.cols())}};
  }
  return result;
}

void GroundTruth::freePoints(double low_m, double high_m, Eigen::Index count, std::uint64_t seed,
                             Eigen::Matrix3Xd* points, Eigen::VectorXd* exact) const {
  const synthetic_depth::SceneDistance distance(scene_, last_before_);
  const Eigen::Isometry3d T_scene_map = scene_.T_map_scene.inverse();
  const NeighbourGrid visible(visible_before_, kVisibleSpacing_m);
  synthetic_depth::SeededRandom random(seed);
  points->resize(3, count);
  exact->resize(count);
  for (Eigen::Index found = 0; found < count;) {
    const auto pick =
        std::min(visible_before_.size() - 1,
                 static_cast<std::size_t>(random.uniform() * static_cast<double>(visible_before_.size())));
    const Eigen::Vector3d any(random.normal(), random.normal(), random.normal());
    const Eigen::Vector3d direction = 0.7 * any.normalized() + normals_before_[pick];  // away from the surface
    const Eigen::Vector3d p = visible_before_[pick] + direction.normalized() * random.uniform(low_m, high_m);
    const double d = distance.signedDistanceScene(T_scene_map * p);
    if (d <= low_m || d > high_m || !inRoi(p)) continue;
    bool is_free = false;
    for (int k = 0; k <= last_before_ && !is_free; ++k) is_free = seenFree(p, k);
    if (!is_free || !visible.hasNear(scene_.T_map_scene * distance.exposedSurfacePoint(T_scene_map * p))) continue;
    points->col(found) = p;
    (*exact)[found++] = d;
  }
}

bool GroundTruth::inRoi(const Eigen::Vector3d& p_map) const {
  const Eigen::Vector3d p = scene_.T_map_scene.inverse() * p_map;
  return (p.array() >= scene_.roi.min_m.array()).all() && (p.array() <= scene_.roi.max_m.array()).all();
}

bool GroundTruth::seenFree(const Eigen::Vector3d& p_map, int frame) const {
  const Eigen::Vector3d p = scene_.cameraInMap(frame).inverse() * p_map;
  if (p.z() < scene_.sensor.min_range_m) return false;
  const double u = scene_.camera.fx_px * p.x() / p.z() + scene_.camera.cx_px;
  const double v = scene_.camera.fy_px * p.y() / p.z() + scene_.camera.cy_px;
  if (u < 0.0 || v < 0.0 || u > scene_.camera.width_px - 1.0 || v > scene_.camera.height_px - 1.0) return false;
  // The pixels around it, all of them: one that mixes in another surface is no proof.
  for (const double pu : {std::floor(u), std::ceil(u)}) {
    for (const double pv : {std::floor(v), std::ceil(v)}) {
      if (views_[static_cast<std::size_t>(frame)].cast(pu, pv).z_m < p.z() + kFreeMargin_m) return false;
    }
  }
  return true;
}

std::vector<Eigen::Vector3d> GroundTruth::visibleInRoi(int frame, std::vector<Eigen::Vector3d>* normals) const {
  const synthetic_depth::SurfaceSamples samples =
      synthetic_depth::visibleSurfaceSamples(scene_, 0, frame, kVisibleSpacing_m, kMinCosine);
  std::vector<Eigen::Vector3d> points;
  for (Eigen::Index i = 0; i < samples.points_map.cols(); ++i) {
    if (!inRoi(samples.points_map.col(i))) continue;
    points.emplace_back(samples.points_map.col(i));
    if (normals != nullptr) normals->emplace_back(samples.normals_map.col(i));
  }
  return points;
}

}  // namespace experiments
