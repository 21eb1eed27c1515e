// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <vector>

#include <Eigen/Geometry>

#include "patch_shapes.h"
#include "surface_picking/cuboids.h"

namespace surface_picking {

/// A condition J d = r on a small motion d (translation, rotation about the middle, map's axes).
struct Condition {
  Eigen::Matrix<double, 1, 6> J;
  double residual, std;
};

/// Of a condition: J, for what it says of translation [1] and rotation [m/rad].
Eigen::Matrix<double, 1, 6> row(const Eigen::Vector3d& translation, const Eigen::Vector3d& rotation);

/// What faces and edges say of an end of a body.
struct End {
  bool is_shown{false};
  bool is_denied{false};  ///< the surface goes on beyond
};

/// What patches say of a body at a pose.
struct Evidence {
  std::array<SeenFace, mp700_ur5e_description::kNumBrickFaces> faces{};
  std::vector<bool> is_support;  ///< of each patch
  std::vector<Condition> conditions;
  int num_edges{0};
  bool has_inner_edge{false};  ///< a seen face ends in its midst
  double seen_area_m2{0.0};
  /// Along each axis of the body: what is seen of its ends, and of the surface between them [m from the middle].
  std::array<std::array<End, 2>, 3> ends{};
  std::array<double, 3> lowest{INFINITY, INFINITY, INFINITY}, highest{-INFINITY, -INFINITY, -INFINITY};
};

/// Weighs the surface for and against a body. Keeps references to all it is given.
class BodyEvidence {
 public:
  BodyEvidence(const TriangleMesh& mesh, const std::vector<Patch>& patches, const PatchShapes& shapes,
               const CuboidConfig& config);

  /// All that the surface says, at the pose as it is: the pose is not improved.
  Evidence weigh(const mp700_ur5e_description::BrickType& type, const Eigen::Isometry3d& T_map_body) const;

  /// Whether surface is inside the body, or the body reaches below a surface that is none of its faces.
  bool isPenetrated(const mp700_ur5e_description::BrickType& type, const Eigen::Isometry3d& T_map_body,
                    const Evidence& evidence) const;

 private:
  void weighEdge(const std::vector<std::size_t>& supports, const Eigen::Vector3d& c, const Eigen::Vector3d& axis,
                 double half, const Eigen::Vector3d& across, double half_across, Evidence* evidence, End* end) const;

  const TriangleMesh& mesh_;
  const std::vector<Patch>& patches_;
  const PatchShapes& shapes_;
  const CuboidConfig& config_;
  std::vector<double> area_;  // of each vertex [m^2]
};

}  // namespace surface_picking
