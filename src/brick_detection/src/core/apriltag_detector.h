// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>

#include "brick_detection/tag_detector.h"

namespace brick_detection {

bool isAprilTagFamily(const std::string& family);

/// By libapriltag. `config` must be valid and of one of its families.
std::unique_ptr<TagDetector> makeAprilTagDetector(const TagDetectorConfig& config);

}  // namespace brick_detection
