// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>
#include <mp700_ur5e_description/brick_types.h>

#include "brick_detection/brick_pose.h"

namespace brick_detection {

/// For markers whose poses another program has found and gives without covariance.
struct MarkerConfig {
  double position_std_m{0.010};
  double rotation_std_rad{0.05};
  double same_brick_m{0.06};
  double same_brick_rad{0.30};

  static void fields(MarkerConfig& c, interactive_mapping::Fields& f) {
    f("position_std_m", c.position_std_m, 1e-5, 1.0, "m", "standard deviation of a marker of ar_track_alvar");
    f("rotation_std_rad", c.rotation_std_rad, 1e-4, 1.0, "rad", "the same of its rotation, about each axis");
    f("same_brick_m", c.same_brick_m, 1e-3, 1.0, "m",
      "markers whose poses of a brick differ by more show several bricks with one id");
    f("same_brick_rad", c.same_brick_rad, 1e-3, 3.0, "rad", "the same of their orientation");
  }
};

/// Frame of the marker: x right, y up, z out of it, as TagLayout's tags and those of ar_track_alvar.
struct MarkerObservation {
  int id{0};
  Eigen::Isometry3d T_camera_tag{Eigen::Isometry3d::Identity()};
};

/// From markers to bricks. Markers of one brick that agree are averaged by their information; those that do not are
/// bricks with one id. A marker that occurs twice belongs to two bricks. Neither the two poses that fit a flat marker
/// nor the depth are looked at: that was for the program that found them. A pose that is not finite, or no rotation, is
/// TagStatus::kInconsistent. The tags of the result have no corners.
BrickPoseEstimator::Result sightingsOfMarkers(const std::vector<MarkerObservation>& markers,
                                              const mp700_ur5e_description::BrickCatalogue& catalogue,
                                              const MarkerConfig& config);

}  // namespace brick_detection
