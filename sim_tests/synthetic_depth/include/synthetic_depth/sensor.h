// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include <opencv2/core.hpp>

#include "synthetic_depth/scene.h"

namespace synthetic_depth {

/// Standard deviation of axial noise at depth z [m].
double axialSigma(const SensorModel& sensor, double z_m);

/// Turns the exact depth of a frame into a measurement by `scene.sensor`: lateral jitter, flying pixels at depth edges,
/// shadows, axial noise, disparity steps, range limits, dropout, missing returns, in this order. CV_32FC1 with REP-117 values: NaN =
/// no measurement, -Inf = too close, +Inf = nothing within range. Shadows are exact: the line from the second viewpoint
/// to each pixel's point is cast, and that viewpoint's field of view is taken as unlimited.
/// The result is fixed by (scene, frame, scene.seed); switching one effect does not change the draws of another.
/// `exact_depth_m`: from renderDepth() of the same frame. Throws std::invalid_argument if its size or type is another.
cv::Mat applySensor(const Scene& scene, int frame, const cv::Mat& exact_depth_m);

/// The same effects, in the same order and with the same draws, on an exact depth image whose scene is not at hand, for
/// instance a rendered one. `shadow_mask`: CV_8UC1, non-zero where the second viewpoint sees nothing; empty for none
/// (`has_shadows` is not looked at). `albedo`: CV_32FC1 in [0, 1]; empty for 1 everywhere. A jittered ray's depth is interpolated in the image. Fixed by all arguments.
/// Throws std::invalid_argument if an image's size or type is another than the camera's.
cv::Mat applySensor(const CameraModel& camera, const SensorModel& sensor, std::uint64_t seed, std::uint64_t frame,
                    const cv::Mat& exact_depth_m, const cv::Mat& shadow_mask, const cv::Mat& albedo = {});

/// renderDepth() and applySensor() in one.
cv::Mat measureDepth(const Scene& scene, int frame);

/// CV_32FC1 metres to CV_16UC1; NaN, infinities, negative depth and what does not fit into 16 bits become 0 (invalid).
/// Rounded to the nearest unit. units_per_metre: 5000 for TUM RGB-D files, 1000 for 16UC1 messages (REP-118).
cv::Mat encodeDepth16(const cv::Mat& depth_m, double units_per_metre);

/// The reverse; 0 becomes NaN.
cv::Mat decodeDepth16(const cv::Mat& depth_units, double units_per_metre);

}  // namespace synthetic_depth
