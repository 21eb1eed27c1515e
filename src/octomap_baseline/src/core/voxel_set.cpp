// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline/voxel_set.h"

#include <algorithm>
#include <utility>

namespace octomap_baseline {
namespace {

constexpr std::size_t kFirstSize = 1024;  // slots

/// Puts two zero bits between the bits of a 16-bit number.
std::uint64_t spread(std::uint64_t x) {
  x &= 0xFFFF;
  x = (x | x << 16) & 0x00000000FF0000FFULL;
  x = (x | x << 8) & 0x000000F00F00F00FULL;
  x = (x | x << 4) & 0x00000C30C30C30C3ULL;
  x = (x | x << 2) & 0x0000249249249249ULL;
  return x;
}

unsigned popcount(std::uint64_t bits) {
  return static_cast<unsigned>(__builtin_popcountll(bits));
}

}  // namespace

VoxelSet::VoxelSet() : slots_(kFirstSize, Block{kEmpty, 0}) {}

octomap::OcTreeKey VoxelSet::keyOf(std::uint64_t id, unsigned bit) {
  const auto coordinate = [&](unsigned axis) {
    const unsigned low = (bit >> axis & 1) | (bit >> (axis + 3) & 1) << 1;
    return static_cast<octomap::key_type>((id >> (14 * axis) & 0x3FFF) << 2 | low);
  };
  return {coordinate(0), coordinate(1), coordinate(2)};
}

std::size_t VoxelSet::findOrAdd(std::uint64_t id) {
  const std::size_t mask = slots_.size() - 1;
  std::size_t slot = hash(id) & mask;
  while (slots_[slot].id != id) {
    if (slots_[slot].id == kEmpty) {
      if (2 * (num_blocks_ + 1) > slots_.size()) {
        grow();
        return findOrAdd(id);
      }
      slots_[slot].id = id;
      ++num_blocks_;
      break;
    }
    slot = (slot + 1) & mask;
  }
  return slot;
}

void VoxelSet::grow() {
  std::vector<Block> old(2 * slots_.size(), Block{kEmpty, 0});
  old.swap(slots_);
  num_blocks_ = 0;
  last_id_ = kEmpty;
  for (const Block& block : old) {
    if (block.id != kEmpty) slots_[findOrAdd(block.id)].bits = block.bits;
  }
}

void VoxelSet::merge(const VoxelSet& other) {
  for (const Block& block : other.slots_) {
    if (block.id != kEmpty) slots_[findOrAdd(block.id)].bits |= block.bits;
  }
}

void VoxelSet::clear() {
  std::fill(slots_.begin(), slots_.end(), Block{kEmpty, 0});
  num_blocks_ = 0;
  last_id_ = kEmpty;
}

std::uint64_t VoxelSet::bitsOf(std::uint64_t id) const {
  const std::size_t mask = slots_.size() - 1;
  for (std::size_t slot = hash(id) & mask; slots_[slot].id != kEmpty; slot = (slot + 1) & mask) {
    if (slots_[slot].id == id) return slots_[slot].bits;
  }
  return 0;
}

std::size_t VoxelSet::count() const {
  std::size_t sum = 0;
  for (const Block& block : slots_) sum += popcount(block.bits);
  return sum;
}

std::vector<VoxelSet::Block> VoxelSet::sortedBlocks() const {
  std::vector<std::pair<std::uint64_t, Block>> by_code;
  by_code.reserve(num_blocks_);
  for (const Block& block : slots_) {
    if (block.id == kEmpty) continue;
    const std::uint64_t code =
        spread(block.id & 0x3FFF) | spread(block.id >> 14 & 0x3FFF) << 1 | spread(block.id >> 28) << 2;
    by_code.emplace_back(code, block);
  }
  std::sort(by_code.begin(), by_code.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Block> blocks;
  blocks.reserve(by_code.size());
  for (const auto& entry : by_code) blocks.push_back(entry.second);
  return blocks;
}

}  // namespace octomap_baseline
