// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include "brick_detection/camera_model.h"

namespace brick_detection {

struct DepthPlaneConfig {
  double grow{1.15};  ///< of the tag's quadrangle about its middle: the plate round the tag counts as well
  double inverse_depth_std{0.003};  ///< noise of one pixel of a stereo camera [1/m]: z^2 times this in metres
  double correlation_px{4.0};       ///< neighbouring pixels' noise is alike over so many pixels, edge of a square
  double systematic_m{0.002};       ///< offset that no averaging removes, alike all over an image [m per m of depth]
  double systematic_rad{0.005};     ///< tilt that no averaging removes, another for each plane
  double min_coverage{0.5};         ///< share of the quadrangle's pixels that must hold a depth
  double min_inlier_share{0.7};     ///< of those, on one plane
  int min_pixels{60};               ///< on the plane

  std::vector<std::string> validate() const;
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
/// stereo camera's noise is even in inverse depth: a linear, evenly weighted problem, with outliers (mixed pixels, what
/// stands before the tag) left out. `depth_m`: CV_32FC1 of the camera's size, along the optical axis; NaN,
/// +-Inf and <= 0 hold nothing. Nothing, and the reason, if the depth does not show one plane. Throws
/// std::invalid_argument for a depth image of another type or size.
std::optional<DepthPlane> fitDepthPlane(const cv::Mat& depth_m, const CameraModel& camera,
                                        const std::array<Eigen::Vector2d, 4>& quad_px, const DepthPlaneConfig& config,
                                        DepthPlaneFailure* failure = nullptr);

}  // namespace brick_detection
