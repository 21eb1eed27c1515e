// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/scene_distance.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "polygon.h"
#include "synthetic_depth/depth_renderer.h"

namespace synthetic_depth {
namespace {

constexpr double kUnbounded_m = std::numeric_limits<double>::infinity();
// How far beside a piece of border is looked for exposed surface.
constexpr double kSideStep_m = 1e-6;
constexpr double kParallel = 1e-12;

using Segment = std::pair<Eigen::Vector2d, Eigen::Vector2d>;

/// Points x of a plane with normal . x <= offset.
struct HalfPlane {
  Eigen::Vector2d normal;
  double offset;
};

struct HalfSpace {
  Eigen::Vector3d normal;
  double offset;
};

std::vector<HalfSpace> halfSpaces(const Box& box) {
  std::vector<HalfSpace> spaces;
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d direction = box.T_scene_box.linear().col(axis);
    const double middle = direction.dot(box.T_scene_box.translation());
    spaces.push_back({direction, middle + box.half_extents_m[axis]});
    spaces.push_back({-direction, -middle + box.half_extents_m[axis]});
  }
  return spaces;
}

Polygon clip(const Polygon& polygon, const HalfPlane& half_plane) {
  Polygon clipped;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d& a = polygon[i];
    const Eigen::Vector2d& b = polygon[(i + 1) % polygon.size()];
    const double excess_a = half_plane.normal.dot(a) - half_plane.offset;
    const double excess_b = half_plane.normal.dot(b) - half_plane.offset;
    if (excess_a <= 0.0) {
      clipped.push_back(a);
    }
    if ((excess_a < 0.0 && excess_b > 0.0) || (excess_a > 0.0 && excess_b < 0.0)) {
      clipped.push_back(a + (b - a) * (excess_a / (excess_a - excess_b)));
    }
  }
  return clipped;
}

Polygon rectangle(const Eigen::Vector2d& center, double half_u, double half_v) {
  return {center + Eigen::Vector2d(-half_u, -half_v), center + Eigen::Vector2d(half_u, -half_v),
          center + Eigen::Vector2d(half_u, half_v), center + Eigen::Vector2d(-half_u, half_v)};
}

/// Cross section of a convex solid with the plane just above a face, in the face's coordinates; empty if they are apart.
Polygon crossSection(const ExposedFace& face, const std::vector<HalfSpace>& solid, Polygon polygon) {
  const Eigen::Vector3d origin = face.origin_scene + kContactTolerance_m * face.normal;
  for (const HalfSpace& space : solid) {
    const Eigen::Vector2d normal(space.normal.dot(face.axis_u), space.normal.dot(face.axis_v));
    const double offset = space.offset - space.normal.dot(origin);
    if (normal.norm() < kParallel) {
      if (offset < 0.0) {
        return {};
      }
      continue;
    }
    polygon = clip(polygon, {normal, offset});
    if (polygon.size() < 3) {
      return {};
    }
  }
  constexpr double kLeastArea_m2 = 1e-14;
  return area(polygon) > kLeastArea_m2 ? polygon : Polygon{};
}

bool contains(const Polygon& polygon, const Eigen::Vector2d& p) {
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d edge = polygon[(i + 1) % polygon.size()] - polygon[i];
    const Eigen::Vector2d offset = p - polygon[i];
    if (edge.x() * offset.y() - edge.y() * offset.x() < 0.0) {
      return false;
    }
  }
  return true;
}

/// Adds the parameters in (0, 1) where a segment enters and leaves a convex polygon grown by `margin_m`.
void addCrossings(const Segment& segment, const Polygon& polygon, double margin_m, std::vector<double>& parameters) {
  double t_enter = 0.0;
  double t_leave = 1.0;
  const Eigen::Vector2d direction = segment.second - segment.first;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d edge = polygon[(i + 1) % polygon.size()] - polygon[i];
    const double length = edge.norm();
    if (length < 1e-12) {
      continue;
    }
    const Eigen::Vector2d outward = Eigen::Vector2d(edge.y(), -edge.x()) / length;
    const double slope = outward.dot(direction);
    const double room = margin_m - outward.dot(segment.first - polygon[i]);  // need t * slope <= room
    if (std::abs(slope) < kParallel) {
      if (room < 0.0) {
        return;
      }
    } else if (slope > 0.0) {
      t_leave = std::min(t_leave, room / slope);
    } else {
      t_enter = std::max(t_enter, room / slope);
    }
  }
  if (t_enter < t_leave) {
    parameters.push_back(t_enter);
    parameters.push_back(t_leave);
  }
}

