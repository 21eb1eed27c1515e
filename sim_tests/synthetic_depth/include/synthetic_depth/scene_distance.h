// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include <Eigen/Geometry>

#include "synthetic_depth/scene.h"

namespace synthetic_depth {

/// Gaps between faces narrower than this are taken as closed contact.
constexpr double kContactTolerance_m = 1e-7;

/// Part of one planar face that belongs to the surface of the union of all solids.
struct ExposedFace {
  int id{0};  ///< box id or kGroundId
  Eigen::Vector3d origin_scene{Eigen::Vector3d::Zero()};
  Eigen::Vector3d axis_u{Eigen::Vector3d::UnitX()};
  Eigen::Vector3d axis_v{Eigen::Vector3d::UnitY()};
  Eigen::Vector3d normal{Eigen::Vector3d::UnitZ()};  ///< outward
  double half_u_m{0.0};                              ///< infinite for the ground
  double half_v_m{0.0};
  /// Convex regions of the face (u, v), counter-clockwise, that lie inside or against another solid.
  std::vector<std::vector<Eigen::Vector2d>> covers;
  /// Border of what is left of the face, as line segments.
  std::vector<std::pair<Eigen::Vector2d, Eigen::Vector2d>> rims;

  /// Whether a point of the face's plane is on the face and not covered.
  bool isExposed(const Eigen::Vector2d& uv) const;
};

/// Signed distance to the union of the boxes (and ground half space) of one frame, negative inside.
///
/// Outside, the minimum over the solids is exact. Inside it is not wherever solids touch or interpenetrate: a point in the
/// contact of two stacked bricks is deep inside the union, yet on the surface of both. Therefore inside the distance is
/// taken to the exposed surface, in closed form: each face is its rectangle minus the convex cross sections of the other
/// solids just above it, and the point of that region nearest to a query is either the foot of the perpendicular or on a
/// rim segment. Error: rounding, plus about 1e-6 m where gaps or slivers are as narrow as that.
/// Immutable once built: safe for concurrent use. Cost per query: O(boxes) outside, O(faces and nearby rims) inside.
class SceneDistance {
 public:
  SceneDistance(const Scene& scene, int frame);

  /// `points_map`: 3xN [m]. Returns N distances [m]; +Inf if the scene is empty, NaN for a point that is not finite.
  Eigen::VectorXd signedDistance(const Eigen::Ref<const Eigen::Matrix3Xd>& points_map) const;

  /// One point in the scene frame.
  double signedDistanceScene(const Eigen::Vector3d& p_scene) const;

  /// Point of the exposed surface that is nearest to a point on any side of it, scene frame; infinite in an empty scene.
  Eigen::Vector3d exposedSurfacePoint(const Eigen::Vector3d& p_scene) const;

  const std::vector<ExposedFace>& exposedFaces() const { return faces_; }

 private:
  double minimumOverSolids(const Eigen::Vector3d& p_scene) const;

  std::vector<Box> boxes_;
  std::vector<double> radii_m_;
  bool has_ground_;
  Eigen::Isometry3d T_scene_map_;
  std::vector<ExposedFace> faces_;
};

/// SceneDistance for one batch of points: 3xN [m] in the map frame to N distances [m].
Eigen::VectorXd signedDistance(const Scene& scene, int frame, const Eigen::Ref<const Eigen::Matrix3Xd>& points_map);

/// Points on the surface of the union, map frame.
struct SurfaceSamples {
  Eigen::Matrix3Xd points_map;   ///< [m]
  Eigen::Matrix3Xd normals_map;  ///< outward, unit length
  std::vector<int> ids;          ///< box id or kGroundId
};

/// Centres of a regular grid on each exposed face (spacing at most `spacing_m`, > 0); the ground within scene.roi only.
/// Throws std::invalid_argument for a spacing that is not positive.
SurfaceSamples exposedSurfaceSamples(const Scene& scene, int frame, double spacing_m);

/// Of the surface as it is at `last_frame`, the samples that at least one frame of [first_frame, last_frame] can see:
/// inside the image, facing the camera, within the sensor's range and hidden by nothing that is there in that frame.
/// Sensor noise, shadows and dropout play no part. `min_cosine`: of the angle between normal and line of sight, in [0, 1).
/// Throws std::out_of_range for frames the scene has not.
SurfaceSamples visibleSurfaceSamples(const Scene& scene, int first_frame, int last_frame, double spacing_m,
                                     double min_cosine = 0.0);

}  // namespace synthetic_depth
