// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include <opencv2/core.hpp>

#include "brick_detection/tag_detector.h"

/// What the detectors have in common.
namespace brick_detection {

/// Throws std::invalid_argument unless CV_8UC1 and not empty.
void requireGrey(const cv::Mat& grey);

/// By id; tags of one id from left to right, then from top to bottom.
void sortById(std::vector<TagObservation>* tags);

}  // namespace brick_detection
