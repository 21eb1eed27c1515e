// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include <opencv2/core.hpp>

namespace brick_detection {

/// Kinds of images that hold no tag, but something like one.
enum class HardNegative {
  kCheckerboard,   ///< seen aslant
  kText,           ///< lines of letters, some in boxes
  kRandomSquares,  ///< cells at random within black borders on white paper: codes of no family at all
  kNoise,          ///< white and coloured noise
  kPile,           ///< bricks with bare plates
  kFrames,         ///< black frames, filled and empty, one in the other
  kGrid,           ///< dark lines: tiles, shelves
  kRectangles      ///< rectangles at random
};
constexpr int kNumHardNegatives = 8;

/// CV_8UC1, 640 x 480. The same kind and seed give the same image.
cv::Mat hardNegative(HardNegative kind, std::uint32_t seed);

}  // namespace brick_detection
