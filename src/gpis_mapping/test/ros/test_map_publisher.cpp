// SPDX-License-Identifier: BSD-3-Clause
// What is made for whom: outputs without a subscriber cost nothing, one that fails leaves the others alone.
#include "gpis_mapping_ros/map_publisher.h"

#include <array>
#include <cmath>
#include <set>
#include <string>

#include <gmock/gmock.h>
#include <interactive_mapping_common_ros/testing/waiting.h>
#include <interactive_mapping_msgs/SurfaceMesh.h>
#include <nav_msgs/OccupancyGrid.h>
#include <ros/ros.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <visualization_msgs/Marker.h>
#include <visualization_msgs/MarkerArray.h>

#include "analytic_surfaces.h"
#include "gpis_mapping/gpis_map.h"
#include "gpis_mapping/voxel_states.h"

namespace gpis_mapping_ros {
namespace {

using node_tests::Latest;
using node_tests::waitUntil;
using sensor_msgs::PointCloud2;
using testing::HasSubstr;

/// A level floor, 1 m a side.
MapState floorState(std::uint64_t revision) {
  gpis_mapping::MapContents contents;
  gpis_mapping_test::sampleRectangle({-0.5, -0.5, 0.0}, {1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, 0.02, 0.002,
                                     &contents.points);
  MapState state;
  state.snapshot = gpis_mapping::GpisMap(std::move(contents)).snapshot();
  state.stamp = ros::Time(100.0 + static_cast<double>(revision));
  state.generation = 1;
  state.revision = revision;
  return state;
}

/// Each state is published before setState() returns.
GpisMappingParams everyState() {
  GpisMappingParams params;
  params.output.every_image = true;
  return params;
}

TEST(MapPublisher, MakesNothingWithoutASubscriber) {
  GpisMappingParams params = everyState();
  params.octomap.resolution_m = 0.005;  // would fail: more voxels than are allowed
  MapPublisher publisher(ros::NodeHandle("nobody"), params);
  const MapState state = floorState(1);
  for (int i = 0; i < 3; ++i) publisher.setState(state, {});
  EXPECT_TRUE(publisher.numMade().empty());
  EXPECT_EQ(publisher.lastError(), "");
}

TEST(MapPublisher, MakesOnlyWhatIsSubscribedTo) {
  MapPublisher publisher(ros::NodeHandle("few"), everyState());
  Latest<octomap_msgs::Octomap> full("few/octomap_full");
  Latest<PointCloud2> esdf("few/esdf_slice");
  publisher.setState(floorState(1), {});
  EXPECT_EQ(full.awaitStamp(ros::Time(101.0)).header.frame_id, "map");
  EXPECT_GT(full.awaitStamp(ros::Time(101.0)).data.size(), 100u);
  EXPECT_GT(esdf.awaitStamp(ros::Time(101.0)).width, 100u);
  std::string topics;
  for (const auto& [topic, count] : publisher.numMade()) topics += topic + " ";
  EXPECT_EQ(topics, "esdf_slice octomap_full ");
}

TEST(MapPublisher, GivesALateSubscriberThePresentState) {
  MapPublisher publisher(ros::NodeHandle("late"), everyState());
  publisher.setState(floorState(5), {});
  Latest<PointCloud2> surface("late/surface_cloud");
  Latest<octomap_msgs::Octomap> binary("late/octomap_binary");
  EXPECT_GT(surface.awaitStamp(ros::Time(105.0)).width, 1000u);
  const octomap_msgs::Octomap message = binary.awaitStamp(ros::Time(105.0));
  EXPECT_TRUE(message.binary);
  EXPECT_EQ(message.data, publisher.getOctomap(true).data) << "the service answers the same";
  EXPECT_NE(message.data, publisher.getOctomap(false).data);
  Latest<octomap_msgs::OctomapWithPose> placed("late/octomap_with_pose");
  octomap_msgs::OctomapWithPose with_pose = placed.awaitStamp(ros::Time(105.0));
  with_pose.octomap.header.seq = message.header.seq;  // roscpp counts the outer header's messages
  EXPECT_EQ(with_pose.octomap, message);
  EXPECT_EQ(with_pose.origin.orientation.w, 1.0);
}

TEST(MapPublisher, TheMeshWaitsForItsPeriodUnlessSomethingWasTakenOutSinceTheImage) {
  GpisMappingParams params = everyState();
  params.output.mesh_period_s = 10.0;
  MapPublisher publisher(ros::NodeHandle("slow"), params);
  Latest<interactive_mapping_msgs::SurfaceMesh> mesh("slow/mesh");
  MapState state = floorState(1);
  publisher.setState(state, {});
  mesh.awaitStamp(state.stamp);
  publisher.setState(state, {});  // returns when the subscriber's coming has been answered, too
  const std::uint64_t made = publisher.numMade().at("mesh");
  state = floorState(2);  // of an image a second later
  publisher.setState(state, {});
  EXPECT_EQ(publisher.numMade().at("mesh"), made);
  ++state.revision;
  publisher.setState(state, {});
  EXPECT_EQ(publisher.numMade().at("mesh"), made + 1);
}

TEST(MapPublisher, AnOutputThatCannotBeMadeIsNamedAndLeavesTheOthers) {
  GpisMappingParams params = everyState();
  params.octomap.resolution_m = 0.005;
  MapPublisher publisher(ros::NodeHandle("fails"), params);
  Latest<octomap_msgs::Octomap> full("fails/octomap_full");
  Latest<PointCloud2> esdf("fails/esdf_slice");  // made before the octree
  Latest<octomap_msgs::Octomap> binary("fails/octomap_binary");
  publisher.setState(floorState(1), {});
  EXPECT_GT(esdf.awaitStamp(ros::Time(101.0)).width, 100u);
  ASSERT_TRUE(waitUntil([&] { return publisher.numMade().size() == 3; }));
  publisher.setState(floorState(2), {});
  EXPECT_THAT(publisher.lastError(), HasSubstr("~octomap_binary: voxels of 0.005 m would be about"));
  EXPECT_THAT(publisher.lastError(), HasSubstr("must be at most 4000000"));
  EXPECT_GT(esdf.awaitStamp(ros::Time(102.0)).width, 100u);
  EXPECT_FALSE(full.hasCome());
  EXPECT_THROW(publisher.getOctomap(false), std::invalid_argument);
}

TEST(MapPublisher, DistanceCloudHasTheMapsDistances) {
  MapPublisher publisher(ros::NodeHandle("cloud"), everyState());
  Latest<PointCloud2> latest("cloud/esdf_pointcloud");
  const MapState state = floorState(1);
  publisher.setState(state, {});
  const PointCloud2 cloud = latest.awaitStamp(ros::Time(101.0));
  EXPECT_EQ(cloud.header.frame_id, "map");
  ASSERT_EQ(cloud.fields.size(), 4u);
  EXPECT_EQ(cloud.fields[3].name, "intensity");
  ASSERT_EQ(cloud.data.size(), cloud.width * cloud.point_step);

  constexpr double kVoxel_m = 0.05;  // octomap/resolution_m
  std::size_t num_known = 0;
  const gpis_mapping::VoxelStates voxels = gpis_mapping::classifyVoxels(*state.snapshot, kVoxel_m, 1'000'000);
  for (const auto* keys : {&voxels.occupied, &voxels.free}) {
    for (const gpis_mapping::LatticeKey& key : *keys) {
      num_known += std::isfinite(state.snapshot->query(key.center(kVoxel_m)).distance[0]) ? 1 : 0;
    }
  }
  EXPECT_GT(num_known, 1000u);
  EXPECT_EQ(cloud.width, num_known);
  std::size_t num_inside = 0;
  std::set<std::array<float, 3>> places;
  sensor_msgs::PointCloud2ConstIterator<float> x(cloud, "x"), intensity(cloud, "intensity");
  for (; x != x.end(); ++x, ++intensity) {
    places.insert({x[0], x[1], x[2]});
    const Eigen::Vector3d p(x[0], x[1], x[2]);
    for (int axis = 0; axis < 3; ++axis) {
      const double in_voxel = p[axis] / kVoxel_m - std::floor(p[axis] / kVoxel_m);
      EXPECT_NEAR(in_voxel, 0.5, 1e-4) << "the centre, in floats";
    }
    // The floats' rounding moves the point by less than a micrometre.
    EXPECT_NEAR(*intensity, state.snapshot->query(p).distance[0], 1e-6);
    if (std::abs(p.x()) < 0.4 && std::abs(p.y()) < 0.4) {
      EXPECT_NEAR(*intensity, p.z(), 0.002) << "of the floor, sampled with 2 mm of noise";
    }
    EXPECT_GT(*intensity, -0.15f - 1e-6f) << "deeper nobody knows: query/occupied_depth_m";
    EXPECT_LT(*intensity, 0.075f + 1e-6f) << "higher nobody looked: 1.5 blocks of the observed layer";
    num_inside += *intensity < 0.0f ? 1 : 0;
  }
  EXPECT_EQ(places.size(), num_known) << "no voxel twice";
  EXPECT_GT(num_inside, 300u);
}

TEST(MapPublisher, TooManyDistancesAreRefused) {
  GpisMappingParams params = everyState();
  params.octomap.resolution_m = 0.005;
  MapPublisher publisher(ros::NodeHandle("too_many"), params);
  Latest<PointCloud2> latest("too_many/esdf_pointcloud");
  ASSERT_TRUE(waitUntil([&] {
    publisher.setState(floorState(1), {});
    return !publisher.lastError().empty();
  }));
  EXPECT_THAT(publisher.lastError(), HasSubstr("~esdf_pointcloud: voxels of 0.005 m would be about"));
  EXPECT_THAT(publisher.lastError(), HasSubstr("must be at most 4000000"));
  EXPECT_FALSE(latest.hasCome());
}

TEST(MapPublisher, MakesEveryOutputForItsSubscriber) {
  MapPublisher publisher(ros::NodeHandle("all"), everyState());
  Latest<interactive_mapping_msgs::SurfaceMesh> mesh("all/mesh");
  Latest<visualization_msgs::Marker> mesh_marker("all/mesh_marker");
  Latest<visualization_msgs::Marker> slice_marker("all/slice_marker");
  Latest<PointCloud2> surface("all/surface_cloud");
  Latest<PointCloud2> points("all/points");
  Latest<PointCloud2> removed("all/removed_points");
  Latest<PointCloud2> slice("all/slice");
  Latest<nav_msgs::OccupancyGrid> ground("all/ground");
  publisher.setState(floorState(1), {Eigen::Vector3d::UnitX()});
  EXPECT_EQ(surface.awaitStamp(ros::Time(101.0)).width, mesh.awaitStamp(ros::Time(101.0)).mesh.vertices.size());
  EXPECT_GT(mesh_marker.awaitStamp(ros::Time(101.0)).points.size(), 1000u);
  EXPECT_GT(slice_marker.awaitStamp(ros::Time(101.0)).points.size(), 100u);
  EXPECT_EQ(points.awaitStamp(ros::Time(101.0)).width, 2500u);
  EXPECT_EQ(removed.awaitStamp(ros::Time(101.0)).width, 1u);
  EXPECT_GT(slice.awaitStamp(ros::Time(101.0)).width, 100u);
  EXPECT_GT(ground.awaitStamp(ros::Time(101.0)).data.size(), 100u);
}

}  // namespace
}  // namespace gpis_mapping_ros
