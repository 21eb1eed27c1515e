// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>
#include <interactive_mapping_enums/query_map.h>
#include <mp700_ur5e_description/brick_types.h>

namespace brick_detection {

using interactive_mapping::SpaceState;

struct FaceAccessConfig {
  double corridor_m{0.15};
  double tool_radius_m{0.05};
  double gap_m{0.03};
  double sample_m{0.03};
  double max_down_rad{0.20};
  double unknown_weight{0.5};
  double min_clear{0.6};

  static void fields(FaceAccessConfig& c, interactive_mapping::Fields& f) {
    f("corridor_m", c.corridor_m, 0.01, 2.0, "m", "length of the corridor that must be clear before a face");
    f("tool_radius_m", c.tool_radius_m, 0.005, 0.5, "m", "half the width of the corridor");
    f("gap_m", c.gap_m, 0.0, 0.5, "m",
      "the map is not asked about points nearer to the face: the surface of the brick itself is there");
    f("sample_m", c.sample_m, 0.005, 0.2, "m", "distance of the points that the map is asked about");
    f("max_down_rad", c.max_down_rad, 0.0, 1.5707963267948966, "rad",
      "a face that points farther below the horizontal cannot be touched");
    f("unknown_weight", c.unknown_weight, 0.0, 1.0, "", "clear share of unseen space; free space counts 1, occupied 0");
    f("min_clear", c.min_clear, 0.0, 1.0, "", "a face with a smaller clear share of its corridor cannot be reached");
  }
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
