// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge_ros/ur_driver_bridge_params.h"

#include <sstream>
#include <vector>

#include <gmock/gmock.h>
#include <ros/ros.h>

#include <interactive_mapping_common/testing/shipped_file.h>
#include "ur_driver_bridge_ros/attached_memory.h"

namespace ur_driver_bridge_ros {
namespace {

using test_support::messageOf;
using testing::HasSubstr;

constexpr char kBricks[] = "/some/bricks.yaml";  // not read here

TEST(UrDriverBridgeParams, ShippedFileIsWhatTheFieldsSay) {
  test_support::expectShippedFile<UrDriverBridgeParams>(UR_DRIVER_BRIDGE_DIR "/config/ur_driver_bridge.yaml");
}

TEST(UrDriverBridgeParams, ShippedFileLoadsAsTheDefaults) {
  const UrDriverBridgeParams loaded = loadUrDriverBridgeParams(ros::NodeHandle("~shipped"));
  UrDriverBridgeParams expected;
  expected.bricks_file = loaded.bricks_file;  // what a launch file has to give
  EXPECT_EQ(interactive_mapping::toYaml(loaded), interactive_mapping::toYaml(expected));
}

interactive_mapping_msgs::AttachedBrick brickInHand() {
  interactive_mapping_msgs::AttachedBrick brick;
  brick.header.stamp = ros::Time(12.5);
  brick.header.frame_id = "magnet_tip";
  brick.is_attached = 1;
  brick.id = 7;
  brick.type = "standard";
  brick.size.x = 0.3;
  brick.size.y = 0.2;
  brick.size.z = 0.1;
  brick.pose.position.x = 0.01;
  brick.pose.position.y = -0.02;
  brick.pose.position.z = 0.05;
  brick.pose.orientation.y = 0.6;  // no two components alike but x
  brick.pose.orientation.z = -0.64;
  brick.pose.orientation.w = 0.48;
  return brick;
}

/// Returns when it is on the parameter server.
void keep(const ros::NodeHandle& nh, const interactive_mapping_msgs::AttachedBrick& brick) {
  nh.deleteParam("attached_brick");
  AttachedMemory memory(nh);
  memory.keep(brick);
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(10.0);  // a call to the master takes milliseconds
  while (!nh.hasParam("attached_brick") && ros::WallTime::now() < end) ros::WallDuration(0.001).sleep();
  ASSERT_TRUE(nh.hasParam("attached_brick"));
}

TEST(AttachedMemory, NextProcessRecallsTheBrickAsItWasTold) {
  const ros::NodeHandle nh("~remembers");
  keep(nh, brickInHand());
  const auto recalled = AttachedMemory(nh).recall();
  ASSERT_TRUE(recalled);
  std::ostringstream before;
  std::ostringstream after;
  before << brickInHand();
  after << *recalled;
  EXPECT_EQ(after.str(), before.str());
}

TEST(AttachedMemory, BrickThatWasLetGoIsForgotten) {
  const ros::NodeHandle nh("~forgets");
  EXPECT_FALSE(AttachedMemory(nh).recall());  // never told of any
  keep(nh, brickInHand());
  EXPECT_TRUE(AttachedMemory(nh).recall());
  keep(nh, interactive_mapping_msgs::AttachedBrick());
  EXPECT_FALSE(AttachedMemory(nh).recall());
}

TEST(AttachedMemory, WhatIsNoBrickIsNotBelieved) {
  const ros::NodeHandle nh("~spoilt");
  for (const char* key : {"stamp_s", "frame_id", "id", "type", "size_m", "position_m", "orientation_xyzw"}) {
    keep(nh, brickInHand());
    nh.setParam(std::string("attached_brick/") + key, true);
    EXPECT_FALSE(AttachedMemory(nh).recall()) << key;
    keep(nh, brickInHand());
    nh.deleteParam(std::string("attached_brick/") + key);
    EXPECT_FALSE(AttachedMemory(nh).recall()) << key;
  }
  keep(nh, brickInHand());
  nh.setParam("attached_brick/orientation_xyzw", std::vector<double>{0.0, 0.0, 0.0, 0.0});
  EXPECT_FALSE(AttachedMemory(nh).recall());
}

TEST(AttachedMemory, WhatIsKeptThereIsNoUnknownParameter) {
  const ros::NodeHandle nh("~respawned");
  nh.setParam("bricks_file", kBricks);
  keep(nh, brickInHand());
  EXPECT_NO_THROW(loadUrDriverBridgeParams(nh));
}

TEST(UrDriverBridgeParams, OneMessageNamesEveryProblemWithValueAndRange) {
  ros::NodeHandle nh("~wrong");
  nh.setParam("bricks_file", "bricks.yaml");
  nh.setParam("base_frame", "/base_link");
  nh.setParam("colour", true);
  nh.setParam("max_payload_kg", 0.0);
  nh.setParam("watchdog_rate_hz", 5.0);
  nh.setParam("lockstep_wait_s", -1.0);
  nh.setParam("gate/max_joint_age_s", 2.0);
  nh.setParam("motion/stop_s", "soon");
  nh.setParam("motion/latency_s", 0.5);
  nh.setParam("contact/hard_N", 5.0);
  nh.setParam("pick/settle_s", -0.1);
  nh.setParam("load/min_samples", 1.5);
  nh.setParam("load/max_share", 0.5);
  nh.setParam("gripper/io_timeout_s", 0.0);
  nh.setParam("gripper/own/digital_output", 18);  // the plugin's
  nh.setParam("recovery/max_commands", 0);
  const std::string message = messageOf<std::invalid_argument>([&] { loadUrDriverBridgeParams(nh); });
  EXPECT_THAT(message, HasSubstr("/wrong/bricks_file = 'bricks.yaml', must be the absolute path"));
  EXPECT_THAT(message, HasSubstr("/wrong/base_frame = '/base_link', must be a tf2 frame"));
  EXPECT_THAT(message, HasSubstr("/wrong/colour is unknown"));
  EXPECT_THAT(message, HasSubstr("/wrong/max_payload_kg = 0 kg, must be in [0.1, 100] kg"));
  EXPECT_THAT(message, HasSubstr("/wrong/watchdog_rate_hz = 5 Hz, must be in [10, 500] Hz"));
  EXPECT_THAT(message, HasSubstr("/wrong/lockstep_wait_s = -1 s, must be in [0, 60] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/gate/max_joint_age_s = 2 s, must be in [0.005, 1] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/motion/stop_s"));
  EXPECT_THAT(message, HasSubstr("/wrong/motion/latency_s = 0.5 s, must be in [0, 0.1] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/contact/hard_N = 5 N, must be in [8, 500] N"));
  EXPECT_THAT(message, HasSubstr("/wrong/pick/settle_s = -0.1 s, must be in [0, 5] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/load/min_samples"));
  EXPECT_THAT(message, HasSubstr("/wrong/load/max_share = 0.5, must be in [1, 10]"));
  EXPECT_THAT(message, HasSubstr("/wrong/gripper/io_timeout_s = 0 s, must be in [0.1, 10] s"));
  EXPECT_THAT(message, testing::Not(HasSubstr("digital_output")));
  EXPECT_THAT(message, HasSubstr("/wrong/recovery/max_commands = 0, must be in [1, 100]"));
}

}  // namespace
}  // namespace ur_driver_bridge_ros
