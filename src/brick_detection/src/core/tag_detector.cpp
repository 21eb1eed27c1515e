// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/tag_detector.h"

#include <algorithm>

namespace brick_detection {

double TagObservation::shortestSide() const {
  double shortest = (corners_px[0] - corners_px[3]).norm();
  for (std::size_t i = 0; i < 3; ++i) shortest = std::min(shortest, (corners_px[i + 1] - corners_px[i]).norm());
  return shortest;
}

}  // namespace brick_detection
