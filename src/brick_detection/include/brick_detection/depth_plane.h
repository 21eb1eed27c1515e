// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <interactive_mapping_common/config/schema.h>
#include <opencv2/core.hpp>

#include "brick_detection/camera_model.h"

namespace brick_detection {

struct DepthPlaneConfig {
  double grow{1.15};
  double inverse_depth_std{0.003};
  double correlation_px{4.0};
  double systematic_m{0.002};
  double systematic_rad{0.005};
  double min_coverage{0.5};
  double min_inlier_share{0.7};
  int min_pixels{60};

  static void fields(DepthPlaneConfig& c, interactive_mapping::Fields& f) {
    f("grow", c.grow, 0.1, 3.0, "",
      "the quadrangle of the tag grows by this factor about its middle: the plate round the tag counts as well");
    f("inverse_depth_std", c.inverse_depth_std, 1e-6, 0.1, "1/m",
      "standard deviation of the inverse depth of one pixel; times z^2 it is that of the depth z");
    f("correlation_px", c.correlation_px, 1.0, 50.0, "px", "the noise is alike over squares of this edge");
    f("systematic_m", c.systematic_m, 1e-6, 0.1, "m per m",
      "offset of all planes of an image that no averaging removes");
    f("systematic_rad", c.systematic_rad, 1e-6, 0.5, "rad", "tilt of each plane that no averaging removes");
    f("min_coverage", c.min_coverage, 0.0, 1.0, "", "share of the pixels of the quadrangle that must hold a depth");
    f("min_inlier_share", c.min_inlier_share, 0.5, 1.0, "", "share of those that must lie on one plane");
    f("min_pixels", c.min_pixels, 10, 300, "px", "pixels that must lie on the plane");
  }
};

/// Plane n . p + d = 0 in the camera frame, n unit and towards the camera (d > 0).
struct DepthPlane {
  Eigen::Vector3d normal{Eigen::Vector3d::Zero()};
  double d_m{0.0};
  Eigen::Vector3d middle{Eigen::Vector3d::Zero()};  ///< on the plane, in the quadrangle's middle
  /// Of: tilt about two axes of the plane (axis_u, axis_v) [rad], offset of `middle` along the normal [m].
  Eigen::Matrix3d covariance{Eigen::Matrix3d::Identity()};
  Eigen::Vector3d axis_u{Eigen::Vector3d::UnitX()};
  Eigen::Vector3d axis_v{Eigen::Vector3d::UnitY()};
  /// Standard deviation of the offset's part that all planes of one image share; the covariance has it in.
  double shared_offset_m{0.0};
  int num_pixels{0};  ///< inliers; of a large quadrangle only a regular sample is looked at
  double rms_m{0.0};  ///< of the inliers' distances along their rays
};

/// Why there is no plane.
enum class DepthPlaneFailure { kNone, kNoDepth, kTooFewPixels, kNotFlat };

/// Robust plane through the depth pixels inside a quadrangle. A plane's inverse depth is affine in the bearing, and a
/// stereo camera's noise is even in inverse depth. So the problem is linear and evenly weighted. Outliers (mixed
/// pixels, objects before the tag) are left out. `depth_m`: CV_32FC1 of the camera's size, along the optical axis; NaN,
/// +-Inf and <= 0 hold nothing. Nothing, and the reason, if the depth does not show one plane. Throws
/// std::invalid_argument for a depth image of another type or size.
std::optional<DepthPlane> fitDepthPlane(const cv::Mat& depth_m, const CameraModel& camera,
                                        const std::array<Eigen::Vector2d, 4>& quad_px, const DepthPlaneConfig& config,
                                        DepthPlaneFailure* failure = nullptr);

}  // namespace brick_detection
