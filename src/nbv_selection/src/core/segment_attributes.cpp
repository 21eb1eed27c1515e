// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/segment_attributes.h"

#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>

namespace nbv_selection {

std::vector<SegmentUncertainty> segmentUncertainty(const SceneModel& scene, const std::vector<Segment>& segments) {
  std::size_t num_samples = 0;
  for (const Segment& segment : segments) num_samples += segment.samples_map.size();
  gpis_mapping::Points3d points_map(3, static_cast<Eigen::Index>(num_samples));
  Eigen::Index column = 0;
  for (const Segment& segment : segments) {
    for (const Eigen::Vector3d& sample : segment.samples_map) points_map.col(column++) = sample;
  }
  UncertaintyField field;
  if (num_samples > 0) field = scene.uncertainty(points_map);
  if (field.value.size() != points_map.cols() || field.gradient.cols() != points_map.cols()) {
    throw std::runtime_error("the map answered for " + std::to_string(field.value.size()) + " of " +
                             std::to_string(num_samples) + " points");
  }

  std::vector<SegmentUncertainty> result;
  result.reserve(segments.size());
  column = 0;
  for (const Segment& segment : segments) {
    const std::size_t count = segment.samples_map.size();
    if (count == 0) {  // nothing is known along nothing
      result.push_back({scene.priorUncertainty(), 0.0});
      continue;
    }
    SegmentUncertainty sum;
    for (std::size_t i = 0; i < count; ++i, ++column) {
      if (!std::isfinite(field.value[column])) {
        sum.mean += scene.priorUncertainty();
        continue;
      }
      sum.mean += field.value[column];
      const double along = field.gradient.col(column).dot(segment.direction_map);
      if (std::isfinite(along)) sum.frontier += along * along;
    }
    const auto n = static_cast<double>(count);
    result.push_back({sum.mean / n, sum.frontier / n});
  }
  return result;
}

double pileHeight(const Segment& segment) {
  if (segment.profile_m.empty()) return 0.0;
  double sum_m = 0.0;
  for (const float height_m : segment.profile_m) sum_m += static_cast<double>(height_m);
  return sum_m / static_cast<double>(segment.profile_m.size());
}

std::vector<SegmentKind> classify(const std::vector<Segment>& segments,
                                  const std::vector<SegmentUncertainty>& uncertainty, double prior_uncertainty,
                                  double imaginary_share) {
  const std::size_t count = segments.size();
  if (uncertainty.size() != count) {
    throw std::invalid_argument("uncertainty of " + std::to_string(uncertainty.size()) + " segments, must be of " +
                                std::to_string(count));
  }
  const double limit = imaginary_share * prior_uncertainty;
  if (!std::isfinite(limit) || !(limit > 0.0)) {
    std::ostringstream text;
    text << "prior_uncertainty = " << prior_uncertainty << ", imaginary_share = " << imaginary_share
         << ", must both be finite and > 0";
    throw std::invalid_argument(text.str());
  }
  std::vector<SegmentKind> kinds(count, SegmentKind::kReal);
  for (std::size_t i = 0; i < count; ++i) {
    // Also without a number: nobody may be sent there.
    if (!(uncertainty[i].mean <= limit)) kinds[i] = SegmentKind::kImaginary;
  }
  for (std::size_t i = 0; i < count; ++i) {
    if (kinds[i] == SegmentKind::kImaginary) continue;
    const auto [before, after] = neighbours(segments, i);
    if (kinds[before] == SegmentKind::kImaginary || kinds[after] == SegmentKind::kImaginary) {
      kinds[i] = SegmentKind::kFrontier;
    }
  }
  return kinds;
}

}  // namespace nbv_selection
