// SPDX-License-Identifier: BSD-3-Clause
// The node with a map that this test plays: what it publishes, ~detect, a brick in the hand, a map that does not answer.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <future>
#include <memory>
#include <string>
#include <utility>

#include <gtest/gtest.h>
#include <interactive_mapping_common_ros/markers.h>
#include <interactive_mapping_common_ros/testing/waiting.h>
#include <interactive_mapping_msgs/AttachedBrick.h>
#include <interactive_mapping_msgs/BrickArray.h>
#include <interactive_mapping_msgs/BrickDetectionUpdate.h>
#include <interactive_mapping_msgs/DetectBricks.h>
#include <interactive_mapping_msgs/GetMesh.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <interactive_mapping_msgs/QueryMap.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>
#include <visualization_msgs/MarkerArray.h>

#include "support/mapped_scene.h"
#include "surface_picking/bodies.h"

namespace surface_picking {
namespace {

using interactive_mapping_msgs::AttachedBrick;
using interactive_mapping_msgs::BrickArray;
using interactive_mapping_msgs::BrickDetectionUpdate;
using interactive_mapping_msgs::DetectBricks;
using interactive_mapping_msgs::GetMesh;
using interactive_mapping_msgs::MapUpdate;
using interactive_mapping_msgs::QueryMap;
using node_tests::Latest;
using node_tests::waitUntil;

test_support::MappedScene mapBricks(int count) {
  test_support::SceneOfSolids solids;
  for (int i = 0; i < count; ++i) solids.addBox({0.3, 0.2, 0.2}, test_support::pose(0.0, 0.5 * i - 0.25, 0.1, 0.3 + i));
  solids.lookAround(6);
  return test_support::mapScene(solids);
}

class SurfacePickingNode : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    two_ = new test_support::MappedScene(mapBricks(2));
    one_ = new test_support::MappedScene(mapBricks(1));
  }
  static void TearDownTestSuite() {
    delete two_;
    delete one_;
  }

  SurfacePickingNode() {
    update_publisher_ = nh_.advertise<MapUpdate>("/test_map/update", 5);
    attached_publisher_ = nh_.advertise<AttachedBrick>("/attached_brick", 5, true);
    serveMesh();
    query_server_ = nh_.advertiseService("/test_map/query", &SurfacePickingNode::onQuery, this);
    EXPECT_TRUE(waitUntil([this] {
      return update_publisher_.getNumSubscribers() > 0 && attached_publisher_.getNumSubscribers() > 0 &&
             bricks_.hasCome();
    }));
    std_srvs::Trigger clear;
    EXPECT_TRUE(node_tests::call("/surface_picking/clear", clear));
  }

  void serveMesh() { mesh_server_ = nh_.advertiseService("/test_map/get_mesh", &SurfacePickingNode::onMesh, this); }

  bool onMesh(GetMesh::Request& request, GetMesh::Response& response) {
    asked_ = request;
    response.mesh.header.frame_id = frame_;
    response.mesh.header.stamp = stamp_;
    for (const Eigen::Vector3d& p : scene_->mesh.vertices_map) {
      geometry_msgs::Point point;
      point.x = p.x();
      point.y = p.y();
      point.z = p.z();
      response.mesh.mesh.vertices.push_back(point);
    }
    for (const auto& triangle : scene_->mesh.triangles) {
      shape_msgs::MeshTriangle t;
      for (std::size_t i = 0; i < 3; ++i) t.vertex_indices[i] = triangle[i];
      response.mesh.mesh.triangles.push_back(t);
    }
    for (const Eigen::Vector3f& n : scene_->mesh.normals_map) {
      for (int i = 0; i < 3; ++i) response.mesh.normals.push_back(n[i]);
    }
    response.mesh.variance = scene_->mesh.variance_m2;
    if (is_broken_) response.mesh.normals.pop_back();
    return true;
  }

  bool onQuery(QueryMap::Request& request, QueryMap::Response& response) {
    gpis_mapping::Points3d points(3, static_cast<Eigen::Index>(request.points.size()));
    for (std::size_t i = 0; i < request.points.size(); ++i) {
      const geometry_msgs::Point& p = request.points[i];
      points.col(static_cast<Eigen::Index>(i)) << p.x, p.y, p.z;
    }
    gpis_mapping::QueryOptions options;
    options.variance = false;
    for (const auto state : scene_->snapshot->query(points, options).state) {
      response.state.push_back(static_cast<std::uint8_t>(state));
    }
    response.success = 1;
    return true;
  }

  MapUpdate nextUpdate() {
    stamp_ = ros::Time::now();
    MapUpdate update;
    update.header.stamp = stamp_;
    update.header.frame_id = "map";
    update.view_min = interactive_mapping_ros::toPoint(view_.min());
    update.view_max = interactive_mapping_ros::toPoint(view_.max());
    return update;
  }

