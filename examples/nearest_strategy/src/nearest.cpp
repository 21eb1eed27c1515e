// SPDX-License-Identifier: BSD-3-Clause
#include <optional>
#include <tuple>

#include <nbv_selection_ros/gpis_strategy.h>
#include <pluginlib/class_list_macros.hpp>

namespace nearest_strategy {

/// Drives to the nearest pose from which the arm can pick something, or to the nearest candidate if there is none.
class Nearest : public nbv_selection_ros::GpisStrategy {
 protected:
  std::optional<std::size_t> choose(const nbv_selection::Selection& selection) override {
    std::optional<std::size_t> best;
    for (std::size_t i = 0; i < selection.segments.size(); ++i) {
      const nbv_selection::ScoredSegment& segment = selection.segments[i];
      if (segment.verdict != nbv_selection::SegmentVerdict::kCandidate) continue;
      if (!best || rank(segment) < rank(selection.segments[*best])) best = i;
    }
    return best;
  }

 private:
  /// Poses of recent failures come last, then those out of the arm's reach, then the far ones.
  static std::tuple<bool, bool, double> rank(const nbv_selection::ScoredSegment& segment) {
    return {segment.utility.failure_penalty > 0.5, segment.attributes.manipulability <= 0.0,
            segment.attributes.distance_m};
  }
};

}  // namespace nearest_strategy

PLUGINLIB_EXPORT_CLASS(nearest_strategy::Nearest, nbv_selection_ros::Strategy)
