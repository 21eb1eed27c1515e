// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <functional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_enums/query_map.h>
#include <mp700_ur5e_description/brick_types.h>

#include "surface_picking/patches.h"

namespace surface_picking {

using interactive_mapping::SpaceState;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

struct CuboidConfig {
  /// Standard deviation of an edge.
  static constexpr double kEdgeStd_m = 0.005;
  /// Where the surface ends unseen, the face ends too if space is free so far beyond.
  static constexpr double kOpenReach_m = 0.05;
  /// Shorter pieces of an edge say nothing.
  static constexpr double kMinEdge_m = 0.05;
  /// A body with a larger share of surface inside, or that reaches into another surface by more, is refused.
  static constexpr double kMaxInsideShare = 0.02;
  /// A body with a larger share of space inside that was seen free is refused.
  static constexpr double kMaxFreeShare = 0.3;
  /// Share of its best seen face that a body must show.
  static constexpr double kMinFaceShare = 0.4;
  /// A seen face that ends in its midst, along a larger share of its edge, refutes the body. Two views that are 2 cm apart
  /// leave steps in a face, but hardly along all of it.
  static constexpr double kInnerEdgeShare = 0.6;
  /// Standard deviation of the position that no number of faces removes: the map's pose.
  static constexpr double kFloorStd_m = 0.002;
  /// The same of the rotation.
  static constexpr double kFloorStd_rad = 0.004;
  /// A patch whose normal differs by less from that of a face can be part of it.
  static constexpr double kFaceTolerance_rad = 0.12;

  double edge_inset_m{0.011};
  double size_tolerance_m{0.02};
  double face_tolerance_m{0.03};
  int min_edges{3};
  double inside_m{0.03};
  double max_std_m{0.015};
  double max_std_rad{0.06};

  static void fields(CuboidConfig& c, interactive_mapping::Fields& f) {
    f("edge_inset_m", c.edge_inset_m, 0.0, 0.1, "m",
      "distance from the border of a patch to the edge of the body: the mapped surface rounds edges");
    f("size_tolerance_m", c.size_tolerance_m, 0.001, 0.2, "m",
      "tolerance of a face between two edges against that of a type");
    f("face_tolerance_m", c.face_tolerance_m, 0.001, 0.1, "m", "a patch this near to the face of a body is part of it");
    f("min_edges", c.min_edges, 2, 24, "edges", "edges of its faces that a body must show");
    f("inside_m", c.inside_m, 0.001, 0.2, "m", "surface deeper inside a body contradicts it");
    f("max_std_m", c.max_std_m, 0.001, 0.5, "m", "a body whose position is less sure, along any axis, is left out");
    f("max_std_rad", c.max_std_rad, 0.001, 1.0, "rad", "the same of its rotation");
  }
};

/// Of a face: the patch that shows it.
struct SeenFace {
  int patch{-1};         ///< largest one's index; -1: not seen
  double share{0.0};     ///< of the face's area that is covered by mapped surface
  double radius_m{0.0};  ///< of the largest circle about its middle inside the patch; 0: the middle is not covered
};

/// A body that patches show.
struct Cuboid {
  std::string type;
  Eigen::Vector3d size_m{Eigen::Vector3d::Zero()};
  Eigen::Isometry3d T_map_body{Eigen::Isometry3d::Identity()};  ///< its middle, axes along its edges as the type's
  /// Of x y z [m^2] and rotations about the map's axes [rad^2].
  Matrix6d covariance{Matrix6d::Identity()};
  std::array<SeenFace, mp700_ur5e_description::kNumBrickFaces> faces{};  ///< in the order of kBrickFaces
  int num_edges{0};  ///< edges of seen faces that patches show, less those that they deny
  double seen_area_m2{0.0};
};

/// Why patches made no body.
struct CuboidStatistics {
  int num_hypotheses{0};
  int num_few_edges{0};    ///< fewer edges than min_edges, or too little of any face
  int num_penetrating{0};  ///< surface inside, or reaching into another surface
  int num_free{0};         ///< space inside was seen free
  int num_unsure{0};       ///< position or rotation not determined
  int num_ambiguous{0};    ///< another size or another body explains the same patches as well
};

/// Free, occupied or unknown at points [m, map frame]; as many answers as points.
using SpaceQuery = std::function<std::vector<SpaceState>(const Eigen::Matrix3Xd&)>;

/// Bodies of the known types that the patches of `mesh` show, most edges first. Each patch that is not large gives
/// hypotheses by its convex edges. These are faces of the types that fit between two of them, or from one of them on.
/// Where the patch is a multiple of a face, they are rows of equal faces. A hypothesis stays if it shows enough edges
/// and area, has no surface and no free space inside, and reaches into no other surface. Its planes and edges must
/// determine its position, and its size must be seen. No other hypothesis may explain the same surface as well. A size
/// is seen if it differs from each other one, turned in any way, along a seen axis. Both ends of the axis are seen, or
/// more of it than the other size is long. `space` may be empty: then open borders are no edges, and free space inside
/// is not noticed. Bodies that touch are two if an edge or the sizes of the types show it. A row that can be split in
/// several ways is left out. Throws std::invalid_argument for an impossible config, no types, a size that is not
/// positive, or an answer of `space` of another length.
std::vector<Cuboid> findCuboids(const TriangleMesh& mesh, const std::vector<Patch>& patches,
                                const std::vector<mp700_ur5e_description::BrickType>& types, const SpaceQuery& space,
                                const CuboidConfig& config, CuboidStatistics* statistics = nullptr);

/// Whether two cuboids share more than `slack_m` along every axis that could separate them.
bool overlap(const Eigen::Isometry3d& T_map_a, const Eigen::Vector3d& size_a_m, const Eigen::Isometry3d& T_map_b,
             const Eigen::Vector3d& size_b_m, double slack_m);

/// Upright box around a cuboid [m, map frame].
Eigen::AlignedBox3d boxAround(const Eigen::Isometry3d& T_map_body, const Eigen::Vector3d& size_m);

/// The 24 rotations that bring a cube to itself.
const std::vector<Eigen::Matrix3d>& rotationsOfTheCube();

/// Of all rotations that leave a cuboid of this size as it is, the one that brings `T_map_body` nearest to `like`. Edges
/// within 1 mm are equal.
Eigen::Isometry3d nearestSymmetric(const Eigen::Isometry3d& T_map_body, const Eigen::Vector3d& size_m,
                                   const Eigen::Matrix3d& like);

/// The same body with its axes chosen as by nearestSymmetric(), and its faces named by them.
Cuboid alignedLike(const Cuboid& cuboid, const Eigen::Matrix3d& like);

/// Angle between the two after the same choice [rad].
double angleBetweenBodies(const Eigen::Isometry3d& T_map_a, const Eigen::Isometry3d& T_map_b,
                          const Eigen::Vector3d& size_m);

/// Points inside, `margin_m` below the faces, `per_edge` along each edge [m, map frame].
Eigen::Matrix3Xd insidePoints(const Eigen::Isometry3d& T_map_body, const Eigen::Vector3d& size_m, double margin_m,
                              int per_edge);

}  // namespace surface_picking
