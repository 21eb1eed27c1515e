// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <string>

namespace depth_camera {

/// Lens distortion by OpenCV's formulas, under the names of sensor_msgs/CameraInfo.
enum class Distortion {
  kNone,
  kPlumbBob,            ///< k1 k2 p1 p2 [k3]
  kRationalPolynomial,  ///< k1 k2 p1 p2 k3 k4 k5 k6 [s1 s2 s3 s4 [tx ty]]
  kEquidistant          ///< fisheye: k1 k2 k3 k4
};

/// What a CameraInfo calls `distortion_model`; "" is none. Nothing for a name that is not known.
std::optional<Distortion> distortionNamed(const std::string& model);

/// Empty when the distortion can have `count` coefficients; otherwise how many it can have, as "4 or 5".
std::string countsOtherThan(std::size_t count, Distortion distortion);

}  // namespace depth_camera
