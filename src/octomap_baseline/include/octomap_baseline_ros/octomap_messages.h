// SPDX-License-Identifier: BSD-3-Clause
#ifndef OCTOMAP_BASELINE_ROS_OCTOMAP_MESSAGES_H
#define OCTOMAP_BASELINE_ROS_OCTOMAP_MESSAGES_H

#include <cstdint>

#include <memory>
#include <string>

#include <interactive_mapping_msgs/MapUpdate.h>
#include <octomap/OcTree.h>
#include <octomap_msgs/Octomap.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/Header.h>
#include <visualization_msgs/MarkerArray.h>

#include "gpis_mapping_ros/octomap_messages.h"
#include "octomap_baseline/dynamic_octomap.h"

namespace octomap_baseline_ros {

using gpis_mapping_ros::toBinaryMessage;
using gpis_mapping_ros::toFullMessage;

/// The tree of such a message, binary or full; one without data is empty. Nothing, and why, for another type of tree, an
/// impossible resolution, or data that are not one whole tree with finite log odds.
std::unique_ptr<octomap::OcTree> toTree(const octomap_msgs::Octomap& message, std::string* why_not);

/// One cube list per size of leaf; occupied ones coloured by height, free ones green.
visualization_msgs::MarkerArray toMarkers(const octomap::OcTree& tree, bool occupied, const std_msgs::Header& header);

/// Centres of the occupied leaves: x y z.
sensor_msgs::PointCloud2 toPointCloud(const octomap::OcTree& tree, const std_msgs::Header& header);

/// Voxels stand for points; casting rays is observe_ms, changing the octree insert_ms.
interactive_mapping_msgs::MapUpdate toMapUpdate(const octomap_baseline::OctomapUpdateStatistics& statistics,
                                                const std_msgs::Header& header, std::uint64_t update, double wait_ms);

}  // namespace octomap_baseline_ros

#endif  // OCTOMAP_BASELINE_ROS_OCTOMAP_MESSAGES_H
