// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <mp700_ur5e_description/brick_types.h>

namespace brick_detection {

enum class SpaceState { kUnknown, kFree, kOccupied };

struct FaceAccessConfig {
  double corridor_m{0.15};     ///< length of the way that must be clear before a face
  double tool_radius_m{0.05};  ///< half the width of that way
  double gap_m{0.03};          ///< nearest to the face is not asked about: the brick's own surface is there
  double sample_m{0.03};       ///< spacing of the points asked about
  double max_down_rad{0.20};   ///< faces whose normal points below the horizontal by more cannot be touched
  double unknown_weight{0.5};  ///< what unseen space counts for, free being 1 and occupied 0
  double min_clear{0.6};       ///< with less of the way clear a face cannot be reached

  std::vector<std::string> validate() const;
};

/// How a magnet could come to a face.
struct FaceAccess {
  mp700_ur5e_description::BrickFace face{mp700_ur5e_description::BrickFace::kPlusX};
  Eigen::Isometry3d T_map_plate{Eigen::Isometry3d::Identity()};  ///< middle of the plate, z out, y up as the tag's
  double accessibility{0.0};  ///< in (0, 1]: clear share of the way, times (1 + upward part of the normal) / 2
  double free_share{0.0};
  double unknown_share{0.0};
};

/// Points of the way to a face: a cylinder's, from gap_m to gap_m + corridor_m before the plate [m, map frame].
Eigen::Matrix3Xd approachPoints(const Eigen::Isometry3d& T_map_plate, const FaceAccessConfig& config);

/// A brick as an obstacle to others.
struct BrickBox {
  Eigen::Isometry3d T_map_brick{Eigen::Isometry3d::Identity()};
  Eigen::Vector3d size_m{Eigen::Vector3d::Zero()};
};

/// The faces that carry a plate and can be reached, easiest first; equal ones in the order of their names. `state`: of
/// approachPoints(), by the map; may be empty, and then all is unknown. Space inside one of `others` is occupied whatever
/// the map says.
std::vector<FaceAccess> graspableFaces(const Eigen::Isometry3d& T_map_brick,
                                       const mp700_ur5e_description::BrickType& type,
                                       const std::vector<BrickBox>& others,
                                       const std::function<std::vector<SpaceState>(const Eigen::Matrix3Xd&)>& state,
                                       const FaceAccessConfig& config);

}  // namespace brick_detection
