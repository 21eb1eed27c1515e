// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <opencv2/core.hpp>

namespace simulated_world {

/// The cells of a square tag, upright: CV_8UC1 with one pixel per cell, 0 black or 255 white, the black border being the
/// outermost ring. `family` is "tag36h11" (AprilTag library) or an OpenCV dictionary "DICT_4X4_1000", "DICT_5X5_1000" or
/// "DICT_6X6_1000". Throws std::invalid_argument for another family, or an id the family has not.
cv::Mat tagCells(const std::string& family, int id);

}  // namespace simulated_world