/// Keeps the pieces of the candidate lines that have exposed surface on at least one side.
std::vector<Segment> exposedBorder(const ExposedFace& face, const std::vector<Segment>& candidates) {
  std::vector<Segment> border;
  for (const Segment& candidate : candidates) {
    const Eigen::Vector2d direction = candidate.second - candidate.first;
    const double length = direction.norm();
    if (length < 1e-9) {
      continue;
    }
    std::vector<double> parameters{0.0, 1.0};
    for (const Polygon& cover : face.covers) {
      // Collinear borders need the grown polygon, or rounding decides whether they cross at all.
      addCrossings(candidate, cover, 0.0, parameters);
      addCrossings(candidate, cover, kSideStep_m, parameters);
    }
    std::sort(parameters.begin(), parameters.end());
    const Eigen::Vector2d side = kSideStep_m * Eigen::Vector2d(-direction.y(), direction.x()) / length;
    double kept_from = -1.0;
    double kept_to = -1.0;
    for (std::size_t i = 0; i + 1 < parameters.size(); ++i) {
      const double from = parameters[i];
      const double to = parameters[i + 1];
      if ((to - from) * length < 1e-9) {
        continue;
      }
      const Eigen::Vector2d middle = candidate.first + 0.5 * (from + to) * direction;
      if (!face.isExposed(middle + side) && !face.isExposed(middle - side)) {
        continue;
      }
      if (kept_to < 0.0 || (from - kept_to) * length > 1e-8) {
        if (kept_to >= 0.0) {
          border.emplace_back(candidate.first + kept_from * direction, candidate.first + kept_to * direction);
        }
        kept_from = from;
      }
      kept_to = to;
    }
    if (kept_to >= 0.0) {
      border.emplace_back(candidate.first + kept_from * direction, candidate.first + kept_to * direction);
    }
  }
  return border;
}

void addEdges(const Polygon& polygon, std::vector<Segment>& segments) {
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    segments.emplace_back(polygon[i], polygon[(i + 1) % polygon.size()]);
  }
}

Eigen::Vector2d nearestOn(const Segment& segment, const Eigen::Vector2d& p) {
  const Eigen::Vector2d direction = segment.second - segment.first;
  const double t = std::clamp((p - segment.first).dot(direction) / direction.squaredNorm(), 0.0, 1.0);
  return segment.first + t * direction;
}

std::vector<ExposedFace> findExposedFaces(const std::vector<Box>& boxes, bool has_ground) {
  const std::vector<HalfSpace> ground{{Eigen::Vector3d::UnitZ(), 0.0}};
  std::vector<std::vector<HalfSpace>> solids;
  for (const Box& box : boxes) {
    solids.push_back(halfSpaces(box));
  }
  std::vector<ExposedFace> faces;
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    const Box& box = boxes[i];
    for (int axis = 0; axis < 3; ++axis) {
      for (const double sign : {-1.0, 1.0}) {
        ExposedFace face;
        face.id = box.id;
        face.normal = sign * box.T_scene_box.linear().col(axis);
        face.axis_u = box.T_scene_box.linear().col((axis + 1) % 3);
        face.axis_v = box.T_scene_box.linear().col((axis + 2) % 3);
        face.half_u_m = box.half_extents_m[(axis + 1) % 3];
        face.half_v_m = box.half_extents_m[(axis + 2) % 3];
        face.origin_scene = box.T_scene_box.translation() + box.half_extents_m[axis] * face.normal;

        const Polygon whole = rectangle(Eigen::Vector2d::Zero(), face.half_u_m, face.half_v_m);
        std::vector<Segment> lines;
        addEdges(whole, lines);
        const auto coverBy = [&](const std::vector<HalfSpace>& solid) {
          const Polygon section = crossSection(face, solid, whole);
          if (!section.empty()) {
            face.covers.push_back(section);
            addEdges(section, lines);
          }
        };
        for (std::size_t j = 0; j < boxes.size(); ++j) {
          const double reach = box.half_extents_m.norm() + boxes[j].half_extents_m.norm() + kContactTolerance_m;
          if (j != i && (box.T_scene_box.translation() - boxes[j].T_scene_box.translation()).norm() <= reach) {
            coverBy(solids[j]);
          }
        }
        if (has_ground) {
          coverBy(ground);
        }
        face.rims = exposedBorder(face, lines);
        if (!face.rims.empty()) {  // no border left: wholly covered
          faces.push_back(face);
        }
      }
    }
  }
  if (has_ground) {
    ExposedFace face;
    face.id = kGroundId;
    face.half_u_m = kUnbounded_m;
    face.half_v_m = kUnbounded_m;
    std::vector<Segment> lines;
    for (std::size_t j = 0; j < boxes.size(); ++j) {
      const double radius = 1.01 * boxes[j].half_extents_m.norm();
      const Polygon around = rectangle(boxes[j].T_scene_box.translation().head<2>(), radius, radius);
      const Polygon section = crossSection(face, solids[j], around);
      if (!section.empty()) {
        face.covers.push_back(section);
        addEdges(section, lines);
      }
    }
    face.rims = exposedBorder(face, lines);
    faces.push_back(face);
  }
  return faces;
}

