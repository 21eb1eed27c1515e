// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_ROS_OCTOMAP_MESSAGES_H
#define GPIS_MAPPING_ROS_OCTOMAP_MESSAGES_H

#include <memory>

#include <octomap/OcTree.h>
#include <octomap_msgs/Octomap.h>
#include <std_msgs/Header.h>

#include "gpis_mapping/voxel_states.h"

namespace gpis_mapping_ros {

/// The voxels as OctoMap's tree, pruned: free and occupied at the tree's lower and upper clamp, unknown ones without a
/// node. Throws std::invalid_argument for a voxel that such a tree cannot hold, 32768 voxels or more from the origin.
std::unique_ptr<octomap::OcTree> toOctree(const gpis_mapping::VoxelStates& voxels);

/// As octomap_msgs::binaryMapToMsg: free and occupied only. An empty tree has no data.
octomap_msgs::Octomap toBinaryMessage(const octomap::OcTree& tree, const std_msgs::Header& header);

/// As octomap_msgs::fullMapToMsg: with log odds. An empty tree has no data.
octomap_msgs::Octomap toFullMessage(const octomap::OcTree& tree, const std_msgs::Header& header);

}  // namespace gpis_mapping_ros

#endif  // GPIS_MAPPING_ROS_OCTOMAP_MESSAGES_H
