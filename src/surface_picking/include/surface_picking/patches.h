// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <vector>

#include <Eigen/Geometry>
#include <gpis_mapping/mesh_extractor.h>
#include <interactive_mapping_common/config/schema.h>

namespace surface_picking {

using gpis_mapping::TriangleMesh;

struct PatchConfig {
  /// Height over a patch in which it is looked for what lies on it.
  static constexpr double kAbove_m = 0.15;
  /// Standard deviation of a plane that no number of vertices removes.
  static constexpr double kSurfaceStd_m = 0.002;
  /// The same of its normal.
  static constexpr double kSurfaceStd_rad = 0.004;
  /// The standard deviation of a normal is that of the surface over this length.
  static constexpr double kNormalBaseline_m = 0.04;

  double min_angle_rad{0.12};
  double max_angle_rad{0.3};
  double sigmas{3.0};
  double distance_m{0.006};
  double min_area_m2{0.003};
  double max_curvature_per_m{2.5};
  double body_area_m2{0.5};

  static void fields(PatchConfig& c, interactive_mapping::Fields& f) {
    f("min_angle_rad", c.min_angle_rad, 0.01, 0.7, "rad",
      "a vertex whose normal differs from that of the plane by less belongs to it, however well it is known");
    f("max_angle_rad", c.max_angle_rad, 0.01, 0.7, "rad", "a vertex with a larger angle never belongs to it");
    f("sigmas", c.sigmas, 0.5, 10.0, "", "standard deviations by which normal and distance of a vertex may be off");
    f("distance_m", c.distance_m, 0.001, 0.05, "m",
      "a vertex nearer to the plane belongs to it, however well it is known");
    f("min_area_m2", c.min_area_m2, 1e-4, 1.0, "m^2", "smaller patches are left out");
    f("max_curvature_per_m", c.max_curvature_per_m, 0.05, 100.0, "1/m",
      "a patch that bends more, along any direction, is not planar");
    f("body_area_m2", c.body_area_m2, 0.01, 100.0, "m^2",
      "a larger patch is ground or wall: bodies stand on it, none has it as a face");
    f.require(c.min_angle_rad <= c.max_angle_rad, "min_angle_rad must be at most max_angle_rad");
  }
};

/// How a patch ends.
enum class BorderKind {
  kConvex,   ///< the surface turns away: the face of a body ends here
  kConcave,  ///< it rises: something stands before or on the face, which may go on behind
  kOpen,     ///< the mapped surface ends: what follows was not seen
};

struct BorderPoint {
  Eigen::Vector3d p_map{Eigen::Vector3d::Zero()};
  Eigen::Vector3d out_map{Eigen::Vector3d::Zero()};  ///< unit, in the plane, away from the patch
  BorderKind kind{BorderKind::kOpen};
};

/// A planar piece of the mapped surface.
struct Patch {
  Eigen::Vector3d center_map{Eigen::Vector3d::Zero()};  ///< area's centre, on the plane
  Eigen::Vector3d normal_map{Eigen::Vector3d::UnitZ()};
  double std_m{0.0};         ///< of the plane along its normal, at the centre
  double tilt_std_rad{0.0};  ///< of the normal
  double area_m2{0.0};
  double curvature_per_m{0.0};          ///< largest, of either sign
  bool is_large{false};                 ///< see body_area_m2; has no circle
  std::vector<std::uint32_t> vertices;  ///< of the mesh, ascending
  std::vector<BorderPoint> border;
  Eigen::Vector3d circle_center_map{Eigen::Vector3d::Zero()};  ///< of the largest circle inside the border
  double circle_radius_m{0.0};
  /// Lowest height over the circle at which something of the surface lies [m]; infinite: nothing within kAbove_m.
  double clearance_m{std::numeric_limits<double>::infinity()};

  /// Height over the plane [m].
  double height(const Eigen::Vector3d& p_map) const { return normal_map.dot(p_map - center_map); }
  /// From the projection of a point to the border [m]; says nothing of which side it is on.
  double borderDistance(const Eigen::Vector3d& p_map) const;
};

/// Why pieces of the surface are no patch.
struct PatchStatistics {
  int num_small{0};
  int num_curved{0};
};

/// Throws std::invalid_argument that says what is wrong with the mesh. Wrong are numbers of vertices, normals and
/// variances that differ, a vertex index out of range, and a number that is not finite. So are a normal that is not of
/// unit length and a variance below 0.
void requireMesh(const TriangleMesh& mesh);

/// The planar patches of a mesh, largest first. Regions grow from the flattest vertices over the mesh's edges. They
/// take vertices whose normal and position agree with the region's plane within their uncertainty. No vertex is in two.
/// Curved and small ones are left out, counted in `statistics` unless null. Throws as requireMesh(), and for a config
/// that is impossible. Cost: O(n log n) for n vertices, and O(vertices x border points) for each patch that is not
/// large.
std::vector<Patch> findPatches(const TriangleMesh& mesh, const PatchConfig& config,
                               PatchStatistics* statistics = nullptr);

/// The part of a mesh inside an upright box: its triangles with all vertices in it, and their vertices.
TriangleMesh cropMesh(const TriangleMesh& mesh, const Eigen::Vector3d& min_map_m, const Eigen::Vector3d& max_map_m);

/// The allowed angle between a vertex' normal and its region's [rad].
double allowedAngle(double variance_m2, const PatchConfig& config);
/// The allowed distance of a vertex to its region's plane [m].
double allowedDistance(double variance_m2, const PatchConfig& config);

}  // namespace surface_picking
