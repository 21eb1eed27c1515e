// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline/tree_projection.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace octomap_baseline {

using gpis_mapping::SpaceState;

bool isSpeck(const octomap::OcTree& tree, const octomap::OcTreeKey& key) {
  octomap::OcTreeKey other;
  for (int dz = -1; dz <= 1; ++dz) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        if (dx == 0 && dy == 0 && dz == 0) continue;
        other[0] = static_cast<octomap::key_type>(key[0] + dx);
        other[1] = static_cast<octomap::key_type>(key[1] + dy);
        other[2] = static_cast<octomap::key_type>(key[2] + dz);
        const octomap::OcTreeNode* node = tree.search(other);
        if (node != nullptr && tree.isNodeOccupied(node)) return false;
      }
    }
  }
  return true;
}

gpis_mapping::GroundGrid projectDown(const octomap::OcTree& tree, double min_z_m, double max_z_m, bool without_specks) {
  struct Leaf {
    long x;
    long y;
    long across;
    SpaceState state;
  };
  const double resolution = tree.getResolution();
  std::vector<Leaf> leaves;
  long min_x = std::numeric_limits<long>::max();
  long min_y = min_x;
  long max_x = std::numeric_limits<long>::min();
  long max_y = max_x;
  for (auto it = tree.begin_leafs(); it != tree.end_leafs(); ++it) {
    const double half = 0.5 * it.getSize();
    // By the centres of its lowest and its highest voxel.
    if (it.getZ() - half + 0.5 * resolution > max_z_m || it.getZ() + half - 0.5 * resolution < min_z_m) continue;
    bool is_occupied = tree.isNodeOccupied(*it);
    if (is_occupied && without_specks && it.getDepth() == tree.getTreeDepth())
      is_occupied = !isSpeck(tree, it.getKey());
    Leaf leaf{std::lround((it.getX() - half) / resolution), std::lround((it.getY() - half) / resolution),
              std::lround(it.getSize() / resolution), is_occupied ? SpaceState::kOccupied : SpaceState::kFree};
    min_x = std::min(min_x, leaf.x);
    min_y = std::min(min_y, leaf.y);
    max_x = std::max(max_x, leaf.x + leaf.across);
    max_y = std::max(max_y, leaf.y + leaf.across);
    leaves.push_back(leaf);
  }
  gpis_mapping::GroundGrid grid;
  grid.cell_size_m = resolution;
  if (leaves.empty()) return grid;
  grid.origin_x_m = static_cast<double>(min_x) * resolution;
  grid.origin_y_m = static_cast<double>(min_y) * resolution;
  grid.width = static_cast<int>(max_x - min_x);
  grid.height = static_cast<int>(max_y - min_y);
  grid.state.assign(static_cast<std::size_t>(grid.width) * static_cast<std::size_t>(grid.height), SpaceState::kUnknown);
  for (const Leaf& leaf : leaves) {
    for (long y = leaf.y - min_y; y < leaf.y - min_y + leaf.across; ++y) {
      for (long x = leaf.x - min_x; x < leaf.x - min_x + leaf.across; ++x) {
        SpaceState& cell = grid.state[static_cast<std::size_t>(y) * static_cast<std::size_t>(grid.width) +
                                      static_cast<std::size_t>(x)];
        if (cell != SpaceState::kOccupied) cell = leaf.state;
      }
    }
  }
  return grid;
}

}  // namespace octomap_baseline
