// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>

#include "brick_detection/tag_detector.h"

namespace brick_detection {

bool isArucoFamily(const std::string& family);

/// By OpenCV. `config` must be valid and of one of the dictionaries.
std::unique_ptr<TagDetector> makeArucoDetector(const TagDetectorConfig& config);

}  // namespace brick_detection
