// SPDX-License-Identifier: BSD-3-Clause
// Messages on the wire: the types are octomap_msgs' own, and their data reads back as the tree they were made from.
#include "octomap_baseline_ros/octomap_messages.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <memory>
#include <random>
#include <sstream>
#include <tuple>

#include <gtest/gtest.h>
#include <interactive_mapping_common/testing/shipped_file.h>
#include <octomap_msgs/BoundingBoxQuery.h>
#include <octomap_msgs/GetOctomap.h>
#include <octomap_msgs/OctomapWithPose.h>
#include <ros/message_traits.h>
#include <ros/service_traits.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include "octomap_baseline_ros/octomap_baseline_params.h"

namespace octomap_baseline_ros {
namespace {

using visualization_msgs::Marker;

TEST(OctomapBaselineParams, ShippedFileIsWhatTheFieldsSay) {
  test_support::expectShippedFile<OctomapBaselineParams>(OCTOMAP_CONFIG_DIR "/octomap_baseline_node.yaml");
}

/// What octomap_msgs::binaryMsgToMap and fullMsgToMap do.
std::unique_ptr<octomap::OcTree> readBack(const octomap_msgs::Octomap& message) {
  auto tree = std::make_unique<octomap::OcTree>(message.resolution);
  if (message.data.empty()) return tree;
  std::stringstream stream;
  stream.write(reinterpret_cast<const char*>(message.data.data()), static_cast<std::streamsize>(message.data.size()));
  if (message.binary) {
    tree->readBinaryData(stream);
  } else {
    tree->readData(stream);
  }
  return tree;
}

std::map<std::tuple<int, int, int>, float> contentsOf(const octomap::OcTree& tree) {
  octomap::OcTree copy(tree);
  copy.expand();
  std::map<std::tuple<int, int, int>, float> voxels;
  for (auto leaf = copy.begin_leafs(); leaf != copy.end_leafs(); ++leaf) {
    const octomap::OcTreeKey key = leaf.getKey();
    voxels[{key[0], key[1], key[2]}] = leaf->getLogOdds();
  }
  return voxels;
}

/// A floor of 16 x 16 x 2 occupied voxels, part of it pruned, under 4 layers of free ones.
octomap::OcTree exampleTree() {
  octomap::OcTree tree(0.05);
  for (int x = 0; x < 16; ++x) {
    for (int y = 0; y < 16; ++y) {
      for (int z = 0; z < 6; ++z) {
        const octomap::point3d p(0.05f * x + 0.025f, 0.05f * y - 0.375f, 0.05f * z + 0.025f);
        // Different odds along one edge: not everything can be pruned.
        tree.setNodeValue(p, z < 2 ? (x == 0 ? 0.5f : 3.0f) : -2.0f);
      }
    }
  }
  tree.prune();
  return tree;
}

std_msgs::Header exampleHeader() {
  std_msgs::Header header;
  header.stamp = ros::Time(12, 500);
  header.frame_id = "odom";
  return header;
}

TEST(OctomapMsgs, TypesAreThoseOfTheOriginalPackage) {
  // From octomap_msgs 0.3.5; a differing sum and no other node can talk to this one.
  EXPECT_STREQ(ros::message_traits::md5sum<octomap_msgs::Octomap>(), "9a45536b45c5e409cd49f04bb2d9999f");
  EXPECT_STREQ(ros::message_traits::md5sum<octomap_msgs::OctomapWithPose>(), "20b380aca6a508a657e95526cddaf618");
  EXPECT_STREQ(ros::service_traits::md5sum<octomap_msgs::GetOctomap>(), "be9d2869d24fe40d6bc21ac21f6bb2c5");
  EXPECT_STREQ(ros::service_traits::md5sum<octomap_msgs::BoundingBoxQuery>(), "93aa3d73b866f04880927745f4aab303");
  EXPECT_STREQ(ros::message_traits::datatype<octomap_msgs::Octomap>(), "octomap_msgs/Octomap");
}

TEST(OctomapMessages, FullMessageReadsBackWithItsLogOdds) {
  const octomap::OcTree tree = exampleTree();
  const octomap_msgs::Octomap message = toFullMessage(tree, exampleHeader());
  EXPECT_FALSE(message.binary);
  EXPECT_EQ(message.id, "OcTree");
  EXPECT_EQ(message.resolution, 0.05);
  EXPECT_EQ(message.header.frame_id, "odom");
  EXPECT_EQ(message.header.stamp, ros::Time(12, 500));
  EXPECT_EQ(contentsOf(*readBack(message)), contentsOf(tree));
}

TEST(OctomapMessages, BinaryMessageReadsBackAsFreeAndOccupied) {
  const octomap::OcTree tree = exampleTree();
  const octomap_msgs::Octomap message = toBinaryMessage(tree, exampleHeader());
  EXPECT_TRUE(message.binary);
  EXPECT_EQ(message.id, "OcTree");
  const auto expected = contentsOf(tree);
  const auto read = contentsOf(*readBack(message));
  ASSERT_EQ(read.size(), expected.size());
  for (const auto& [key, log_odds] : expected) EXPECT_EQ(read.at(key) >= 0.0f, log_odds >= 0.0f);
  EXPECT_LT(message.data.size(), toFullMessage(tree, exampleHeader()).data.size());
}

TEST(OctomapMessages, BothKindsBecomeTheTreeTheyWereMadeOf) {
  const octomap::OcTree tree = exampleTree();
  std::string why_not;
  const auto full = toTree(toFullMessage(tree, exampleHeader()), &why_not);
  ASSERT_NE(full, nullptr) << why_not;
  EXPECT_EQ(full->getResolution(), 0.05);
  EXPECT_EQ(full->size(), tree.size()) << "pruned as it was";
  EXPECT_EQ(contentsOf(*full), contentsOf(tree));
  const auto binary = toTree(toBinaryMessage(tree, exampleHeader()), &why_not);
  ASSERT_NE(binary, nullptr) << why_not;
  const auto read = contentsOf(*binary);
  const auto expected = contentsOf(tree);
  ASSERT_EQ(read.size(), expected.size());
  for (const auto& [key, log_odds] : expected) EXPECT_EQ(read.at(key) >= 0.0f, log_odds >= 0.0f);
  for (const bool is_binary : {false, true}) {
    octomap_msgs::Octomap empty = toFullMessage(octomap::OcTree(0.02), exampleHeader());
    empty.binary = is_binary;
    const auto none = toTree(empty, &why_not);
    ASSERT_NE(none, nullptr);
    EXPECT_EQ(none->size(), 0u);
    EXPECT_EQ(none->getResolution(), 0.02);
  }
  EXPECT_EQ(why_not, "");
}

TEST(OctomapMessages, WhatIsNoTreeIsRefusedWithTheReason) {
  const auto refusal = [](octomap_msgs::Octomap message) {
    std::string why_not;
    EXPECT_EQ(toTree(message, &why_not), nullptr);
    return why_not;
  };
  const octomap_msgs::Octomap good = toFullMessage(exampleTree(), exampleHeader());
  octomap_msgs::Octomap bad = good;
  bad.id = "ColorOcTree";
  EXPECT_EQ(refusal(bad), "the octomap's type is 'ColorOcTree', must be OcTree");
  for (const double resolution_m : {0.0, -0.1, 11.0, std::nan("")}) {
    bad = good;
    bad.resolution = resolution_m;
    EXPECT_NE(refusal(bad).find("resolution is "), std::string::npos) << resolution_m;
  }
  for (const bool is_binary : {false, true}) {
    const octomap_msgs::Octomap whole = is_binary ? toBinaryMessage(exampleTree(), exampleHeader()) : good;
    for (std::size_t size = 1; size < whole.data.size(); ++size) {
      bad = whole;
      bad.data.resize(size);
      EXPECT_EQ(refusal(bad), "the octomap's data end within its nodes, after " + std::to_string(size) + " bytes");
    }
    bad = whole;
    bad.data.push_back(0);
    EXPECT_EQ(refusal(bad), "the octomap has 1 bytes after its last node");
    // A chain of first children, one level deeper than voxels are.
    bad.data.clear();
    for (int depth = 0; depth < 18; ++depth) {
      const bool is_last = depth == 17;
      if (is_binary) {
        bad.data.insert(bad.data.end(), {static_cast<std::int8_t>(is_last ? 0 : 3), 0});
      } else {
        bad.data.insert(bad.data.end(), {0, 0, 0, 0, static_cast<std::int8_t>(is_last ? 0 : 1)});
      }
    }
    EXPECT_EQ(refusal(bad), "the octomap has nodes below depth 16, where voxels must end");
    // The same without the last level is as deep as can be.
    bad.data.erase(bad.data.begin(), bad.data.begin() + (is_binary ? 2 : 5));
    std::string why_not;
    const auto deep = toTree(bad, &why_not);
    ASSERT_NE(deep, nullptr) << why_not;
    EXPECT_EQ(deep->size(), 17u);
    // Octomap goes down as far as the data say: a megabyte of it would be the end of the stack.
    bad.data.assign(1000000, is_binary ? 3 : 1);
    EXPECT_EQ(refusal(bad), "the octomap has nodes below depth 16, where voxels must end");
  }
  bad = good;
  const float nan = std::nanf("");
  std::memcpy(bad.data.data(), &nan, sizeof(nan));
  EXPECT_EQ(refusal(bad), "the octomap has a node whose log odds are not finite");
}

TEST(OctomapMessages, SpoiltDataDoNoHarm) {
  std::mt19937 random(7);
  std::size_t num_read = 0;
  for (int round = 0; round < 2000; ++round) {
    octomap_msgs::Octomap message = round % 2 == 0 ? toFullMessage(exampleTree(), exampleHeader())
                                                   : toBinaryMessage(exampleTree(), exampleHeader());
    if (round % 4 < 2) {  // some bytes changed, or nothing but noise
      for (int i = 0; i < 3; ++i) message.data[random() % message.data.size()] = static_cast<std::int8_t>(random());
    } else {
      message.data.resize(random() % 200 + 1);
      for (std::int8_t& byte : message.data) byte = static_cast<std::int8_t>(random());
    }
    std::string why_not;
    const auto tree = toTree(message, &why_not);
    ASSERT_EQ(tree == nullptr, !why_not.empty());
    if (!tree) continue;
    ++num_read;
    EXPECT_GE(tree->getNumLeafNodes(), 1u);
  }
  EXPECT_GT(num_read, 0u) << "where a log odd alone was changed";
}

TEST(OctomapMessages, EmptyTreeHasNoData) {
  const octomap::OcTree tree(0.02);
  EXPECT_TRUE(toBinaryMessage(tree, exampleHeader()).data.empty());
  EXPECT_TRUE(toFullMessage(tree, exampleHeader()).data.empty());
  EXPECT_EQ(toPointCloud(tree, exampleHeader()).width, 0u);
  for (const Marker& marker : toMarkers(tree, true, exampleHeader()).markers) EXPECT_EQ(marker.action, Marker::DELETE);
}

TEST(OctomapMessages, MarkersAndPointsAreTheLeaves) {
  const octomap::OcTree tree = exampleTree();
  std::map<unsigned, std::size_t> leaves[2];
  for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) {
    ++leaves[tree.isNodeOccupied(*leaf) ? 1 : 0][leaf.getDepth()];
  }
  ASSERT_GT(leaves[1].size(), 1u);  // pruned and single ones
  for (const bool occupied : {false, true}) {
    const auto array = toMarkers(tree, occupied, exampleHeader());
    ASSERT_EQ(array.markers.size(), 17u);
    for (unsigned depth = 0; depth < 17; ++depth) {
      const Marker& marker = array.markers[depth];
      EXPECT_EQ(marker.points.size(), leaves[occupied ? 1 : 0][depth]);
      EXPECT_EQ(marker.action, marker.points.empty() ? Marker::DELETE : Marker::ADD);
      EXPECT_EQ(marker.colors.size(), occupied ? marker.points.size() : 0u);
      EXPECT_DOUBLE_EQ(marker.scale.x, 0.05 * std::pow(2.0, 16 - static_cast<int>(depth)));
      EXPECT_EQ(marker.header.frame_id, "odom");
      for (const geometry_msgs::Point& p : marker.points) {
        const octomap::OcTreeNode* node = tree.search(p.x, p.y, p.z, depth);
        ASSERT_NE(node, nullptr);
        EXPECT_EQ(tree.isNodeOccupied(node), occupied);
      }
    }
  }
  sensor_msgs::PointCloud2 cloud = toPointCloud(tree, exampleHeader());
  std::size_t expected = 0;
  for (const auto& entry : leaves[1]) expected += entry.second;
  ASSERT_EQ(cloud.width * cloud.height, expected);
  sensor_msgs::PointCloud2ConstIterator<float> x(cloud, "x");
  sensor_msgs::PointCloud2ConstIterator<float> y(cloud, "y");
  sensor_msgs::PointCloud2ConstIterator<float> z(cloud, "z");
  for (; x != x.end(); ++x, ++y, ++z) EXPECT_TRUE(tree.isNodeOccupied(tree.search(*x, *y, *z)));
}

TEST(OctomapMessages, UpdateTellsVoxelsAndTimes) {
  octomap_baseline::OctomapUpdateStatistics statistics;
  statistics.points_in = 11;
  statistics.hit_voxels = 7;
  statistics.inserted = 3;
  statistics.freed = 2;
  statistics.occupied = 99;
  statistics.total_ms = 6.0;
  statistics.classify_ms = 1.0;
  statistics.cast_ms = 2.0;
  statistics.update_ms = 3.0;
  statistics.view_box_map = {Eigen::Vector3d(1.0, 2.0, 3.0), Eigen::Vector3d(4.0, 5.0, 6.0)};
  const auto message = toMapUpdate(statistics, exampleHeader(), 5, 0.25);
  EXPECT_EQ(message.status, interactive_mapping_msgs::MapUpdate::ACCEPTED);
  EXPECT_EQ(message.update, 5u);
  EXPECT_EQ(message.points_in, 11u);
  EXPECT_EQ(message.inserted, 3u);
  EXPECT_EQ(message.fused, 4u);
  EXPECT_EQ(message.deleted, 2u);
  EXPECT_EQ(message.map_points, 99u);
  EXPECT_FLOAT_EQ(message.total_ms, message.classify_ms + message.observe_ms + message.insert_ms);
  EXPECT_FLOAT_EQ(message.wait_ms, 0.25f);
  EXPECT_EQ(message.view_min.y, 2.0);
  EXPECT_EQ(message.view_max.z, 6.0);
}

}  // namespace
}  // namespace octomap_baseline_ros
