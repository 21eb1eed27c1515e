// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline/tree_projection.h"

#include <algorithm>
#include <array>
#include <limits>
#include <vector>

#include "octomap_baseline/placed_nodes.h"

namespace octomap_baseline {

using gpis_mapping::SpaceState;

bool isSpeck(const octomap::OcTree& tree, const octomap::OcTreeKey& key) {
  // Those that share a side first: of a surface they answer.
  static const std::vector<std::array<int, 3>> steps = [] {
    std::vector<std::array<int, 3>> all;
    for (int i = 0; i < 27; ++i) {
      if (i != 13) all.push_back({i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1});
    }
    const auto numAxes = [](const auto& step) {
      return std::count_if(step.begin(), step.end(), [](int k) { return k; });
    };
    std::stable_sort(all.begin(), all.end(), [&](const auto& a, const auto& b) { return numAxes(a) < numAxes(b); });
    return all;
  }();
  return std::none_of(steps.begin(), steps.end(), [&](const std::array<int, 3>& step) {
    octomap::OcTreeKey other;
    for (unsigned axis = 0; axis < 3; ++axis) other[axis] = static_cast<octomap::key_type>(key[axis] + step[axis]);
    const octomap::OcTreeNode* node = tree.search(other);
    return node != nullptr && tree.isNodeOccupied(node);
  });
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
  const auto lowest_m = [&](const PlacedNode& node) {
    return tree.keyToCoord(node.first[2]);
  };  // of the voxels' centres
  const auto isInRange = [&](const PlacedNode& node) {
    return lowest_m(node) <= max_z_m && lowest_m(node) + (node.width(tree) - 1) * resolution >= min_z_m;
  };
  forEachLeaf(tree, placedRoot(tree), isInRange, [&](const PlacedNode& node) {
    bool is_occupied = isOccupied(tree, node);
    if (is_occupied && without_specks && node.depth == tree.getTreeDepth()) is_occupied = !isSpeck(tree, node.first);
    const Leaf leaf{node.first[0], node.first[1], node.width(tree),
                    is_occupied ? SpaceState::kOccupied : SpaceState::kFree};
    min_x = std::min(min_x, leaf.x);
    min_y = std::min(min_y, leaf.y);
    max_x = std::max(max_x, leaf.x + leaf.across);
    max_y = std::max(max_y, leaf.y + leaf.across);
    leaves.push_back(leaf);
  });
  gpis_mapping::GroundGrid grid;
  grid.cell_size_m = resolution;
  if (leaves.empty()) return grid;
  grid.origin_x_m = static_cast<double>(min_x - kKeyOrigin) * resolution;
  grid.origin_y_m = static_cast<double>(min_y - kKeyOrigin) * resolution;
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
