// SPDX-License-Identifier: BSD-3-Clause
#ifndef OCTOMAP_BASELINE_DYNAMIC_OCTOMAP_H
#define OCTOMAP_BASELINE_DYNAMIC_OCTOMAP_H

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include <Eigen/Geometry>
#include <octomap/OcTree.h>

#include "gpis_mapping/depth_classifier.h"
#include "gpis_mapping/types.h"
#include "octomap_baseline/octomap_config.h"
#include "octomap_baseline/voxel_set.h"

namespace octomap_baseline {

/// What one update did, and how long each stage took [ms].
struct OctomapUpdateStatistics {
  double total_ms{0};
  double classify_ms{0};     // pixels to surface, wall, no information
  double cast_ms{0};         // pixels to end voxels, rays to voxels passed through
  double update_ms{0};       // the octree
  std::size_t points_in{0};  // measured pixels
  std::size_t rays{0};       // one per end voxel
  std::size_t hit_voxels{0};
  std::size_t missed_voxels{0};  // passed through and not hit
  std::size_t inserted{0};       // voxels that became occupied
  std::size_t freed{0};          // voxels that were occupied and are free now
  std::size_t occupied{0};       // voxels in the map
  std::size_t nodes{0};          // of the octree, inner ones included

  Eigen::AlignedBox3d view_box_map;  // see DepthClassifier::viewBox()
};

/// OctoMap that forgets. An image with nothing in reach along a ray clears it up to the sensor's range (the virtual
/// wall). Every voxel takes part in an image's update at most once, hits before misses. Not thread-safe: one thread at
/// a time, readers of tree() included.
class DynamicOctomap {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  explicit DynamicOctomap(const OctomapConfig& config);

  /// Takes in one depth image seen from `T_map_camera` (optical frame to map) at `stamp_s` [s].
  /// Throws std::invalid_argument, and leaves the map as it was, if the image does not fit the camera or the camera is
  /// impossible. So it does if pose or stamp are not finite, the pose is no rigid motion, or it is outside what an
  /// octree can hold.
  OctomapUpdateStatistics update(const gpis_mapping::DepthImage& image, const gpis_mapping::CameraModel& camera,
                                 const Eigen::Isometry3d& T_map_camera, double stamp_s);

  const octomap::OcTree& tree() const { return *tree_; }

  /// Forgets everything.
  void clear();

  /// Makes every known voxel free whose centre is in the box [m], map frame; unknown ones stay unknown. Returns how
  /// many occupied voxels were freed. Throws std::invalid_argument if a corner is not finite or min is above max.
  std::size_t clearBox(const Eigen::Vector3d& min_map, const Eigen::Vector3d& max_map);

  const OctomapConfig& config() const { return config_; }
  std::size_t numOccupied() const { return num_occupied_; }
  /// Stamp of the last update [s]; 0 before the first.
  double stamp() const { return stamp_s_; }
  std::uint64_t numUpdates() const { return num_updates_; }

 private:
  struct View;

  void prepareCamera(const gpis_mapping::CameraModel& camera);
  bool inRegion(const octomap::OcTreeKey& key) const {
    for (unsigned axis = 0; axis < 3; ++axis) {
      if (key[axis] < region_min_[axis] || key[axis] > region_max_[axis]) return false;
    }
    return true;
  }
  void collectEnds(const View& view, VoxelSet* hits, VoxelSet* ends);
  void castRays(const View& view, const VoxelSet& ends, VoxelSet* misses, OctomapUpdateStatistics* statistics);
  void applyMisses(const View& view, const VoxelSet& misses, const VoxelSet& hits, OctomapUpdateStatistics* statistics);
  void applyHits(const VoxelSet& hits, OctomapUpdateStatistics* statistics);
  /// Whether the pixels around an occupied voxel leave no doubt that it is empty.
  bool isSeenThrough(const View& view, const octomap::OcTreeKey& key) const;

  OctomapConfig config_;
  gpis_mapping::GpisConfig classifier_config_;
  int threads_;
  std::unique_ptr<octomap::OcTree> tree_;
  octomap::OcTreeKey region_min_;
  octomap::OcTreeKey region_max_;
  double stamp_s_{0.0};
  std::uint64_t num_updates_{0};
  std::size_t num_occupied_{0};  // voxels

  gpis_mapping::CameraModel camera_;
  std::unique_ptr<gpis_mapping::DepthClassifier> classifier_;

  // Kept from update to update for their memory only; one per thread.
  std::vector<VoxelSet> hits_;
  std::vector<VoxelSet> ends_;
  std::vector<VoxelSet> misses_;
};

}  // namespace octomap_baseline

#endif  // OCTOMAP_BASELINE_DYNAMIC_OCTOMAP_H
