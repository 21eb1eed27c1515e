// SPDX-License-Identifier: BSD-3-Clause
// The node on a rendered sequence: what it publishes and serves, read as any other program would read it.
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <memory>
#include <sstream>
#include <string>

#include <gtest/gtest.h>
#include <interactive_mapping_msgs/GetMesh.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <interactive_mapping_msgs/SaveMap.h>
#include <nav_msgs/OccupancyGrid.h>
#include <octomap/OcTree.h>
#include <octomap_msgs/BoundingBoxQuery.h>
#include <octomap_msgs/GetOctomap.h>
#include <octomap_msgs/Octomap.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_srvs/Empty.h>
#include <visualization_msgs/MarkerArray.h>

#include "synthetic_depth/scene_loader.h"
#include "synthetic_depth_ros/synthetic_depth_publisher.h"

namespace integration_tests {
namespace {

using interactive_mapping_msgs::GetMesh;
using interactive_mapping_msgs::MapUpdate;
using interactive_mapping_msgs::SaveMap;
using synthetic_depth::Scene;
using synthetic_depth_ros::PublisherParams;
using synthetic_depth_ros::SyntheticDepthPublisher;

/// Serves callbacks until the condition holds; false if it does not within 60 s.
bool waitUntil(const std::function<bool()>& condition) {
  const ros::WallTime deadline = ros::WallTime::now() + ros::WallDuration(60.0);
  while (ros::ok() && ros::WallTime::now() < deadline) {
    if (condition()) return true;
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.02));
  }
  return condition();
}

/// As octomap_msgs::msgToMap.
std::unique_ptr<octomap::OcTree> toTree(const octomap_msgs::Octomap& message) {
  auto tree = std::make_unique<octomap::OcTree>(message.resolution);
  std::stringstream stream;
  if (message.data.empty()) return tree;
  stream.write(reinterpret_cast<const char*>(message.data.data()), static_cast<std::streamsize>(message.data.size()));
  if (message.binary) {
    tree->readBinaryData(stream);
  } else {
    tree->readData(stream);
  }
  return tree;
}

/// Occupied voxels of 4 cm whose centres are more than 6 cm over the floor and within 4 cm of the box.
int countOnBox(octomap::OcTree* tree, const Scene& scene) {
  int count = 0;
  tree->expand();
  for (auto leaf = tree->begin_leafs(); leaf != tree->end_leafs(); ++leaf) {
    if (!tree->isNodeOccupied(*leaf)) continue;
    const Eigen::Vector3d p_scene =
        scene.T_map_scene.inverse() * Eigen::Vector3d(leaf.getX(), leaf.getY(), leaf.getZ());
    const synthetic_depth::Box& box = scene.boxes[0];
    const Eigen::Vector3d p = box.T_scene_box.inverse() * p_scene;
    count += p_scene.z() > 0.06 && ((p.cwiseAbs() - box.half_extents_m).array() < 0.04).all();
  }
  return count;
}

template <typename Message>
class Latest {
 public:
  explicit Latest(const std::string& topic)
      : subscriber_(ros::NodeHandle().subscribe<Message>(
            topic, 10, [this](const boost::shared_ptr<const Message>& m) { message = m; })) {}
  boost::shared_ptr<const Message> message;

 private:
  ros::Subscriber subscriber_;
};

octomap_msgs::Octomap getMap(const std::string& service) {
  octomap_msgs::GetOctomap call;
  EXPECT_TRUE(ros::service::call(service, call)) << service;
  return call.response.map;
}

