// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/octomap_messages.h"

#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

#include "analytic_surfaces.h"
#include "gpis_mapping/gpis_map.h"

namespace gpis_mapping_ros {
namespace {

using gpis_mapping::LatticeKey;
using gpis_mapping::Points3d;
using gpis_mapping::SpaceState;
using gpis_mapping::VoxelStates;

std_msgs::Header header() {
  std_msgs::Header header;
  header.frame_id = "map";
  header.stamp = ros::Time(12.5);
  return header;
}

/// What octomap_msgs::binaryMsgToMap and fullMsgToMap do.
std::unique_ptr<octomap::OcTree> readBack(const octomap_msgs::Octomap& message) {
  auto tree = std::make_unique<octomap::OcTree>(message.resolution);
  std::stringstream stream(std::string(message.data.begin(), message.data.end()));
  message.binary ? tree->readBinaryData(stream) : tree->readData(stream);
  return tree;
}

SpaceState stateIn(const octomap::OcTree& tree, const Eigen::Vector3d& p_map) {
  const octomap::OcTreeNode* node = tree.search(p_map.x(), p_map.y(), p_map.z());
  if (node == nullptr) return SpaceState::kUnknown;
  return tree.isNodeOccupied(node) ? SpaceState::kOccupied : SpaceState::kFree;
}

TEST(OctreeOfMap, SaysWhatTheFieldsSignSaysAtTheSamePoints) {
  // A box on a floor, in space that was seen free.
  gpis_mapping::MapContents contents;
  const Eigen::Vector3d low(-0.22, -0.13, 0.0);
  const Eigen::Vector3d high(0.19, 0.24, 0.31);
  contents.points = gpis_mapping_test::sampleBox(low, high, 0.02, false, 0.002);
  gpis_mapping_test::sampleRectangle({-0.6, -0.6, 0.0}, {1.2, 0.0, 0.0}, {0.0, 1.2, 0.0}, 0.02, 0.002,
                                     &contents.points);
  for (double x = -0.575; x < 0.6; x += 0.05) {
    for (double y = -0.575; y < 0.6; y += 0.05) {
      for (double z = 0.075; z < 0.6; z += 0.05) {
        const Eigen::Vector3d p(x, y, z);
        if (gpis_mapping_test::boxDistance(low, high, p) > 0.05) contents.observed.setFree(p, 1.0f);
      }
    }
  }
  const gpis_mapping::GpisMap map(std::move(contents));
  const auto snapshot = map.snapshot();
  const VoxelStates voxels = gpis_mapping::classifyVoxels(*snapshot, 0.05, 1'000'000);
  const auto tree = toOctree(voxels);
  int num_inside = 0;
  int num_outside = 0;
  for (const octomap_msgs::Octomap& message : {toFullMessage(*tree, header()), toBinaryMessage(*tree, header())}) {
    EXPECT_EQ(message.id, "OcTree");
    EXPECT_EQ(message.resolution, 0.05);
    EXPECT_EQ(message.header.frame_id, "map");
    EXPECT_EQ(message.header.stamp, ros::Time(12.5));
    const auto read = readBack(message);
    for (int x = -14; x < 14; ++x) {
      for (int y = -14; y < 14; ++y) {
        for (int z = -4; z < 14; ++z) {
          const Eigen::Vector3d p = LatticeKey{x, y, z}.center(0.05);
          const auto answer = snapshot->query(Points3d(p));
          const SpaceState state = stateIn(*read, p);
          num_inside += answer.distance[0] < 0.0 ? 1 : 0;
          num_outside += answer.state[0] == SpaceState::kFree ? 1 : 0;
          // Only a surface that passes through the voxel makes it occupied although its centre is not.
          const bool is_crossed = answer.euclidean_distance[0] < 0.5 * std::sqrt(3.0) * 0.05;
          EXPECT_TRUE(state == answer.state[0] || (state == SpaceState::kOccupied && is_crossed))
              << p.transpose() << ": " << answer.distance[0] << " m";
          EXPECT_FALSE(answer.distance[0] < 0.0 && state != SpaceState::kOccupied) << p.transpose();
        }
      }
    }
  }
  EXPECT_GT(num_inside, 1000);
  EXPECT_GT(num_outside, 1000);
  EXPECT_LT(tree->getNumLeafNodes(), voxels.free.size() + voxels.occupied.size()) << "pruned";
}

TEST(OctreeOfMap, IsEmptyForAMapOfNothing) {
  const auto snapshot = gpis_mapping::GpisMap(gpis_mapping::GpisConfig()).snapshot();
  const auto tree = toOctree(gpis_mapping::classifyVoxels(*snapshot, 0.05, 1));
  EXPECT_TRUE(toFullMessage(*tree, header()).data.empty());
  EXPECT_TRUE(toBinaryMessage(*tree, header()).data.empty());
}

TEST(OctreeOfMap, HoldsVoxelsUpToItsEndsAndRefusesThoseBeyond) {
  VoxelStates voxels;
  voxels.size_m = 0.5;
  voxels.occupied = {{-32768, 0, 32767}};
  const auto tree = toOctree(voxels);
  EXPECT_EQ(stateIn(*tree, {-16383.75, 0.25, 16383.75}), SpaceState::kOccupied);
  voxels.free = {{0, 32768, 0}};
  EXPECT_EQ(test_support::messageOf<std::invalid_argument>([&] { toOctree(voxels); }),
            "the map has a voxel at 16384 m, an octree of 0.5 m ends at 16384 m: choose larger voxels");
}

}  // namespace
}  // namespace gpis_mapping_ros
