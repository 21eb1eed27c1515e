// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "synthetic_depth/scene.h"

namespace synthetic_depth {

/// Strength of the light that each pixel's surface sends back: albedo cos(incidence) / range^2 [1/m^2], that of a
/// Lambertian surface larger than the beam (range equation of active sensors, e.g. Wagner, ISPRS J. Photogramm. 65(6), 2010). A
/// white surface that faces the camera at 1 m has 1. CV_32FC1; 0 where `exact_depth_m` is not finite.
/// The incidence comes from the neighbours' depth: exact on planes, and at an edge that of the flatter side.
/// `exact_depth_m`: CV_32FC1, z-depth. `albedo`: CV_32FC1 in [0, 1]; empty for 1 everywhere. Both of the camera's size.
cv::Mat returnStrength(const CameraModel& camera, const cv::Mat& exact_depth_m, const cv::Mat& albedo);

/// Pixels without a return: outside of the depth camera's own view, of too little strength, beside depth edges (see
/// SensorModel). CV_8UC1, 255 = no return; empty if these effects are off. Fixed by all arguments; what changes from frame
/// to frame changes in patches of several pixels. Images as for returnStrength(), sizes are not checked.
cv::Mat missingReturns(const CameraModel& camera, const SensorModel& sensor, std::uint64_t seed, std::uint64_t frame,
                       const cv::Mat& exact_depth_m, const cv::Mat& albedo);

/// Everything wrong with the parameters of missingReturns(), one line each as "sensor/key = value unit, must be ...".
std::vector<std::string> missingReturnProblems(const CameraModel& camera, const SensorModel& sensor);

}  // namespace synthetic_depth