  /// The bricks after an update of the map.
  BrickArray look() {
    const MapUpdate update = nextUpdate();
    update_publisher_.publish(update);
    const BrickDetectionUpdate& seen = updates_.awaitStamp(update.header.stamp);
    EXPECT_EQ(static_cast<int>(seen.status), BrickDetectionUpdate::ACCEPTED) << seen.message;
    return bricks_.awaitStamp(update.header.stamp);
  }

  void hold(int id, bool is_attached) {
    AttachedBrick message;
    message.header.stamp = ros::Time::now();
    message.header.frame_id = "magnet";
    message.is_attached = is_attached ? 1 : 0;
    message.id = id;
    attached_publisher_.publish(message);
  }

  static test_support::MappedScene* two_;
  static test_support::MappedScene* one_;

  ros::NodeHandle nh_;
  const test_support::MappedScene* scene_{two_};
  ros::Time stamp_;
  Eigen::AlignedBox3d view_{Eigen::Vector3d(0.0, 0.0, 0.0)};  // not known
  GetMesh::Request asked_;                                    // read after the answer to it
  std::string frame_{"map"};
  bool is_broken_{false};
  ros::Publisher update_publisher_, attached_publisher_;
  ros::ServiceServer mesh_server_, query_server_;
  Latest<BrickArray> bricks_{"/surface_picking/bricks"};
  Latest<BrickDetectionUpdate> updates_{"/surface_picking/update"};
};

test_support::MappedScene* SurfacePickingNode::two_ = nullptr;
test_support::MappedScene* SurfacePickingNode::one_ = nullptr;

TEST_F(SurfacePickingNode, ReportsBodiesWithPoseFacesAndStableIds) {
  Latest<visualization_msgs::MarkerArray> markers("/surface_picking/markers");
  Latest<visualization_msgs::MarkerArray> patches("/surface_picking/patches");
  const BrickArray first = look();
  ASSERT_EQ(first.bricks.size(), 2u);
  EXPECT_EQ(first.header.frame_id, "map");
  for (int i = 0; i < 2; ++i) {
    const auto& brick = first.bricks[static_cast<std::size_t>(i)];
    EXPECT_EQ(brick.type, "brick");
    EXPECT_DOUBLE_EQ(brick.size.x, 0.3);
    EXPECT_EQ(brick.has_duplicate, 0);
    EXPECT_EQ(brick.num_looks, 1u);
    EXPECT_EQ(brick.faces_seen.size(), 5u);
    ASSERT_FALSE(brick.graspable_faces.empty());
    EXPECT_GT(brick.graspable_faces[0].accessibility, 0.7) << "its top: free above, level";
    EXPECT_LT(brick.pose.covariance[0], 1e-4);
    const Eigen::Vector3d p(brick.pose.pose.position.x, brick.pose.pose.position.y, brick.pose.pose.position.z);
    double nearest = INFINITY;
    for (int k = 0; k < 2; ++k) {
      nearest = std::min(nearest, (two_->T_map_scene * Eigen::Vector3d(0.0, 0.5 * k - 0.25, 0.1) - p).norm());
    }
    EXPECT_LT(nearest, 0.006);  // as test_cuboids has it
  }
  EXPECT_GE(first.bricks[0].id, 7) << "of a node that crashed";
  int next_id = 0;
  EXPECT_TRUE(ros::param::get("/surface_picking/next_body_id", next_id));
  EXPECT_EQ(next_id, first.bricks[1].id + 1);
  const BrickArray second = look();
  ASSERT_EQ(second.bricks.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(second.bricks[i].id, first.bricks[i].id);
    EXPECT_EQ(second.bricks[i].num_looks, 2u);
    EXPECT_EQ(second.bricks[i].first_seen, first.bricks[i].first_seen);
  }
  markers.await([](const visualization_msgs::MarkerArray& array) { return array.markers.size() > 6; });
  EXPECT_TRUE(waitUntil([&] {  // made only while somebody subscribes
    look();
    return patches.hasCome();
  }));
  patches.await([](const visualization_msgs::MarkerArray& array) { return array.markers.size() > 10; });
}

TEST_F(SurfacePickingNode, DetectWaitsForAnUpdateAfterTheCall) {
  look();
  std::atomic<bool> is_called{false};
  std::future<DetectBricks::Response> answer = std::async(std::launch::async, [&is_called] {
    DetectBricks service;
    service.request.timeout = ros::Duration(20.0);
    is_called = true;
    EXPECT_TRUE(node_tests::call("/surface_picking/detect", service));
    return service.response;
  });
  const auto isReady = [&answer] { return answer.wait_for(std::chrono::seconds(0)) == std::future_status::ready; };
  // The call may come after an update: another one then answers it.
  EXPECT_TRUE(waitUntil([&] {
    if (is_called && !isReady()) look();
    return isReady();
  }));
  const DetectBricks::Response response = answer.get();
  EXPECT_EQ(static_cast<int>(response.status), DetectBricks::Response::OK) << response.message;
  EXPECT_EQ(response.bricks.bricks.size(), 2u);
  EXPECT_EQ(response.update.bricks_seen.size(), 2u);
}

