// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_OBSERVED_LAYER_H
#define GPIS_MAPPING_OBSERVED_LAYER_H

#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "gpis_mapping/depth_classifier.h"
#include "gpis_mapping/types.h"

namespace gpis_mapping {

/// Coarse record of where space was seen free, and when. A copy made by share() shares its blocks until one side writes,
/// so that a snapshot costs what has changed and not what there is.
class ObservedLayer {
 public:
  static constexpr int kChunkBlocks = 16;  // blocks along a chunk's side
  static constexpr float kNever = std::numeric_limits<float>::lowest();
  using Chunk = std::array<float, kChunkBlocks * kChunkBlocks * kChunkBlocks>;  // last seen free [s since epoch]
  using Chunks = std::vector<std::pair<LatticeKey, std::shared_ptr<const Chunk>>>;

  explicit ObservedLayer(double block_size_m) : block_size_m_(block_size_m) {}
  /// A plain copy takes the chunks that the other side may still write to along; share() avoids that.
  ObservedLayer(const ObservedLayer& other);
  ObservedLayer& operator=(const ObservedLayer& other);
  ObservedLayer(ObservedLayer&&) = default;
  ObservedLayer& operator=(ObservedLayer&&) = default;

  /// A read-only copy for a snapshot; from here on this layer copies a chunk before it writes to it.
  ObservedLayer share();

  /// Marks every block that the frame sees through. A ball of 0.6 block sizes about its centre is nearer than every
  /// measurement in its footprint. No patch of pixels there is without information. Single dropouts are ignored; gaps
  /// at a depth edge are clear up to its nearer side. Blocks beyond `max_range_m` are left alone.
  void observe(const ClassifiedFrame& frame, const CameraModel& camera, const Eigen::Isometry3d& T_map_camera,
               double max_range_m, float stamp_s, int num_threads);

  /// Forgets that the block of `p_map` was seen free: something stands there now.
  void occupy(const Eigen::Vector3d& p_map);

  /// The block of `p_map` is known to be free, without having been seen so.
  void setFree(const Eigen::Vector3d& p_map, float stamp_s);

  /// Forgets that blocks were seen free whose centre `isInside` [map frame].
  void forgetIf(const std::function<bool(const Eigen::Vector3d&)>& isInside);

  /// When the block of `p_map` was last seen free [s since the map's epoch], kNever if it was not.
  float lastFree(const Eigen::Vector3d& p_map) const;
  bool isFree(const Eigen::Vector3d& p_map) const { return lastFree(p_map) != kNever; }

  double blockSize() const { return block_size_m_; }
  /// In the order of their keys.
  Chunks chunks() const;
  std::size_t numChunks() const { return num_chunks_; }
  /// Null if none of its blocks was ever seen free.
  const Chunk* chunk(const LatticeKey& key) const;
  void setChunk(const LatticeKey& key, const Chunk& chunk) { writable(key) = chunk; }

 private:
  static int indexIn(int x, int y, int z) { return (z * kChunkBlocks + y) * kChunkBlocks + x; }
  /// Chunk of the block that holds `p_map`, and the block's index in it.
  LatticeKey locate(const Eigen::Vector3d& p_map, int* index) const;
  Chunk& writable(const LatticeKey& key);

  // 4 x 4 x 4 chunks.
  static constexpr int kPageShift = 2;
  using Page = std::array<std::shared_ptr<Chunk>, 1 << (3 * kPageShift)>;
  using Keys = std::unordered_set<LatticeKey, LatticeKeyHash>;
  static LatticeKey pageOf(const LatticeKey& chunk) {
    return {chunk.x >> kPageShift, chunk.y >> kPageShift, chunk.z >> kPageShift};
  }
  static std::size_t placeIn(const LatticeKey& chunk) {
    constexpr int kMask = (1 << kPageShift) - 1;
    return static_cast<std::size_t>(((chunk.x & kMask) << kPageShift | (chunk.y & kMask)) << kPageShift |
                                    (chunk.z & kMask));
  }

  double block_size_m_;
  std::unordered_map<LatticeKey, std::shared_ptr<Page>, LatticeKeyHash> pages_;
  std::size_t num_chunks_{0};
  // Made since the last share(). Asking a pointer's use count instead would race with a reader letting go.
  Keys private_pages_, private_chunks_;
};

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_OBSERVED_LAYER_H
