// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>
#include <gpis_mapping/map_snapshot.h>
#include <gpis_mapping/types.h>

namespace motion_planning {

/// The mapped surface as planning takes it in. Frame: map.
struct Surface {
  std::vector<Eigen::Vector3d> vertices_map;
  std::vector<Eigen::Vector3f> normals_map;             // unit, into free space
  std::vector<std::array<std::uint32_t, 3>> triangles;  // counter-clockwise seen from free space
};

/// What planning asks the map. Answers as gpis_mapping::QueryResult has them.
struct MapAnswers {
  Eigen::VectorXd distance_m;     // signed, negative inside; NaN: unknown
  Eigen::VectorXd surface_std_m;  // position uncertainty of the nearest surface
  std::vector<gpis_mapping::SpaceState> state;
};

class MapView {
 public:
  virtual ~MapView() = default;
  /// At the columns of `points_map` [m]. Throws std::runtime_error if the map does not answer.
  virtual MapAnswers query(const gpis_mapping::Points3d& points_map) const = 0;
};

/// The same map, which is not asked twice in a row for the same points. For builders in step with each other, whose
/// queries are the same. For one state of the map, and one thread.
class AskedOnceView : public MapView {
 public:
  explicit AskedOnceView(const MapView& map) : map_(map) {}
  MapAnswers query(const gpis_mapping::Points3d& points_map) const override;

 private:
  const MapView& map_;
  mutable gpis_mapping::Points3d asked_map_;
  mutable MapAnswers answers_;  // to asked_map_
};

/// A map in this process.
class SnapshotView : public MapView {
 public:
  explicit SnapshotView(std::shared_ptr<const gpis_mapping::MapSnapshot> snapshot) : snapshot_(std::move(snapshot)) {}
  MapAnswers query(const gpis_mapping::Points3d& points_map) const override;

 private:
  std::shared_ptr<const gpis_mapping::MapSnapshot> snapshot_;
};

}  // namespace motion_planning
