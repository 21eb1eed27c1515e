// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/surface.h"

namespace motion_planning {

MapAnswers SnapshotView::query(const gpis_mapping::Points3d& points_map) const {
  gpis_mapping::QueryOptions options;
  options.variance = false;
  gpis_mapping::QueryResult result = snapshot_->query(points_map, options);
  return {std::move(result.distance), std::move(result.surface_std), std::move(result.state)};
}

MapAnswers AskedOnceView::query(const gpis_mapping::Points3d& points_map) const {
  if (points_map.cols() != asked_map_.cols() || points_map != asked_map_) {
    answers_ = map_.query(points_map);
    asked_map_ = points_map;
  }
  return answers_;
}

}  // namespace motion_planning
