// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/octomap_messages.h"

#include <sstream>
#include <stdexcept>
#include <string>

#include <interactive_mapping_common/formatted.h>

namespace gpis_mapping_ros {
namespace {

constexpr int kHalfWidth = 1 << 15;  // voxels of an OcTree on each side of the origin

octomap::OcTreeKey toOctreeKey(const gpis_mapping::LatticeKey& voxel, double size_m) {
  const int index[3] = {voxel.x, voxel.y, voxel.z};
  octomap::OcTreeKey key;
  for (unsigned axis = 0; axis < 3; ++axis) {
    if (index[axis] < -kHalfWidth || index[axis] >= kHalfWidth) {
      throw std::invalid_argument(interactive_mapping::formatted(
          "the map has a voxel at %g m, an octree of %g m ends at %g m: choose larger voxels", index[axis] * size_m,
          size_m, kHalfWidth * size_m));
    }
    key[axis] = static_cast<octomap::key_type>(index[axis] + kHalfWidth);
  }
  return key;
}

octomap_msgs::Octomap toMessage(const octomap::OcTree& tree, const std_msgs::Header& header, bool binary) {
  octomap_msgs::Octomap message;
  message.header = header;
  message.binary = binary;
  message.id = tree.getTreeType();
  message.resolution = tree.getResolution();
  if (tree.size() == 0) return message;
  std::ostringstream stream;
  if (binary) {
    tree.writeBinaryData(stream);
  } else {
    tree.writeData(stream);
  }
  const std::string data = stream.str();
  message.data.assign(data.begin(), data.end());
  return message;
}

}  // namespace

std::unique_ptr<octomap::OcTree> toOctree(const gpis_mapping::VoxelStates& voxels) {
  auto tree = std::make_unique<octomap::OcTree>(voxels.size_m);
  constexpr bool kLazy = true;  // inner nodes at the end, once
  for (const gpis_mapping::LatticeKey& voxel : voxels.free) {
    tree->setNodeValue(toOctreeKey(voxel, voxels.size_m), tree->getClampingThresMinLog(), kLazy);
  }
  for (const gpis_mapping::LatticeKey& voxel : voxels.occupied) {
    tree->setNodeValue(toOctreeKey(voxel, voxels.size_m), tree->getClampingThresMaxLog(), kLazy);
  }
  tree->updateInnerOccupancy();
  tree->prune();
  return tree;
}

octomap_msgs::Octomap toBinaryMessage(const octomap::OcTree& tree, const std_msgs::Header& header) {
  return toMessage(tree, header, true);
}

octomap_msgs::Octomap toFullMessage(const octomap::OcTree& tree, const std_msgs::Header& header) {
  return toMessage(tree, header, false);
}

}  // namespace gpis_mapping_ros