SurfaceSamples select(const SurfaceSamples& samples, const std::vector<bool>& is_kept) {
  const auto count = std::count(is_kept.begin(), is_kept.end(), true);
  SurfaceSamples kept;
  kept.points_map.resize(3, count);
  kept.normals_map.resize(3, count);
  Eigen::Index column = 0;
  for (std::size_t i = 0; i < is_kept.size(); ++i) {
    if (is_kept[i]) {
      kept.points_map.col(column) = samples.points_map.col(static_cast<Eigen::Index>(i));
      kept.normals_map.col(column) = samples.normals_map.col(static_cast<Eigen::Index>(i));
      kept.ids.push_back(samples.ids[i]);
      ++column;
    }
  }
  return kept;
}

}  // namespace

bool ExposedFace::isExposed(const Eigen::Vector2d& uv) const {
  if (std::abs(uv.x()) > half_u_m || std::abs(uv.y()) > half_v_m) {
    return false;
  }
  return std::none_of(covers.begin(), covers.end(), [&uv](const Polygon& cover) { return contains(cover, uv); });
}

SceneDistance::SceneDistance(const Scene& scene, int frame)
    : boxes_(scene.boxesAt(frame)),
      has_ground_(scene.has_ground),
      T_scene_map_(scene.T_map_scene.inverse(Eigen::Isometry)),
      faces_(findExposedFaces(boxes_, has_ground_)) {
  for (const Box& box : boxes_) {
    radii_m_.push_back(box.half_extents_m.norm());
  }
}

double SceneDistance::minimumOverSolids(const Eigen::Vector3d& p_scene) const {
  double distance = has_ground_ ? p_scene.z() : kUnbounded_m;
  for (std::size_t i = 0; i < boxes_.size(); ++i) {
    const Box& box = boxes_[i];
    const Eigen::Vector3d offset = p_scene - box.T_scene_box.translation();
    const double reach = distance + radii_m_[i];
    if (reach >= 0.0 && offset.squaredNorm() >= reach * reach) {
      continue;  // even the box's bounding sphere is farther
    }
    const Eigen::Vector3d excess = (box.T_scene_box.linear().transpose() * offset).cwiseAbs() - box.half_extents_m;
    distance = std::min(distance, excess.cwiseMax(0.0).norm() + std::min(excess.maxCoeff(), 0.0));
  }
  return distance;
}

Eigen::Vector3d SceneDistance::exposedSurfacePoint(const Eigen::Vector3d& p_scene) const {
  Eigen::Vector3d best = Eigen::Vector3d::Constant(kUnbounded_m);
  double best_squared = kUnbounded_m;
  for (const ExposedFace& face : faces_) {
    const Eigen::Vector3d offset = p_scene - face.origin_scene;
    const double height = offset.dot(face.normal);
    const double height_squared = height * height;
    if (height_squared >= best_squared) {
      continue;
    }
    const Eigen::Vector2d uv(offset.dot(face.axis_u), offset.dot(face.axis_v));
    const double beyond_u = std::max(0.0, std::abs(uv.x()) - face.half_u_m);
    const double beyond_v = std::max(0.0, std::abs(uv.y()) - face.half_v_m);
    if (height_squared + beyond_u * beyond_u + beyond_v * beyond_v >= best_squared) {
      continue;
    }
    const auto consider = [&](const Eigen::Vector2d& at) {
      const double squared = height_squared + (at - uv).squaredNorm();
      if (squared >= best_squared) {
        return;
      }
      best_squared = squared;
      best = face.origin_scene + at.x() * face.axis_u + at.y() * face.axis_v;
    };
    if (face.isExposed(uv)) {
      consider(uv);
      continue;
    }
    for (const Segment& rim : face.rims) {
      consider(nearestOn(rim, uv));
    }
  }
  return best;
}

double SceneDistance::signedDistanceScene(const Eigen::Vector3d& p_scene) const {
  if (!p_scene.allFinite()) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  const double outside = minimumOverSolids(p_scene);
  if (outside >= kContactTolerance_m) {
    return outside;
  }
  const double to_surface = (exposedSurfacePoint(p_scene) - p_scene).norm();
  if (outside >= 0.0 && to_surface <= 2.0 * kContactTolerance_m) {
    return outside;  // on the surface, not in the contact of two solids
  }
  return -to_surface;
}

Eigen::VectorXd SceneDistance::signedDistance(const Eigen::Ref<const Eigen::Matrix3Xd>& points_map) const {
  Eigen::VectorXd distances(points_map.cols());
  for (Eigen::Index i = 0; i < points_map.cols(); ++i) {
    distances[i] = signedDistanceScene(T_scene_map_ * points_map.col(i));
  }
  return distances;
}

