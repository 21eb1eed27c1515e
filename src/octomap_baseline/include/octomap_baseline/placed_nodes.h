// SPDX-License-Identifier: BSD-3-Clause
#ifndef OCTOMAP_BASELINE_PLACED_NODES_H
#define OCTOMAP_BASELINE_PLACED_NODES_H

#include <Eigen/Geometry>
#include <octomap/OcTree.h>

namespace octomap_baseline {

constexpr int kKeyOrigin = 32768;  // key of the voxel that starts at coordinate 0

/// [m], map frame.
inline Eigen::Vector3d centerOf(const octomap::OcTree& tree, const octomap::OcTreeKey& key) {
  return {tree.keyToCoord(key[0]), tree.keyToCoord(key[1]), tree.keyToCoord(key[2])};
}

/// A node of an octree with its place.
struct PlacedNode {
  const octomap::OcTreeNode* node;
  unsigned depth;
  octomap::OcTreeKey first;  // of the voxel at its lowest corner

  unsigned width(const octomap::OcTree& tree) const { return 1U << (tree.getTreeDepth() - depth); }  // [voxels]
  /// [m], map frame.
  Eigen::AlignedBox3d box(const octomap::OcTree& tree) const {
    const Eigen::Vector3d low = centerOf(tree, first).array() - 0.5 * tree.getResolution();
    return {low, low.array() + width(tree) * tree.getResolution()};
  }
};

/// The whole tree; its node is null if the tree is empty.
inline PlacedNode placedRoot(const octomap::OcTree& tree) {
  return {tree.getRoot(), 0, octomap::OcTreeKey(0, 0, 0)};
}

template <typename Visit>
void forEachChild(const octomap::OcTree& tree, const PlacedNode& parent, const Visit& visit) {
  for (unsigned i = 0; i < 8; ++i) {
    if (!tree.nodeChildExists(parent.node, i)) continue;
    PlacedNode child{tree.getNodeChild(parent.node, i), parent.depth + 1, parent.first};
    for (unsigned axis = 0; axis < 3; ++axis) {
      const unsigned step = (i >> axis & 1U) * child.width(tree);
      child.first[axis] = static_cast<octomap::key_type>(child.first[axis] + step);
    }
    visit(child);
  }
}

/// Calls `visit` with each leaf from `from` on, in the tree's order, but for those below nodes that `enters` refuses.
template <typename Enters, typename Visit>
void forEachLeaf(const octomap::OcTree& tree, const PlacedNode& from, const Enters& enters, const Visit& visit) {
  if (from.node == nullptr || !enters(from)) return;
  if (!tree.nodeHasChildren(from.node)) {
    visit(from);
    return;
  }
  forEachChild(tree, from, [&](const PlacedNode& child) { forEachLeaf(tree, child, enters, visit); });
}

/// Whether it is, or holds, something occupied: an inner node is as occupied as its most occupied child.
inline bool isOccupied(const octomap::OcTree& tree, const PlacedNode& placed) {
  return tree.isNodeOccupied(placed.node);
}

}  // namespace octomap_baseline

#endif  // OCTOMAP_BASELINE_PLACED_NODES_H
