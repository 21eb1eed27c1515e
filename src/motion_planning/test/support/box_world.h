// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "motion_planning/collision_checker.h"
#include "motion_planning/surface.h"

namespace motion_planning {

/// Distance from a point to a box [m], negative inside. Exact.
double signedDistance(const OrientedBox& box, const Eigen::Vector3d& p_map);

/// A box with its axes along the map's.
OrientedBox uprightBox(const Eigen::Vector3d& middle_map, const Eigen::Vector3d& size_m);

/// A world of boxes on a ground, as a map that is exact: what it answers is analytic, its mesh lies on the boxes' faces.
/// Everything is seen unless `is_unknown` says otherwise. As GpisMap's, the map knows how deep the inside goes down to
/// `occupied_depth_m` only; below that it reads unknown, without a distance. Frame: map.
class BoxWorld : public MapView {
 public:
  std::vector<OrientedBox> boxes;
  std::optional<double> ground_z_m;  // no ground: boxes in the air
  double ground_half_edge_m{1.5};    // of the meshed square about the origin; the ground itself has no end
  double occupied_depth_m{0.15};
  double unknown_reach_m{0.30};  // in unseen space distances are answered this far from a surface
  /// Space outside the boxes that nobody has seen. A face that looks into it is not in the mesh.
  std::function<bool(const Eigen::Vector3d&)> is_unknown;
  /// Position uncertainty of the surface [m] by the point asked; empty: 2 mm everywhere.
  std::function<double(const Eigen::Vector3d&)> surface_std_m;

  /// Negative inside. Outside it is exact; inside, boxes that touch or overlap are taken one by one (the depth in the
  /// one that holds the point deepest). Infinite in an empty world.
  double distance(const Eigen::Vector3d& p_map) const;

  /// Faces in triangles with edges of about `edge_m`, vertices of a box shared among its faces, with the mean of their
  /// normals. Left out: what lies within or on another box or under the ground, and what looks into unknown space.
  Surface surface(double edge_m = 0.02) const;

  MapAnswers query(const gpis_mapping::Points3d& points_map) const override;
};

}  // namespace motion_planning