// Long: each step builds on the map of the one before.
TEST(OctomapBaselineNode, MapsForgetsPublishesAndServes) {
  PublisherParams params;
  params.scene_file = ros::NodeHandle("~").param<std::string>("scene_file", "");
  params.publish_clock = true;  // stamps are those of the scene
  params.wait_for_subscriber = true;
  params.loop = false;
  const Scene scene = synthetic_depth::loadScene(params.scene_file);

  Latest<octomap_msgs::Octomap> full("octomap_full");
  Latest<visualization_msgs::MarkerArray> occupied("occupied_cells_vis_array");
  Latest<visualization_msgs::MarkerArray> free("free_cells_vis_array");
  Latest<sensor_msgs::PointCloud2> centers("octomap_point_cloud_centers");
  Latest<nav_msgs::OccupancyGrid> grid("projected_map");
  int most_before = 0;
  int last_on_box = -1;
  octomap_msgs::OctomapConstPtr binary;
  const ros::Time removal(scene.stampSeconds(scene.firstRemovalFrame()));
  const ros::Subscriber binary_subscriber = ros::NodeHandle().subscribe<octomap_msgs::Octomap>(
      "octomap_binary", 10, [&](const octomap_msgs::OctomapConstPtr& message) {
        binary = message;
        last_on_box = countOnBox(toTree(*message).get(), scene);
        if (message->header.stamp < removal) most_before = std::max(most_before, last_on_box);
      });
  int num_meshes = 0;
  const ros::Subscriber mesh_subscriber = ros::NodeHandle().subscribe<interactive_mapping_msgs::SurfaceMesh>(
      "octomap_baseline/mesh", 10, [&](const interactive_mapping_msgs::SurfaceMeshConstPtr&) { ++num_meshes; });
  ros::Time last_taken_in;
  MapUpdate last_accepted;
  const ros::Subscriber update_subscriber = ros::NodeHandle().subscribe<MapUpdate>(
      "octomap_baseline/update", 100, [&](const boost::shared_ptr<const MapUpdate>& message) {
        last_taken_in = message->header.stamp;
        if (message->status == MapUpdate::ACCEPTED) last_accepted = *message;
      });
  ASSERT_TRUE(
      waitUntil([&] { return binary_subscriber.getNumPublishers() > 0 && update_subscriber.getNumPublishers() > 0; }));

  const SyntheticDepthPublisher publisher{ros::NodeHandle(), params};
  const ros::Time last_stamp(scene.stampSeconds(scene.numFrames() - 1));
  ASSERT_TRUE(waitUntil([&] { return last_taken_in >= last_stamp; })) << "the last image came to nothing";
  EXPECT_EQ(last_accepted.header.stamp, last_stamp);
  EXPECT_EQ(last_accepted.header.frame_id, "map");
  EXPECT_GT(last_accepted.map_points, 500u);
  ASSERT_TRUE(waitUntil([&] { return binary && binary->header.stamp >= last_stamp; }));

  // Two faces and the top, 7 x 7 voxels each and seen aslant; afterwards nothing but the floor.
  EXPECT_GT(most_before, 60);
  EXPECT_EQ(last_on_box, 0);
  EXPECT_TRUE(binary->binary);
  EXPECT_EQ(binary->id, "OcTree");
  EXPECT_EQ(binary->resolution, 0.04);
  EXPECT_EQ(binary->header.frame_id, "map");

  ASSERT_TRUE(waitUntil([&] {
    return full.message && occupied.message && free.message && centers.message && grid.message &&
           full.message->header.stamp >= last_stamp && centers.message->header.stamp >= last_stamp;
  }));
  EXPECT_FALSE(full.message->binary);
  EXPECT_EQ(countOnBox(toTree(*full.message).get(), scene), 0);
  EXPECT_GT(centers.message->width, 100u);
  EXPECT_EQ(occupied.message->markers.size(), 17u);
  EXPECT_FALSE(free.message->markers.back().points.empty());
  EXPECT_GT(std::count(grid.message->data.begin(), grid.message->data.end(), 100), 100);

  EXPECT_EQ(num_meshes, 1);  // mesh_period_s is longer than the scene

  // The mesh, for who does not have it.
  GetMesh mesh;
  ASSERT_TRUE(ros::service::call("octomap_baseline/get_mesh", mesh));
  EXPECT_GT(mesh.response.mesh.mesh.triangles.size(), 600u);  // two a voxel of the floor at least
  EXPECT_EQ(mesh.response.mesh.header.stamp, last_stamp);
  GetMesh known;
  known.request.revision = mesh.response.revision;
  ASSERT_TRUE(ros::service::call("octomap_baseline/get_mesh", known));
  EXPECT_EQ(known.response.revision, mesh.response.revision);
  EXPECT_TRUE(known.response.mesh.mesh.vertices.empty());

  // The services answer with the same tree.
  EXPECT_EQ(getMap("octomap_binary").data, binary->data);
  EXPECT_EQ(getMap("octomap_full").data, full.message->data);

  // Saved, and read by OctoMap itself.
  std::string folder = testing::TempDir() + "octomap_baseline_XXXXXX";
  ASSERT_NE(::mkdtemp(&folder[0]), nullptr);
  for (const char* name : {"map.bt", "map.ot"}) {
    SaveMap save;
    save.request.path = folder + "/" + name;
    ASSERT_TRUE(ros::service::call("octomap_baseline/save", save));
    EXPECT_TRUE(save.response.success) << save.response.message;
    EXPECT_EQ(save.response.num_points, last_accepted.map_points);
    const std::unique_ptr<octomap::AbstractOcTree> read(std::string(name) == "map.ot"
                                                            ? octomap::AbstractOcTree::read(save.request.path)
                                                            : new octomap::OcTree(save.request.path));
    ASSERT_NE(read, nullptr);
    EXPECT_EQ(read->size(), toTree(*full.message)->size());
  }
  SaveMap refused;
  refused.request.path = folder + "/map.ply";
  ASSERT_TRUE(ros::service::call("octomap_baseline/save", refused));
  EXPECT_FALSE(refused.response.success);
  EXPECT_NE(refused.response.message.find("must end in .bt"), std::string::npos) << refused.response.message;
  std::filesystem::remove_all(folder);

  // A box cleared: half a metre of floor.
  octomap_msgs::BoundingBoxQuery box;
  box.request.min.x = box.request.min.y = box.request.min.z = -0.25;
  box.request.max.x = box.request.max.y = box.request.max.z = 0.25;
  ASSERT_TRUE(ros::service::call("octomap_baseline/clear_bbx", box));
  const auto tree = toTree(getMap("octomap_full"));
  int inside = 0;
  int outside = 0;
  tree->expand();
  for (auto leaf = tree->begin_leafs(); leaf != tree->end_leafs(); ++leaf) {
    if (!tree->isNodeOccupied(*leaf)) continue;
    const bool is_inside = std::abs(leaf.getX()) < 0.25 && std::abs(leaf.getY()) < 0.25 && std::abs(leaf.getZ()) < 0.25;
    ++(is_inside ? inside : outside);
  }
  EXPECT_EQ(inside, 0);
  EXPECT_GT(outside, 300);
  box.request.max.x = -1.0;
  EXPECT_FALSE(ros::service::call("octomap_baseline/clear_bbx", box)) << "min above max";
  ASSERT_TRUE(ros::service::call("octomap_baseline/get_mesh", known));
  EXPECT_GT(known.response.revision, mesh.response.revision);
  EXPECT_LT(known.response.mesh.mesh.vertices.size(), mesh.response.mesh.mesh.vertices.size());

  // Everything cleared; who listens is told.
  std_srvs::Empty reset;
  ASSERT_TRUE(ros::service::call("octomap_baseline/reset", reset));
  EXPECT_TRUE(getMap("octomap_full").data.empty());
  EXPECT_TRUE(waitUntil([&] { return binary->data.empty(); }));
  EXPECT_TRUE(waitUntil([&] { return num_meshes == 2; })) << "an empty map does not wait for mesh_period_s";
}

}  // namespace
}  // namespace integration_tests
