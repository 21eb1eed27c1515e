// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>
#include <depth_camera/distortion.h>

namespace brick_detection {

using depth_camera::Distortion;

/// Camera with the optical frame of REP-103 (z forward, x right, y down). Pixel centres are at integers.
struct CameraModel {
  int width_px{0};
  int height_px{0};
  double fx_px{0.0};
  double fy_px{0.0};
  double cx_px{0.0};
  double cy_px{0.0};
  Distortion distortion{Distortion::kNone};
  std::vector<double> coefficients;

  /// One sentence per problem with value and allowed range; empty: fine.
  std::vector<std::string> validate() const;

  /// Pixel where a point is seen, distortion included. NaN unless it is in front of the camera.
  Eigen::Vector2d project(const Eigen::Vector3d& p_camera) const;

  /// Direction (x/z, y/z) of what a pixel sees.
  Eigen::Vector2d bearing(const Eigen::Vector2d& pixel) const;
};

}  // namespace brick_detection
