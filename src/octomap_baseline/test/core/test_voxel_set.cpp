// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline/voxel_set.h"

#include <random>
#include <set>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>

namespace octomap_baseline {
namespace {

using octomap::OcTreeKey;
using KeyTuple = std::tuple<int, int, int>;

KeyTuple asTuple(const OcTreeKey& key) {
  return {key[0], key[1], key[2]};
}

std::vector<OcTreeKey> keysOf(const VoxelSet& voxels) {
  std::vector<OcTreeKey> keys;
  for (const VoxelSet::Block& block : voxels.sortedBlocks()) {
    for (unsigned bit = 0; bit < 64; ++bit) {
      if ((block.bits >> bit & 1) != 0) keys.push_back(VoxelSet::keyOf(block.id, bit));
    }
  }
  return keys;
}

/// Runs of neighbouring voxels, as rays make them, at random places; the first ones at the lattice's corners.
std::vector<OcTreeKey> randomKeys(unsigned seed, int count) {
  std::mt19937 random(seed);
  std::vector<OcTreeKey> keys{{0, 0, 0}, {65535, 65535, 65535}, {65535, 0, 1}, {3, 4, 32767}, {32768, 32767, 32768}};
  OcTreeKey key(32768, 32768, 32768);
  for (int i = 0; i < count; ++i) {
    if (random() % 10 == 0) {
      for (unsigned axis = 0; axis < 3; ++axis) key[axis] = static_cast<octomap::key_type>(32600 + random() % 300);
    }
    key[random() % 3]++;
    keys.push_back(key);
  }
  return keys;
}

TEST(VoxelSet, HoldsWhatASetHolds) {
  VoxelSet voxels;
  std::set<KeyTuple> oracle;
  for (const OcTreeKey& key : randomKeys(1, 50000)) {  // more blocks than the table begins with
    voxels.insert(key);
    oracle.insert(asTuple(key));
  }
  ASSERT_GT(voxels.sortedBlocks().size(), 2000u);
  EXPECT_EQ(voxels.count(), oracle.size());
  std::set<KeyTuple> found;
  for (const OcTreeKey& key : keysOf(voxels)) {
    EXPECT_TRUE(found.insert(asTuple(key)).second) << "twice";
    EXPECT_TRUE(voxels.contains(key));
  }
  EXPECT_EQ(found, oracle);
  for (const OcTreeKey& key : randomKeys(2, 5000)) EXPECT_EQ(voxels.contains(key), oracle.count(asTuple(key)) == 1);
}

TEST(VoxelSet, MergeIsTheUnion) {
  VoxelSet a;
  VoxelSet b;
  std::set<KeyTuple> oracle;
  for (const OcTreeKey& key : randomKeys(3, 20000)) {
    a.insert(key);
    oracle.insert(asTuple(key));
  }
  for (const OcTreeKey& key : randomKeys(4, 20000)) {
    b.insert(key);
    oracle.insert(asTuple(key));
  }
  a.merge(b);
  EXPECT_EQ(a.count(), oracle.size());
  for (const OcTreeKey& key : keysOf(a)) EXPECT_EQ(oracle.count(asTuple(key)), 1u);
}

TEST(VoxelSet, CanBeFilledAgainAfterClear) {
  VoxelSet voxels;
  const OcTreeKey key(5, 6, 7);
  voxels.insert(key);
  voxels.clear();
  EXPECT_EQ(voxels.count(), 0u);
  EXPECT_FALSE(voxels.contains(key));
  voxels.insert(key);  // the block that was last used before
  EXPECT_TRUE(voxels.contains(key));
  EXPECT_EQ(voxels.count(), 1u);
}

TEST(VoxelSet, BlocksComeInTheOctreesOrder) {
  VoxelSet voxels;
  for (const OcTreeKey& key : randomKeys(6, 20000)) voxels.insert(key);
  // The octree's order: the highest bit in which two keys differ decides, z before y before x.
  const auto isBefore = [](const OcTreeKey& a, const OcTreeKey& b) {
    for (int bit = 15; bit >= 2; --bit) {
      for (const unsigned axis : {2u, 1u, 0u}) {
        const int difference = (a[axis] >> bit & 1) - (b[axis] >> bit & 1);
        if (difference != 0) return difference < 0;
      }
    }
    return false;
  };
  const std::vector<VoxelSet::Block> blocks = voxels.sortedBlocks();
  for (std::size_t i = 1; i < blocks.size(); ++i) {
    ASSERT_TRUE(isBefore(VoxelSet::keyOf(blocks[i - 1].id, 0), VoxelSet::keyOf(blocks[i].id, 0))) << i;
  }
}

TEST(VoxelSet, BitOrderIsThatOfTheOctreesChildren) {
  for (unsigned bit = 0; bit < 64; ++bit) {
    const OcTreeKey key = VoxelSet::keyOf(VoxelSet::blockId(OcTreeKey(40000, 32768, 4)), bit);
    EXPECT_EQ(VoxelSet::voxelBit(key), bit);
    // octomap::computeChildIdx: child of the node two levels up, then of the one above the leaf.
    EXPECT_EQ(octomap::computeChildIdx(key, 1), bit / 8);
    EXPECT_EQ(octomap::computeChildIdx(key, 0), bit % 8);
  }
}

}  // namespace
}  // namespace octomap_baseline