TEST_F(SurfacePickingNode, DetectWithoutAnUpdateSaysSo) {
  std::future<DetectBricks::Response> answer = std::async(std::launch::async, [] {
    DetectBricks service;
    service.request.timeout = ros::Duration(0.2);
    EXPECT_TRUE(node_tests::call("/surface_picking/detect", service));
    return service.response;
  });
  const DetectBricks::Response response = answer.get();
  EXPECT_EQ(static_cast<int>(response.status), DetectBricks::Response::NO_IMAGE);
  EXPECT_TRUE(node_tests::has(response.message, "no update of the map on /test_map/update")) << response.message;
}

TEST_F(SurfacePickingNode, WhatIsInTheHandIsNoBodyAndWhatIsGoneIsForgotten) {
  const BrickArray before = look();
  ASSERT_EQ(before.bricks.size(), 2u);
  const int id = before.bricks[1].id;
  hold(id, true);
  bricks_.await([](const BrickArray& array) { return array.bricks.size() == 1; });
  EXPECT_EQ(look().bricks.size(), 1u) << "the map still shows it";
  hold(id, false);
  // Let go where it was: the same body again. The message and the next update take different ways to the node.
  EXPECT_TRUE(waitUntil([&] { return look().bricks.size() == 2; }));
  EXPECT_EQ(look().bricks[1].id, id);
  scene_ = one_;  // its place is seen free at once: the whole scene is
  EXPECT_TRUE(waitUntil([&] { return look().bricks.size() == 1; }));
}

TEST_F(SurfacePickingNode, LooksForWhatIsInViewAndKeepsTheRest) {
  const double beside_m = Eigen::Vector3d(0.3, 0.2, 0.2).norm();
  const auto viewOf = [](double y) {
    const Eigen::Vector3d middle = two_->T_map_scene * Eigen::Vector3d(0.0, y, 0.1);
    return Eigen::AlignedBox3d(middle.array() - 0.22, middle.array() + 0.22);
  };
  const BrickArray both = look();
  ASSERT_EQ(both.bricks.size(), 2u);
  EXPECT_EQ(asked_.min.x, -5.0) << "the region of the parameters, if the view is not known";
  scene_ = one_;  // the brick at y = 0.25 is gone, but nobody looks there
  view_ = viewOf(-0.25);
  for (int i = 0; i < 2 + BodyConfig().max_missed; ++i) {
    const BrickArray seen = look();
    ASSERT_EQ(seen.bricks.size(), 2u) << i;
    EXPECT_EQ(updates_.awaitStamp(seen.header.stamp).bricks_seen.size(), 1u);
  }
  EXPECT_DOUBLE_EQ(asked_.min.y, view_.min().y() - beside_m) << "what is beside a brick counts";
  EXPECT_DOUBLE_EQ(asked_.max.y, view_.max().y() + beside_m);
  const Eigen::AlignedBox3d kept = std::exchange(view_, viewOf(0.25));
  is_broken_ = true;
  update_publisher_.publish(nextUpdate());  // an observation that fails
  updates_.awaitStamp(stamp_);
  is_broken_ = false;
  view_ = kept;
  EXPECT_EQ(look().bricks.size(), 1u) << "its view is looked at in the next one";
}

TEST_F(SurfacePickingNode, AMapThatGivesNonsenseIsReportedAndForgiven) {
  const auto failsWith = [this](const std::string& part) {
    const MapUpdate update = nextUpdate();
    update_publisher_.publish(update);
    const BrickDetectionUpdate& seen = updates_.awaitStamp(update.header.stamp);
    EXPECT_EQ(static_cast<int>(seen.status), BrickDetectionUpdate::FAILED);
    EXPECT_TRUE(node_tests::has(seen.message, part)) << seen.message;
  };
  is_broken_ = true;
  failsWith("numbers in normals");
  is_broken_ = false;
  frame_ = "odom";
  failsWith("frame 'odom', must be 'map'");
  frame_ = "map";
  mesh_server_.shutdown();
  failsWith("/test_map/get_mesh");
  serveMesh();
  MapUpdate refused = nextUpdate();
  refused.status = MapUpdate::NO_TRANSFORM;
  refused.message = "no camera pose";
  update_publisher_.publish(refused);
  const BrickDetectionUpdate& seen = updates_.awaitStamp(refused.header.stamp);
  EXPECT_TRUE(node_tests::has(seen.message, "no transform: no camera pose")) << seen.message;
  EXPECT_EQ(look().bricks.size(), 2u);
}

}  // namespace
}  // namespace surface_picking

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_surface_picking_node");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
