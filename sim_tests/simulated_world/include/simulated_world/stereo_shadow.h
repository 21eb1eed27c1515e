// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include "synthetic_depth/scene.h"

namespace simulated_world {

/// Pixels whose points a second viewpoint, `baseline_m` to the right of the camera, cannot see: CV_8UC1, 255 in shadow.
/// Made from the exact depth image alone (CV_32FC1, +Inf = no return), so what stands outside the image casts no shadow,
/// and what the camera sees counts as solid behind its front: exact, up to the pixel at the shadow's border, for
/// surfaces at least as wide as the baseline; the shadow of a narrower one is too wide. O(pixels).
/// Throws std::invalid_argument for another image size or type, or a baseline that is not >= 0.
cv::Mat stereoShadowMask(const synthetic_depth::CameraModel& camera, double baseline_m, const cv::Mat& exact_depth_m);

}  // namespace simulated_world
