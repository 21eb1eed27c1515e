// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_MAP_SNAPSHOT_H
#define GPIS_MAPPING_MAP_SNAPSHOT_H

#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include <Eigen/Core>

#include "gpis_mapping/cell_gp.h"
#include "gpis_mapping/cell_pages.h"
#include "gpis_mapping/gpis_config.h"
#include "gpis_mapping/observed_layer.h"
#include "gpis_mapping/types.h"

namespace gpis_mapping {

/// Answers at N points. A number is NaN where the map has no answer.
struct QueryResult {
  Eigen::VectorXd distance;            // signed [m]: f in its band, nearest surface with the sign of its side beyond
  Points3d gradient;                   // d distance / dx
  Eigen::VectorXd variance;            // of the field f [m^2]: up to the prior's away from data
  Points3d variance_gradient;          // d variance / dx [m]; empty unless asked for
  Eigen::VectorXd occupancy;           // P(f < 0); none in unknown space
  Eigen::VectorXd euclidean_distance;  // unsigned, to the nearest mapped surface [m]
  Points3d euclidean_gradient;         // away from that surface
  Eigen::VectorXd surface_std;         // position uncertainty of the nearest surface along its normal [m]
  std::vector<SpaceState> state;
};

/// What to compute beside distance, gradient, Euclidean distance and state, which are always there.
struct QueryOptions {
  bool variance{true};  // variance, occupancy
  bool variance_gradient{false};
  int threads{0};  // 0: all cores
};

/// The field f alone (eq 3 with blended cells), as marching cubes and planners differentiate it.
struct FieldSample {
  double value;              // [m]
  Eigen::Vector3d gradient;  // blend weights' derivatives included
  bool valid;                // false: no training point within the blend radius
};

/// Immutable state of the map after one update; safe for any number of concurrent readers.
class MapSnapshot {
 public:
  /// Space this near before a seen surface counts as free, seen free or not [blocks of the observed layer].
  static constexpr double kFreeReach_blocks = 1.5;

  MapSnapshot(const GpisConfig& config, CellPages cells, ObservedLayer observed, double epoch_s,
              std::uint64_t num_updates);
  ~MapSnapshot();
  MapSnapshot(const MapSnapshot&) = delete;
  MapSnapshot& operator=(const MapSnapshot&) = delete;

  /// Answers at the columns of `points_map` [m]. Non-finite points get no answer and state unknown. Cost per point:
  /// one nearest-neighbour look-up plus O(n) for the field, O(n^2) for its variance, n = points per cell (about 80).
  /// Many points at once cost less each; the answer at a point is the same to the bit whichever points come with it.
  QueryResult query(const Points3d& points_map, const QueryOptions& options = {}) const;

  FieldSample field(const Eigen::Vector3d& p_map) const;

  /// Free, occupied or unknown at a point whose signed distance is known (NaN: no surface near).
  SpaceState state(const Eigen::Vector3d& p_map, double distance_m) const;

  const GpisConfig& config() const { return config_; }
  const CellPages& cells() const { return cells_; }
  const ObservedLayer& observed() const { return observed_; }
  double epoch() const { return epoch_s_; }  // stamp of the first update [s]
  std::uint64_t numUpdates() const { return num_updates_; }
  std::size_t numPoints() const { return cells_.numPoints(); }
  std::size_t memoryBytes() const;

 private:
  class NearestIndex;
  class CellQuery;

  const NearestIndex& nearestIndex() const;

  GpisConfig config_;
  CellPages cells_;
  ObservedLayer observed_;
  double epoch_s_;
  std::uint64_t num_updates_;
  mutable std::once_flag nearest_once_;  // the index is built by the first query far from all surfaces
  mutable std::unique_ptr<NearestIndex> nearest_;
};

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_MAP_SNAPSHOT_H
