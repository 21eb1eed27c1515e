// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include "brick_detection/brick_pose.h"

namespace brick_detection {

/// A picture of the detections, for people. Tags are outlined: green if used, otherwise red with the reason. Bricks are
/// wire boxes with id and axes (x red, y green, z blue). `image`: CV_8UC3 or CV_8UC1, order blue, green, red. Returns
/// CV_8UC3.
cv::Mat drawDetections(const cv::Mat& image, const CameraModel& camera, const BrickPoseEstimator::Result& result,
                       const mp700_ur5e_description::BrickCatalogue& catalogue);

}  // namespace brick_detection
