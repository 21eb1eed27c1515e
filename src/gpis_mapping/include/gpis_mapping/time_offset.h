// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_TIME_OFFSET_H
#define GPIS_MAPPING_TIME_OFFSET_H

#include <cstddef>

#include "gpis_mapping/depth_sequence.h"

namespace gpis_mapping {

/// Largest time offset that is looked for [s], in both directions.
constexpr double kMaxEstimatedOffset_s = 0.2;

struct TimeOffsetEstimate {
  double offset_s{0.0};  // to be given to DepthSequence::setTimeOffset
  double spread_s{0.0};  // standard deviation of what the parts of the recording say, each for itself
  double residual_at_zero_m{
      0.0};                  // mean difference of depths that should be the same, each cut off at 3 % of the depth
  double residual_m{0.0};    // the same with the offset
  std::size_t num_pairs{0};  // of images
  std::size_t num_parts{0};  // of the recording
};

/// The clock offset between images and poses, from pairs of images [first, last] alone. Depths of one, moved into the
/// other, fit best when the poses are those of the images' moments. Only a change of the camera's velocity between the
/// two images tells: under a steady motion their relative pose does not depend on the offset. Takes about ten seconds.
/// Throws DepthSequenceError with the reason when the poses have no stamps, or the camera moves too little or too
/// steadily. Also when the parts of the recording contradict each other. Throws std::out_of_range for last >=
/// sequence->size().
TimeOffsetEstimate estimateTimeOffset(DepthSequence* sequence, std::size_t first, std::size_t last);

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_TIME_OFFSET_H
