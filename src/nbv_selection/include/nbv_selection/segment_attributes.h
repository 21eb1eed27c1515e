// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include <interactive_mapping_enums/nbv_segment.h>

#include "nbv_selection/scene_model.h"
#include "nbv_selection/segment.h"

namespace nbv_selection {

/// What the map's uncertainty says along a segment.
struct SegmentUncertainty {
  double mean{0.0};      // of u over the samples; a sample without an answer counts as the prior
  double frontier{0.0};  // f = (1 / n) sum_j (grad u(x_j) . l)^2 (eqs 10, 11); without an answer: 0
};

/// Of all segments; the map is asked once.
std::vector<SegmentUncertainty> segmentUncertainty(const SceneModel& scene, const std::vector<Segment>& segments);

/// h: mean of the height profile [m].
double pileHeight(const Segment& segment);

using interactive_mapping::SegmentKind;  // kImaginary: mean uncertainty above `imaginary_share` of the prior

std::vector<SegmentKind> classify(const std::vector<Segment>& segments,
                                  const std::vector<SegmentUncertainty>& uncertainty, double prior_uncertainty,
                                  double imaginary_share);

}  // namespace nbv_selection
