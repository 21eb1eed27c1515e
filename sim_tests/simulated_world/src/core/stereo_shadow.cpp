// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/stereo_shadow.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace simulated_world {

cv::Mat stereoShadowMask(const synthetic_depth::CameraModel& camera, double baseline_m, const cv::Mat& exact_depth_m) {
  if (exact_depth_m.type() != CV_32FC1 || exact_depth_m.cols != camera.width_px ||
      exact_depth_m.rows != camera.height_px) {
    throw std::invalid_argument("stereoShadowMask: depth image is " + std::to_string(exact_depth_m.cols) + " x " +
                                std::to_string(exact_depth_m.rows) + " of OpenCV type " +
                                std::to_string(exact_depth_m.type()) + ", must be " + std::to_string(camera.width_px) +
                                " x " + std::to_string(camera.height_px) + " px of CV_32FC1 (5)");
  }
  if (!(baseline_m >= 0.0)) {
    throw std::invalid_argument("stereoShadowMask: baseline_m = " + std::to_string(baseline_m) + " m, must be >= 0 m");
  }
  // Both views have the same rows, and a point at column u of the first is at u - f B / z of the second. A surface hides
  // a farther one where the two change places: to the right in the first view, to the left in the second. Walking each
  // row from the right, the leftmost column of the second view seen so far is all that has to be remembered.
  constexpr double kRounding_px = 1e-3;  // of the depth buffer, through f B / z
  const double fx_baseline = camera.fx_px * baseline_m;
  cv::Mat mask = cv::Mat::zeros(exact_depth_m.size(), CV_8UC1);
  for (int v = 0; v < mask.rows; ++v) {
    const float* const depth_row = exact_depth_m.ptr<float>(v);
    unsigned char* const mask_row = mask.ptr<unsigned char>(v);
    double leftmost = std::numeric_limits<double>::infinity();
    for (int u = mask.cols - 1; u >= 0; --u) {
      if (!std::isfinite(depth_row[u])) {
        continue;  // neither casts a shadow nor shows one
      }
      const double column = u - fx_baseline / static_cast<double>(depth_row[u]);
      if (column > leftmost + kRounding_px) {
        mask_row[u] = 255;
      } else {
        leftmost = std::min(leftmost, column);
      }
    }
  }
  return mask;
}

}  // namespace simulated_world