Eigen::VectorXd signedDistance(const Scene& scene, int frame, const Eigen::Ref<const Eigen::Matrix3Xd>& points_map) {
  return SceneDistance(scene, frame).signedDistance(points_map);
}

SurfaceSamples exposedSurfaceSamples(const Scene& scene, int frame, double spacing_m) {
  if (!(spacing_m > 0.0)) {
    throw std::invalid_argument("spacing_m = " + std::to_string(spacing_m) + " m, must be > 0 m");
  }
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3d> normals;
  SurfaceSamples samples;
  const SceneDistance distance(scene, frame);
  for (const ExposedFace& face : distance.exposedFaces()) {
    const bool is_ground = face.id == kGroundId;
    const Eigen::Vector2d low =
        is_ground ? Eigen::Vector2d(scene.roi.min_m.head<2>()) : Eigen::Vector2d(-face.half_u_m, -face.half_v_m);
    const Eigen::Vector2d high =
        is_ground ? Eigen::Vector2d(scene.roi.max_m.head<2>()) : Eigen::Vector2d(face.half_u_m, face.half_v_m);
    const int num_u = std::max(1, static_cast<int>(std::ceil((high - low).x() / spacing_m - 1e-9)));
    const int num_v = std::max(1, static_cast<int>(std::ceil((high - low).y() / spacing_m - 1e-9)));
    for (int i = 0; i < num_u; ++i) {
      for (int j = 0; j < num_v; ++j) {
        const Eigen::Vector2d uv =
            low + (high - low).cwiseProduct(Eigen::Vector2d((i + 0.5) / num_u, (j + 0.5) / num_v));
        if (face.isExposed(uv)) {
          points.emplace_back(scene.T_map_scene * (face.origin_scene + uv.x() * face.axis_u + uv.y() * face.axis_v));
          normals.emplace_back(scene.T_map_scene.linear() * face.normal);
          samples.ids.push_back(face.id);
        }
      }
    }
  }
  samples.points_map.resize(3, static_cast<Eigen::Index>(points.size()));
  samples.normals_map.resize(3, static_cast<Eigen::Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) {
    samples.points_map.col(static_cast<Eigen::Index>(i)) = points[i];
    samples.normals_map.col(static_cast<Eigen::Index>(i)) = normals[i];
  }
  return samples;
}

SurfaceSamples visibleSurfaceSamples(const Scene& scene, int first_frame, int last_frame, double spacing_m,
                                     double min_cosine) {
  if (first_frame < 0 || first_frame > last_frame || last_frame >= scene.numFrames()) {
    throw std::out_of_range("frames [" + std::to_string(first_frame) + ", " + std::to_string(last_frame) +
                            "], must be ordered and in [0, " + std::to_string(scene.numFrames()) + ")");
  }
  const SurfaceSamples samples = exposedSurfaceSamples(scene, last_frame, spacing_m);
  std::vector<bool> is_seen(samples.ids.size(), false);
  const CameraModel& camera = scene.camera;
  for (int frame = first_frame; frame <= last_frame; ++frame) {
    const ViewCaster caster(scene, frame, scene.T_scene_camera[static_cast<std::size_t>(frame)]);
    const Eigen::Isometry3d T_camera_map = scene.cameraInMap(frame).inverse(Eigen::Isometry);
    for (std::size_t i = 0; i < is_seen.size(); ++i) {
      if (is_seen[i]) {
        continue;
      }
      const auto column = static_cast<Eigen::Index>(i);
      const Eigen::Vector3d p_camera = T_camera_map * samples.points_map.col(column);
      const Eigen::Vector3d n_camera = T_camera_map.linear() * samples.normals_map.col(column);
      if (p_camera.z() <= 0.0 || p_camera.z() < scene.sensor.min_range_m || p_camera.z() > scene.sensor.max_range_m ||
          n_camera.dot(p_camera) >= -min_cosine * p_camera.norm()) {
        continue;
      }
      const double u = camera.fx_px * p_camera.x() / p_camera.z() + camera.cx_px;
      const double v = camera.fy_px * p_camera.y() / p_camera.z() + camera.cy_px;
      // A pixel covers half a pixel on each side of its centre.
      if (u < -0.5 || u > camera.width_px - 0.5 || v < -0.5 || v > camera.height_px - 0.5) {
        continue;
      }
      // The point must be on a surface in this frame: not hidden, and not hanging in the air before it appeared.
      const ViewCaster::Hit hit = caster.cast(u, v);
      is_seen[i] = std::abs(hit.z_m - p_camera.z()) <= 1e-6;
    }
  }
  return select(samples, is_seen);
}

}  // namespace synthetic_depth
