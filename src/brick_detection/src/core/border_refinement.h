// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>

#include <Eigen/Core>
#include <opencv2/core.hpp>

namespace brick_detection {

/// Corners of a tag's border as the intersections of lines fitted to its four edges. Each edge is sampled by profiles
/// across it; where the step lies in a profile is found from its area, which no symmetric blur shifts; profiles that do not
/// fit the line (something lies over the border) are weighed down. `corners_px`: in order round the tag, off by less than
/// two pixels; returned as they are for a border too small or too weak to do better. `border_cells`: along the border's
/// outer edge. Straight edges are assumed: those of a large tag in the corner of a distorted image are not quite.
std::array<Eigen::Vector2d, 4> refineBorder(const cv::Mat& grey, const std::array<Eigen::Vector2d, 4>& corners_px,
                                            int border_cells);

}  // namespace brick_detection
