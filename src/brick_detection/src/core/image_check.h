// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <stdexcept>
#include <string>

#include <opencv2/core.hpp>

#include "brick_detection/camera_model.h"

namespace brick_detection {

/// Throws std::invalid_argument unless the image has the camera's size and this type.
inline void requireImageOf(const CameraModel& camera, const std::string& name, const cv::Mat& image, int type,
                           const std::string& type_name) {
  if (image.type() == type && image.cols == camera.width_px && image.rows == camera.height_px) return;
  throw std::invalid_argument(name + " image = " + std::to_string(image.cols) + " x " + std::to_string(image.rows) +
                              " of type " + std::to_string(image.type()) + ", must be " +
                              std::to_string(camera.width_px) + " x " + std::to_string(camera.height_px) + " of type " +
                              type_name);
}

}  // namespace brick_detection
