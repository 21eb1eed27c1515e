// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline_ros/octomap_messages.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <sstream>
#include <string>
#include <vector>

#include <interactive_mapping_common_ros/markers.h>

#include "gpis_mapping_ros/map_messages.h"
#include "octomap_baseline/placed_nodes.h"

namespace octomap_baseline_ros {
namespace {

/// Why the data are not one whole tree; empty: they are. octomap believes what it reads: from data that end too soon it
/// reads nodes below nodes until the stack ends.
std::string problemOf(const octomap_msgs::Octomap& message) {
  constexpr unsigned kMaxDepth = 16;  // of OcTree
  const std::size_t node_bytes = message.binary ? 2 : sizeof(float) + 1;
  const std::size_t size = message.data.size();
  std::vector<unsigned> depths{0};  // of the nodes that are to come, the next one last
  std::size_t at = 0;
  for (; !depths.empty(); at += node_bytes) {
    const unsigned depth = depths.back();
    depths.pop_back();
    if (size - at < node_bytes)
      return "the octomap's data end within its nodes, after " + std::to_string(size) + " bytes";
    const std::int8_t* node = &message.data[at];
    unsigned children = 0;  // those that come as nodes
    bool is_leaf = true;
    if (message.binary) {
      for (unsigned child = 0; child < 8; ++child) {
        const int kind = (static_cast<std::uint8_t>(node[child / 4]) >> (2 * (child % 4))) & 3;  // 3: has children
        children += kind == 3 ? 1 : 0;
        is_leaf = is_leaf && kind == 0;
      }
    } else {
      float log_odds = 0.0F;
      std::memcpy(&log_odds, node, sizeof(float));
      if (!std::isfinite(log_odds)) return "the octomap has a node whose log odds are not finite";
      for (unsigned mask = static_cast<std::uint8_t>(node[sizeof(float)]); mask != 0; mask >>= 1) children += mask & 1;
      is_leaf = children == 0;
    }
    if (depth == kMaxDepth && !is_leaf) {
      return "the octomap has nodes below depth " + std::to_string(kMaxDepth) + ", where voxels must end";
    }
    depths.insert(depths.end(), children, depth + 1);
  }
  return at == size ? "" : "the octomap has " + std::to_string(size - at) + " bytes after its last node";
}

}  // namespace

std::unique_ptr<octomap::OcTree> toTree(const octomap_msgs::Octomap& message, std::string* why_not) {
  if (message.id != "OcTree") {
    *why_not = "the octomap's type is '" + message.id + "', must be OcTree";
    return nullptr;
  }
  if (!(message.resolution >= 1e-4 && message.resolution <= 10.0)) {
    *why_not = "the octomap's resolution is " + std::to_string(message.resolution) + " m, must be in [0.0001, 10] m";
    return nullptr;
  }
  auto tree = std::make_unique<octomap::OcTree>(message.resolution);
  if (message.data.empty()) return tree;
  const std::string problem = problemOf(message);
  if (!problem.empty()) {
    *why_not = problem;
    return nullptr;
  }
  std::istringstream stream(std::string(message.data.begin(), message.data.end()));
  if (message.binary) {
    tree->readBinaryData(stream);
  } else {
    tree->readData(stream);
  }
  return tree;
}

visualization_msgs::MarkerArray toMarkers(const octomap::OcTree& tree, bool occupied, const std_msgs::Header& header) {
  visualization_msgs::MarkerArray array;
  array.markers.resize(tree.getTreeDepth() + 1);
  for (unsigned depth = 0; depth < array.markers.size(); ++depth) {
    visualization_msgs::Marker& marker = array.markers[depth];
    marker.header = header;
    marker.ns = occupied ? "occupied" : "free";
    marker.id = static_cast<int>(depth);
    marker.type = visualization_msgs::Marker::CUBE_LIST;
    marker.pose.orientation.w = 1.0;
    marker.scale.x = marker.scale.y = marker.scale.z = tree.getNodeSize(depth);
    marker.color.g = 1.0f;
    marker.color.a = occupied ? 1.0f : 0.3f;
  }
  double lowest = 0.0;
  double highest = 0.0;
  bool is_first = true;
  for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) {
    if (tree.isNodeOccupied(*leaf) != occupied) continue;
    geometry_msgs::Point center;
    center.x = leaf.getX();
    center.y = leaf.getY();
    center.z = leaf.getZ();
    lowest = is_first ? center.z : std::min(lowest, center.z);
    highest = is_first ? center.z : std::max(highest, center.z);
    is_first = false;
    array.markers[leaf.getDepth()].points.push_back(center);
  }
  for (visualization_msgs::Marker& marker : array.markers) {
    // Emptied sizes must vanish from rviz, too.
    marker.action = marker.points.empty() ? visualization_msgs::Marker::DELETE : visualization_msgs::Marker::ADD;
    if (!occupied) continue;
    for (const geometry_msgs::Point& center : marker.points) {
      marker.colors.push_back(gpis_mapping_ros::colorOf((center.z - lowest) / std::max(1e-6, highest - lowest)));
    }
  }
  return array;
}

sensor_msgs::PointCloud2 toPointCloud(const octomap::OcTree& tree, const std_msgs::Header& header) {
  std::vector<Eigen::Vector3d> centers;
  const auto addCenter = [&](const octomap_baseline::PlacedNode& leaf) { centers.push_back(leaf.box(tree).center()); };
  const auto isOccupied = [&](const auto& placed) { return octomap_baseline::isOccupied(tree, placed); };
  octomap_baseline::forEachLeaf(tree, octomap_baseline::placedRoot(tree), isOccupied, addCenter);
  return gpis_mapping_ros::toPointCloud(centers, header);
}

interactive_mapping_msgs::MapUpdate toMapUpdate(const octomap_baseline::OctomapUpdateStatistics& statistics,
                                                const std_msgs::Header& header, std::uint64_t update, double wait_ms) {
  interactive_mapping_msgs::MapUpdate message;
  message.header = header;
  message.status = interactive_mapping_msgs::MapUpdate::ACCEPTED;
  message.update = update;
  message.view_min = interactive_mapping_ros::toPoint(statistics.view_box_map.min());
  message.view_max = interactive_mapping_ros::toPoint(statistics.view_box_map.max());
  message.points_in = static_cast<std::uint32_t>(statistics.points_in);
  message.inserted = static_cast<std::uint32_t>(statistics.inserted);
  message.fused = static_cast<std::uint32_t>(statistics.hit_voxels - statistics.inserted);
  message.deleted = static_cast<std::uint32_t>(statistics.freed);
  message.map_points = static_cast<std::uint32_t>(statistics.occupied);
  message.total_ms = static_cast<float>(statistics.total_ms);
  message.classify_ms = static_cast<float>(statistics.classify_ms);
  message.observe_ms = static_cast<float>(statistics.cast_ms);
  message.insert_ms = static_cast<float>(statistics.update_ms);
  message.wait_ms = static_cast<float>(wait_ms);
  return message;
}

}  // namespace octomap_baseline_ros
