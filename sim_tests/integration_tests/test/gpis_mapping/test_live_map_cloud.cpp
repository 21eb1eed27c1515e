// SPDX-License-Identifier: BSD-3-Clause
// A lidar that sees all round in one room, by mapping_cloud.launch: each wall is where it is.
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <Eigen/Geometry>
#include <gtest/gtest.h>
#include <interactive_mapping_common_ros/testing/waiting.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <interactive_mapping_msgs/QueryMap.h>
#include <ros/ros.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <tf2_ros/static_transform_broadcaster.h>

namespace integration_tests {
namespace {

using interactive_mapping_msgs::MapUpdate;
using node_tests::waitUntil;

constexpr double kHeight_m = 0.5;  // of the lidar above the floor
constexpr double kYaw_rad = 0.3;   // of the lidar's x axis

/// The walls x = 1, x = -1.2, y = 0.8, y = -0.9 and the floor as the lidar sees them, a beam per third of a degree.
sensor_msgs::PointCloud2 scan() {
  std::vector<Eigen::Vector3d> points;
  const double step = M_PI / 540.0;
  for (double pitch = -0.5; pitch < 0.5; pitch += step) {
    for (double yaw = -M_PI; yaw < M_PI; yaw += step) {
      const Eigen::Vector3d beam(std::cos(pitch) * std::cos(yaw + kYaw_rad), std::cos(pitch) * std::sin(yaw + kYaw_rad),
                                 std::sin(pitch));
      double range = 1e9;
      for (const auto& [axis, at] : {std::pair(0, 1.0), {0, -1.2}, {1, 0.8}, {1, -0.9}, {2, -kHeight_m}}) {
        if (at / beam[axis] > 0.0) range = std::min(range, at / beam[axis]);
      }
      points.push_back(Eigen::AngleAxisd(-kYaw_rad, Eigen::Vector3d::UnitZ()) * (range * beam));
    }
  }
  sensor_msgs::PointCloud2 cloud;
  cloud.header.frame_id = "lidar";
  sensor_msgs::PointCloud2Modifier modifier(cloud);
  modifier.setPointCloud2FieldsByString(1, "xyz");
  modifier.resize(points.size());
  sensor_msgs::PointCloud2Iterator<float> x(cloud, "x"), y(cloud, "y"), z(cloud, "z");
  for (const Eigen::Vector3d& point : points) {
    *x = static_cast<float>(point.x());
    *y = static_cast<float>(point.y());
    *z = static_cast<float>(point.z());
    ++x;
    ++y;
    ++z;
  }
  return cloud;
}

TEST(LiveMapCloud, MapsTheRoomAllRound) {
  ros::NodeHandle nh;
  tf2_ros::StaticTransformBroadcaster tf;
  geometry_msgs::TransformStamped lidar;
  lidar.header.stamp = ros::Time::now();
  lidar.header.frame_id = "map";
  lidar.child_frame_id = "lidar";
  lidar.transform.translation.z = kHeight_m;
  lidar.transform.rotation.z = std::sin(0.5 * kYaw_rad);
  lidar.transform.rotation.w = std::cos(0.5 * kYaw_rad);
  tf.sendTransform(lidar);
  const ros::Publisher publisher = nh.advertise<sensor_msgs::PointCloud2>("/lidar/points", 1);
  int accepted = 0;
  const ros::Subscriber subscriber = nh.subscribe<MapUpdate>(
      "/gpis_mapping/update", 50,
      [&](const MapUpdate::ConstPtr& update) { accepted += update->status == MapUpdate::ACCEPTED ? 1 : 0; });
  sensor_msgs::PointCloud2 cloud = scan();
  ASSERT_TRUE(waitUntil([&] {  // the first clouds come before all are connected
    cloud.header.stamp = ros::Time::now();
    publisher.publish(cloud);
    return waitUntil([&, before = accepted] { return accepted >= before + 4; }, 2.0) && accepted >= 16;
  }));
  interactive_mapping_msgs::QueryMap call;
  call.request.frame_id = "map";
  for (const auto& [px, py] : {std::pair(0.8, 0.0), {-1.0, 0.0}, {0.0, 0.6}, {0.0, -0.7}}) {
    geometry_msgs::Point point;
    point.x = px;
    point.y = py;
    point.z = kHeight_m;
    call.request.points.push_back(point);
  }
  ASSERT_TRUE(ros::service::call("/gpis_mapping/query", call) && call.response.success) << call.response.message;
  for (std::size_t i = 0; i < 4; ++i) {
    // 0.2 m before each wall; a pixel is 7 mm wide there.
    EXPECT_NEAR(call.response.euclidean_distance.at(i), 0.2, 0.01) << "wall " << i;
  }
}

}  // namespace
}  // namespace integration_tests
