// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>
#include <base_navigation/planar.h>
#include <interactive_mapping_common/config/schema.h>

#include "nbv_selection/outline.h"

namespace nbv_selection {

struct SegmentConfig {
  double spacing_m{0.16};
  double standoff_m{0.12};
  double sample_spacing_m{0.03};
  double profile_depth_m{0.25};

  static void fields(SegmentConfig& c, interactive_mapping::Fields& f) {
    f("spacing_m", c.spacing_m, 0.02, 2.0, "m",
      "distance of neighbouring segments along the outline: 0.16 m makes about 50 round a pile of 4 m^2");
    f("standoff_m", c.standoff_m, 0.0, 2.0, "m", "distance of the foremost edge of the footprint to the segment");
    f("sample_spacing_m", c.sample_spacing_m, 0.005, 0.5, "m", "distance of the samples along the segment");
    f("profile_depth_m", c.profile_depth_m, 0.02, 2.0, "m", "reach of the height profile into the pile");
  }
};

/// A piece of the pile's outline, as long as the robot is wide: a place to stand at (method section 5).
struct Segment {
  int outline{0};    // index of its polygon
  double at_m{0.0};  // arc length on the ground of its middle along the polygon, from the first corner
  Eigen::Vector3d midpoint_map{Eigen::Vector3d::Zero()};    // on the ground plane
  Eigen::Vector3d direction_map{Eigen::Vector3d::UnitX()};  // l_i: unit, in the ground plane, the pile on its left
  Eigen::Vector3d outward_map{Eigen::Vector3d::UnitY()};  // unit, in the ground plane, square to it, away from the pile
  double length_m{0.0};
  std::vector<Eigen::Vector3d> samples_map;  // x_j: along the outline, on the ground plane, evenly, at least two
  std::vector<float> profile_m;              // per sample: height of the pile from there inwards, 0 where there is none
  base_navigation::Pose2d standing_map;      // of base_link: faces the pile, square to the segment
};

/// Cuts outlines into segments, one every `spacing_m` of arc length (rounded so that they close evenly), at least four
/// per outline. Each is the stretch of outline of the footprint's width about its middle, but at most half of the
/// outline. The rest lies on the other side of the pile. Its direction is that of the chord of the stretch (of a
/// shorter one where its ends all but meet). Its midpoint lies beside the stretch's middle, on the line along it that
/// touches the stretch from outside. So the robot's front stays clear of all of it. Round a concave corner that line
/// spans the mouth. The corner may then be farther off than the arm reaches; the manipulability judges that. Lengths
/// are those on the ground plane. Neighbours stand next to each other in the result, outline by outline,
/// counter-clockwise; the last and the first of an outline are neighbours, too. `footprint` is that of base_link, `x`
/// forward. Throws std::invalid_argument for an impossible config, footprint (not convex, base_link not in it, narrower
/// than the spacing) or outline.
std::vector<Segment> cutSegments(const PileOutline& outline, const base_navigation::Polygon& footprint,
                                 const SegmentConfig& config);

/// Indices of the two neighbours of segment `i` on its outline, the clockwise one first; i itself if it is the only
/// one. Throws std::invalid_argument if there is no segment `i`.
std::pair<std::size_t, std::size_t> neighbours(const std::vector<Segment>& segments, std::size_t i);

}  // namespace nbv_selection
