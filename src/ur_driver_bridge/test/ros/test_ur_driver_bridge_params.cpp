// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge_ros/ur_driver_bridge_params.h"

#include <gmock/gmock.h>
#include <ros/ros.h>

#include "support/params_contract.h"

namespace ur_driver_bridge_ros {
namespace {

using params_contract::messageOf;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr char kBricks[] = "/some/bricks.yaml";  // not read here

const params_contract::Contract kContract = {
    UR_DRIVER_BRIDGE_DIR,
    "config/ur_driver_bridge.yaml",
    toYaml(UrDriverBridgeParams()),
    [](const ros::NodeHandle& nh) { return toYaml(loadUrDriverBridgeParams(nh)); },
    {"load/min_samples", "magnet/digital_output", "recovery/max_commands"},
    {{"base_frame", "platform"}, {"bricks_file", kBricks}}};

TEST(UrDriverBridgeParams, ShippedFileHasEveryKeyWithItsDefault) {
  params_contract::expectShippedFileHasEveryDefault(kContract);
}

TEST(UrDriverBridgeParams, ShippedFileLoadsAsTheDefaults) {
  const UrDriverBridgeParams loaded = loadUrDriverBridgeParams(ros::NodeHandle("~shipped"));
  UrDriverBridgeParams expected;
  expected.bricks_file = loaded.bricks_file;  // what a launch file has to give
  EXPECT_EQ(toYaml(loaded), toYaml(expected));
  EXPECT_EQ(loaded.executor.recovery.protective_stop, ur_driver_bridge::ProtectiveStopPolicy::kOperator);
}

TEST(UrDriverBridgeParams, EveryKeyIsReadIntoItsOwnField) {
  params_contract::expectEveryKeyIsReadIntoItsOwnField(kContract, ros::NodeHandle("~changed"));
}

TEST(UrDriverBridgeParams, ReadmeTableHasEveryKeyWithItsDefault) {
  params_contract::expectReadmeTableHasEveryDefault(kContract);
}

TEST(UrDriverBridgeParams, UnlocksByItselfOnlyIfToldSo) {
  ros::NodeHandle nh("~unlocks");
  nh.setParam("bricks_file", kBricks);
  nh.setParam("recovery/unlocks_by_itself", true);
  EXPECT_EQ(loadUrDriverBridgeParams(nh).executor.recovery.protective_stop,
            ur_driver_bridge::ProtectiveStopPolicy::kAutomatic);
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
  nh.setParam("magnet/digital_output", 18);
  nh.setParam("magnet/io_timeout_s", 0.0);
  nh.setParam("recovery/max_commands", 0);
  const std::string message = messageOf(kContract, nh);
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
  EXPECT_THAT(message, HasSubstr("/wrong/magnet/digital_output = 18, must be in [0, 17]"));
  EXPECT_THAT(message, HasSubstr("/wrong/magnet/io_timeout_s = 0 s, must be in [0.1, 10] s"));
  EXPECT_THAT(message, HasSubstr("/wrong/recovery/max_commands = 0, must be in [1, 100]"));
}

TEST(UrDriverBridgeParams, AFileOfBricksMustBeGiven) {
  EXPECT_THAT(UrDriverBridgeParams().validate(), ElementsAre(HasSubstr("bricks_file = '', must be the absolute path")));
}

}  // namespace
}  // namespace ur_driver_bridge_ros

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  ros::init(argc, argv, "test_ur_driver_bridge_params");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
