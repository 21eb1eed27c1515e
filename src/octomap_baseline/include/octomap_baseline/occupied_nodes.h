// SPDX-License-Identifier: BSD-3-Clause
#ifndef OCTOMAP_BASELINE_OCCUPIED_NODES_H
#define OCTOMAP_BASELINE_OCCUPIED_NODES_H

#include <octomap/OcTree.h>

namespace octomap_baseline {

/// A node of an octree with its place.
struct PlacedNode {
  const octomap::OcTreeNode* node;
  unsigned depth;
  octomap::OcTreeKey first;  // of the voxel at its lowest corner

  unsigned width(const octomap::OcTree& tree) const { return 1U << (tree.getTreeDepth() - depth); }  // [voxels]
};

/// The whole tree; its node is null if nothing in it is occupied.
inline PlacedNode occupiedRoot(const octomap::OcTree& tree) {
  const octomap::OcTreeNode* root = tree.getRoot();
  return {root != nullptr && tree.isNodeOccupied(root) ? root : nullptr, 0, octomap::OcTreeKey(0, 0, 0)};
}

/// Calls `visit` with each child that is occupied or holds something occupied: an inner node is as occupied as its most
/// occupied child.
template <typename Visit>
void forEachOccupiedChild(const octomap::OcTree& tree, const PlacedNode& parent, const Visit& visit) {
  for (unsigned i = 0; i < 8; ++i) {
    if (!tree.nodeChildExists(parent.node, i)) continue;
    PlacedNode child{tree.getNodeChild(parent.node, i), parent.depth + 1, parent.first};
    if (!tree.isNodeOccupied(child.node)) continue;
    for (unsigned axis = 0; axis < 3; ++axis) {
      const unsigned step = (i >> axis & 1U) * child.width(tree);
      child.first[axis] = static_cast<octomap::key_type>(child.first[axis] + step);
    }
    visit(child);
  }
}

/// Calls `visit` with each occupied leaf below `from`, in the tree's order. Most of a tree is free, and not looked at.
template <typename Visit>
void forEachOccupiedLeaf(const octomap::OcTree& tree, const PlacedNode& from, const Visit& visit) {
  if (from.node == nullptr) return;
  if (!tree.nodeHasChildren(from.node)) {
    visit(from);
    return;
  }
  forEachOccupiedChild(tree, from, [&](const PlacedNode& child) { forEachOccupiedLeaf(tree, child, visit); });
}

}  // namespace octomap_baseline

#endif  // OCTOMAP_BASELINE_OCCUPIED_NODES_H
