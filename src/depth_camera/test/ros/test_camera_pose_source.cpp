// SPDX-License-Identifier: BSD-3-Clause
#include "depth_camera_ros/camera_pose_source.h"

#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ros/ros.h>
#include <tf2_ros/transform_broadcaster.h>

#include <interactive_mapping_common_ros/testing/waiting.h>

namespace depth_camera_ros {
namespace {

constexpr double kStep_s = 0.05;

/// A camera that is at x = t at t seconds after `begin`.
void sendPoses(tf2_ros::TransformBroadcaster* tf, const ros::Time& begin, double from_s, double to_s) {
  std::vector<geometry_msgs::TransformStamped> transforms;
  for (double t = from_s; t <= to_s + 1e-9; t += kStep_s) {
    geometry_msgs::TransformStamped transform;
    transform.header.stamp = begin + ros::Duration(t);
    transform.header.frame_id = "map";
    transform.child_frame_id = "eye";
    transform.transform.translation.x = t;
    transform.transform.rotation.w = 1.0;
    transforms.push_back(transform);
  }
  tf->sendTransform(transforms);
}

TEST(CameraPoseSource, GivesThePoseAtTheStampPlusTheTimeOffset) {
  for (const double offset_s : {0.0, -0.3, 0.6}) {
    CameraPoseParams params;
    params.time_offset_s = offset_s;
    params.tf_timeout_s = 0.2;
    CameraPoseSource source(ros::NodeHandle(), params);
    source.listen();
    tf2_ros::TransformBroadcaster tf;
    const ros::Time stamp = ros::Time::now();
    ASSERT_TRUE(node_tests::waitUntil([&] {
      sendPoses(&tf, stamp, -1.0, 0.1);
      return source.buffer().canTransform("map", "eye", stamp);
    }));
    // Poses of after the image come in their time, later than tf_timeout_s.
    std::thread later([&] {
      ros::WallDuration(0.4).sleep();
      sendPoses(&tf, stamp, 0.1, 1.0);
    });
    Refusal refusal;
    const auto pose = source.poseAt("eye", stamp, source.deadline(std::chrono::steady_clock::now()), &refusal);
    later.join();
    ASSERT_TRUE(pose) << refusal.message;
    EXPECT_NEAR(pose->translation().x(), offset_s, 1e-6);
  }
}

TEST(CameraPoseSource, RefusesAnImpossibleTimeOffset) {
  CameraPoseParams params;
  for (const double offset_s : {1.01, -1.01, std::numeric_limits<double>::quiet_NaN()}) {
    params.time_offset_s = offset_s;
    ASSERT_EQ(interactive_mapping::problemsOf(params).size(), 1u);
    EXPECT_THAT(interactive_mapping::problemsOf(params)[0], testing::HasSubstr("s, must be in [-1, 1] s"));
  }
}

}  // namespace
}  // namespace depth_camera_ros
