// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <optional>

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include "brick_detection/camera_model.h"
#include "brick_detection/tag_detector.h"

namespace brick_detection {

/// What the cells of a tag say about the corners of its border.
struct CellFit {
  /// Where the cells have the corners, the border's edge left out, minus where they were found [px].
  std::array<Eigen::Vector2d, 4> shift_px{};
  double shift_std_px{0.0};   ///< of a corner's coordinate there, where nothing is wrong; the worst of the eight
  double bend_px{0.0};        ///< by how much the middle is off the plane through the corners, as seen
  double bend_std_px{0.0};    ///< where nothing is wrong
  double damaged_share{0.0};  ///< of the tag's area: neither black nor white where it should be
};

/// Compares a tag's image with its known cells: brightness is a plane for black and one for white, blurred by a lens; the
/// corners, that blur and a bend are fitted by least squares on the pixels (Lucas and Kanade), robustly. A border that is
/// covered, in glare, cut off or not flat is off from its cells by more than the pixels' noise. Nothing if the tag has
/// no cells, or too few pixels are in the image.
std::optional<CellFit> fitCells(const cv::Mat& grey, const CameraModel& camera, const TagObservation& tag);

}  // namespace brick_detection
