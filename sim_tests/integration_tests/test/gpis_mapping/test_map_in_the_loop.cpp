// SPDX-License-Identifier: BSD-3-Clause
// The map on the simulated camera, in lock step, judged by the world.
#include <set>

#include <gtest/gtest.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <interactive_mapping_msgs/SurfaceMesh.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>

#include "simulated_world/JudgeState.h"

namespace simulated_world_ros {
namespace {

using interactive_mapping_msgs::MapUpdate;

TEST(MapInTheLoop, EveryImageIsMappedAndTheBrickIsWhereItIs) {
  ros::NodeHandle nh;
  simulated_world::JudgeState judged;
  int images = 0;
  int updates = 0;
  ros::Time newest_image;
  bool clock_ran_ahead = false;
  std::string refused;
  const ros::Subscriber judge = nh.subscribe<simulated_world::JudgeState>(
      "/simulated_world/judge", 100, [&](const simulated_world::JudgeState::ConstPtr& state) { judged = *state; });
  std::set<ros::Time> meshes;
  const ros::Subscriber mesh = nh.subscribe<interactive_mapping_msgs::SurfaceMesh>(
      "/gpis_mapping/mesh", 100,
      [&](const interactive_mapping_msgs::SurfaceMesh::ConstPtr& message) { meshes.insert(message->header.stamp); });
  std::set<ros::Time> mapped;
  const ros::Subscriber image = nh.subscribe<sensor_msgs::Image>("/camera/aligned_depth_to_color/image_raw", 100,
                                                                 [&](const sensor_msgs::Image::ConstPtr& depth) {
                                                                   ++images;
                                                                   newest_image = depth->header.stamp;
                                                                 });
  const ros::Subscriber update =
      nh.subscribe<MapUpdate>("/gpis_mapping/update", 100, [&](const MapUpdate::ConstPtr& message) {
        ++updates;
        // The next image, 0.2 s later, must not be there before this one's answer; one may have overtaken it on its way
        // to here.
        clock_ran_ahead |= (newest_image - message->header.stamp).toSec() > 0.25;
        if (message->status == MapUpdate::ACCEPTED) {
          mapped.insert(message->header.stamp);
        } else {
          refused = message->message;
        }
      });
  // Twenty looks. The first may find no transform yet: tf is on its way while the clock stands.
  const ros::WallTime deadline = ros::WallTime::now() + ros::WallDuration(180.0);
  while (ros::ok() && ros::WallTime::now() < deadline && !(updates >= 20 && judged.coverage > 0.0)) {
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.01));
  }
  ASSERT_GE(updates, 20) << images << " images; last refusal: " << refused;
  EXPECT_FALSE(clock_ran_ahead);
  // What the judge sees depends on no clock but the simulated one: a mesh for each image that is output/mesh_period_s or
  // more after the last one's. The clock does not wait for their way to here.
  const double period_s = ros::param::param("/gpis_mapping/output/mesh_period_s", 0.0);
  ASSERT_GT(period_s, 0.5) << "of several images";
  std::set<ros::Time> due;
  for (const ros::Time& stamp : mapped) {
    if (due.empty() || (stamp - *due.rbegin()).toSec() >= period_s) due.insert(stamp);
  }
  while (ros::ok() && ros::WallTime::now() < deadline && meshes.count(*due.rbegin()) == 0) {
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.01));
  }
  meshes.erase(ros::Time());  // of the map without an image
  meshes.erase(meshes.upper_bound(*due.rbegin()), meshes.end());
  EXPECT_EQ(meshes, due);
  // From its start the robot sees the top and two of the four sides of the brick: 0.16 of 0.26 m^2 that are exposed.
  EXPECT_GT(judged.coverage, 0.4);
  EXPECT_LT(judged.coverage, 0.75);
  EXPECT_GT(judged.precision, 0.9);
  EXPECT_EQ(judged.collisions, 0);
}

}  // namespace
}  // namespace simulated_world_ros
