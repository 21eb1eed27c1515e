// SPDX-License-Identifier: BSD-3-Clause
#ifndef OCTOMAP_BASELINE_VOXEL_SET_H
#define OCTOMAP_BASELINE_VOXEL_SET_H

#include <cstddef>
#include <cstdint>
#include <vector>

#include <octomap/OcTreeKey.h>

namespace octomap_baseline {

/// A set of octree voxels, kept as blocks of 4 x 4 x 4 with a bit each. A ray stays in a block for several voxels, so
/// inserting costs a fraction of octomap::KeySet's hash look-up per voxel.
class VoxelSet {
 public:
  struct Block {
    std::uint64_t id;    // blockId() of its voxels; the octree's node two levels above the leaves
    std::uint64_t bits;  // bit voxelBit(key) for each voxel of the set
  };

  VoxelSet();

  void insert(const octomap::OcTreeKey& key) {
    const std::uint64_t id = blockId(key);
    if (id != last_id_) {
      last_slot_ = findOrAdd(id);
      last_id_ = id;
    }
    slots_[last_slot_].bits |= std::uint64_t{1} << voxelBit(key);
  }
  bool contains(const octomap::OcTreeKey& key) const { return (bitsOf(blockId(key)) >> voxelBit(key) & 1) != 0; }
  void merge(const VoxelSet& other);
  void clear();

  /// Bits of a block; 0 if it is not there.
  std::uint64_t bitsOf(std::uint64_t id) const;
  std::size_t count() const;

  /// All blocks in the octree's order (Morton), so that neighbours are visited one after the other.
  std::vector<Block> sortedBlocks() const;

  /// The key without its two lowest bits.
  static std::uint64_t blockId(const octomap::OcTreeKey& key) {
    return static_cast<std::uint64_t>(key[0] >> 2) | static_cast<std::uint64_t>(key[1] >> 2) << 14 |
           static_cast<std::uint64_t>(key[2] >> 2) << 28;
  }
  /// Morton code of the two lowest bits: the eight voxels of one parent node are eight consecutive bits.
  static unsigned voxelBit(const octomap::OcTreeKey& key) {
    return spreadTwo(key[0]) | spreadTwo(key[1]) << 1 | spreadTwo(key[2]) << 2;
  }
  static octomap::OcTreeKey keyOf(std::uint64_t id, unsigned bit);

 private:
  static constexpr std::uint64_t kEmpty = ~std::uint64_t{0};

  static unsigned spreadTwo(unsigned x) { return (x & 1) | (x & 2) << 2; }
  static std::size_t hash(std::uint64_t id) { return static_cast<std::size_t>(id * 0x9E3779B97F4A7C15ULL >> 20); }
  std::size_t findOrAdd(std::uint64_t id);
  void grow();

  std::vector<Block> slots_;  // open addressing, size a power of two
  std::size_t num_blocks_{0};
  std::uint64_t last_id_{kEmpty};
  std::size_t last_slot_{0};
};

}  // namespace octomap_baseline

#endif  // OCTOMAP_BASELINE_VOXEL_SET_H
