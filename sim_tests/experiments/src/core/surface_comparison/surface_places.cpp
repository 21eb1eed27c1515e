// SPDX-License-Identifier: BSD-3-Clause
#include "surface_comparison/surface_places.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace experiments {
namespace {

using Eigen::Vector3d;

/// Narrower gaps are closed to a map whose points are 2 cm apart, and no brick is thinner.
constexpr double kSolidRadius_m = 0.005;
constexpr int kSolidProbes = 64;

/// Evenly spread over the unit sphere (Fibonacci), never in line with a box's faces.
std::vector<Vector3d> makeProbes() {
  std::vector<Vector3d> probes;
  for (int i = 0; i < kSolidProbes; ++i) {
    const double z = 1.0 - (2.0 * i + 1.0) / kSolidProbes;
    const double angle = i * M_PI * (3.0 - std::sqrt(5.0));
    const double r = std::sqrt(1.0 - z * z);
    probes.emplace_back(r * std::cos(angle), r * std::sin(angle), z);
  }
  return probes;
}

}  // namespace

SurfacePlaces::SurfacePlaces(const synthetic_depth::Scene& scene, int frame)
    : boxes_(scene.boxesAt(frame)),
      has_ground_(scene.has_ground),
      T_scene_map_(scene.T_map_scene.inverse()),
      distance_(scene, frame) {
  for (const synthetic_depth::ExposedFace& face : distance_.exposedFaces()) {
    const auto inScene = [&face](const Eigen::Vector2d& uv) {
      return Vector3d(face.origin_scene + uv.x() * face.axis_u + uv.y() * face.axis_v);
    };
    for (const auto& [begin, end] : face.rims) edges_scene_.emplace_back(inScene(begin), inScene(end));
  }
}

bool SurfacePlaces::isSolid(const Vector3d& p_scene) const {
  if (has_ground_ && p_scene.z() < 0.0) return true;
  return std::any_of(boxes_.begin(), boxes_.end(), [&p_scene](const synthetic_depth::Box& box) {
    const Vector3d offset = p_scene - box.T_scene_box.translation();
    return offset.squaredNorm() < box.half_extents_m.squaredNorm() &&
           ((box.T_scene_box.linear().transpose() * offset).cwiseAbs() - box.half_extents_m).maxCoeff() < 0.0;
  });
}

bool SurfacePlaces::isConcave(const Vector3d& edge_scene) const {
  static const std::vector<Vector3d> probes = makeProbes();
  const auto solid = std::count_if(probes.begin(), probes.end(), [&](const Vector3d& direction) {
    return isSolid(edge_scene + kSolidRadius_m * direction);
  });
  return 2 * solid > kSolidProbes;
}

SurfacePlace SurfacePlaces::at(const Vector3d& p_map) const {
  const Vector3d p = distance_.exposedSurfacePoint(T_scene_map_ * p_map);
  if (!p_map.allFinite() || !p.allFinite()) {
    throw std::invalid_argument("SurfacePlaces::at: the point must be finite and the scene must have a surface");
  }
  double best_squared = kEdgeWidth_m * kEdgeWidth_m;
  Vector3d best = Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  for (const auto& [begin, end] : edges_scene_) {
    const Vector3d along = end - begin;
    const Vector3d nearest = begin + std::clamp((p - begin).dot(along) / along.squaredNorm(), 0.0, 1.0) * along;
    const double squared = (p - nearest).squaredNorm();
    if (squared > best_squared) continue;
    best_squared = squared;
    best = nearest;
  }
  if (!best.allFinite()) return SurfacePlace::kFace;
  return isConcave(best) ? SurfacePlace::kConcaveEdge : SurfacePlace::kConvexEdge;
}

}  // namespace experiments
