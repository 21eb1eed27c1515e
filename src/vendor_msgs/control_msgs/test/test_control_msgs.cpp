// SPDX-License-Identifier: BSD-3-Clause
// A node built with the original package talks to one built with these definitions if the MD5 sums agree: roscpp
// compares them on every connection. The sums are those of the original, version 1.5.2.
#include <control_msgs/FollowJointTrajectoryAction.h>
#include <control_msgs/GripperCommand.h>
#include <control_msgs/GripperCommandAction.h>
#include <control_msgs/JointControllerState.h>
#include <control_msgs/JointJog.h>
#include <control_msgs/JointTolerance.h>
#include <control_msgs/JointTrajectoryAction.h>
#include <control_msgs/JointTrajectoryControllerState.h>
#include <control_msgs/PidState.h>
#include <control_msgs/PointHeadAction.h>
#include <control_msgs/QueryCalibrationState.h>
#include <control_msgs/QueryTrajectoryState.h>
#include <control_msgs/SingleJointPositionAction.h>
#include <gtest/gtest.h>
#include <ros/message_traits.h>
#include <ros/service_traits.h>

namespace {

using ros::message_traits::md5sum;

TEST(ControlMsgs, MessagesAreTheOriginalsOnTheWire) {
  EXPECT_STREQ(md5sum<control_msgs::GripperCommand>(), "680acaff79486f017132a7f198d40f08");
  EXPECT_STREQ(md5sum<control_msgs::JointControllerState>(), "987ad85e4756f3aef7f1e5e7fe0595d1");
  EXPECT_STREQ(md5sum<control_msgs::JointJog>(), "1685da700c8c2e1254afc92a5fb89c96");
  EXPECT_STREQ(md5sum<control_msgs::JointTolerance>(), "f544fe9c16cf04547e135dd6063ff5be");
  EXPECT_STREQ(md5sum<control_msgs::JointTrajectoryControllerState>(), "10817c60c2486ef6b33e97dcd87f4474");
  EXPECT_STREQ(md5sum<control_msgs::PidState>(), "b138ec00e886c10e73f27e8712252ea6");
}

TEST(ControlMsgs, FollowJointTrajectoryActionIsTheOriginalOnTheWire) {
  EXPECT_STREQ(md5sum<control_msgs::FollowJointTrajectoryAction>(), "bc4f9b743838566551c0390c65f1a248");
  EXPECT_STREQ(md5sum<control_msgs::FollowJointTrajectoryActionFeedback>(), "d8920dc4eae9fc107e00999cce4be641");
  EXPECT_STREQ(md5sum<control_msgs::FollowJointTrajectoryActionGoal>(), "cff5c1d533bf2f82dd0138d57f4304bb");
  EXPECT_STREQ(md5sum<control_msgs::FollowJointTrajectoryActionResult>(), "c4fb3b000dc9da4fd99699380efcc5d9");
  EXPECT_STREQ(md5sum<control_msgs::FollowJointTrajectoryFeedback>(), "10817c60c2486ef6b33e97dcd87f4474");
  EXPECT_STREQ(md5sum<control_msgs::FollowJointTrajectoryGoal>(), "69636787b6ecbde4d61d711979bc7ecb");
  EXPECT_STREQ(md5sum<control_msgs::FollowJointTrajectoryResult>(), "493383b18409bfb604b4e26c676401d2");
}

TEST(ControlMsgs, GripperCommandActionIsTheOriginalOnTheWire) {
  EXPECT_STREQ(md5sum<control_msgs::GripperCommandAction>(), "950b2a6ebe831f5d4f4ceaba3d8be01e");
  EXPECT_STREQ(md5sum<control_msgs::GripperCommandActionFeedback>(), "653dff30c045f5e6ff3feb3409f4558d");
  EXPECT_STREQ(md5sum<control_msgs::GripperCommandActionGoal>(), "aa581f648a35ed681db2ec0bf7a82bea");
  EXPECT_STREQ(md5sum<control_msgs::GripperCommandActionResult>(), "143702cb2df0f163c5283cedc5efc6b6");
  EXPECT_STREQ(md5sum<control_msgs::GripperCommandFeedback>(), "e4cbff56d3562bcf113da5a5adeef91f");
  EXPECT_STREQ(md5sum<control_msgs::GripperCommandGoal>(), "86fd82f4ddc48a4cb6856cfa69217e43");
  EXPECT_STREQ(md5sum<control_msgs::GripperCommandResult>(), "e4cbff56d3562bcf113da5a5adeef91f");
}

TEST(ControlMsgs, JointTrajectoryActionIsTheOriginalOnTheWire) {
  EXPECT_STREQ(md5sum<control_msgs::JointTrajectoryAction>(), "a04ba3ee8f6a2d0985a6aeaf23d9d7ad");
  EXPECT_STREQ(md5sum<control_msgs::JointTrajectoryActionFeedback>(), "aae20e09065c3809e8a8e87c4c8953fd");
  EXPECT_STREQ(md5sum<control_msgs::JointTrajectoryActionGoal>(), "a99e83ef6185f9fdd7693efe99623a86");
  EXPECT_STREQ(md5sum<control_msgs::JointTrajectoryActionResult>(), "1eb06eeff08fa7ea874431638cb52332");
  EXPECT_STREQ(md5sum<control_msgs::JointTrajectoryFeedback>(), "d41d8cd98f00b204e9800998ecf8427e");
  EXPECT_STREQ(md5sum<control_msgs::JointTrajectoryGoal>(), "2a0eff76c870e8595636c2a562ca298e");
  EXPECT_STREQ(md5sum<control_msgs::JointTrajectoryResult>(), "d41d8cd98f00b204e9800998ecf8427e");
}

TEST(ControlMsgs, PointHeadActionIsTheOriginalOnTheWire) {
  EXPECT_STREQ(md5sum<control_msgs::PointHeadAction>(), "7252920f1243de1b741f14f214125371");
  EXPECT_STREQ(md5sum<control_msgs::PointHeadActionFeedback>(), "33c9244957176bbba97dd641119e8460");
  EXPECT_STREQ(md5sum<control_msgs::PointHeadActionGoal>(), "b53a8323d0ba7b310ba17a2d3a82a6b8");
  EXPECT_STREQ(md5sum<control_msgs::PointHeadActionResult>(), "1eb06eeff08fa7ea874431638cb52332");
  EXPECT_STREQ(md5sum<control_msgs::PointHeadFeedback>(), "cce80d27fd763682da8805a73316cab4");
  EXPECT_STREQ(md5sum<control_msgs::PointHeadGoal>(), "8b92b1cd5e06c8a94c917dc3209a4c1d");
  EXPECT_STREQ(md5sum<control_msgs::PointHeadResult>(), "d41d8cd98f00b204e9800998ecf8427e");
}

TEST(ControlMsgs, SingleJointPositionActionIsTheOriginalOnTheWire) {
  EXPECT_STREQ(md5sum<control_msgs::SingleJointPositionAction>(), "c4a786b7d53e5d0983decf967a5a779e");
  EXPECT_STREQ(md5sum<control_msgs::SingleJointPositionActionFeedback>(), "3503b7cf8972f90d245850a5d8796cfa");
  EXPECT_STREQ(md5sum<control_msgs::SingleJointPositionActionGoal>(), "4b0d3d091471663e17749c1d0db90f61");
  EXPECT_STREQ(md5sum<control_msgs::SingleJointPositionActionResult>(), "1eb06eeff08fa7ea874431638cb52332");
  EXPECT_STREQ(md5sum<control_msgs::SingleJointPositionFeedback>(), "8cee65610a3d08e0a1bded82f146f1fd");
  EXPECT_STREQ(md5sum<control_msgs::SingleJointPositionGoal>(), "fbaaa562a23a013fd5053e5f72cbb35c");
  EXPECT_STREQ(md5sum<control_msgs::SingleJointPositionResult>(), "d41d8cd98f00b204e9800998ecf8427e");
}

TEST(ControlMsgs, ServicesAreTheOriginalsOnTheWire) {
  EXPECT_STREQ(ros::service_traits::md5sum<control_msgs::QueryCalibrationState>(), "28af3beedcb84986b8e470dc5470507d");
  EXPECT_STREQ(ros::service_traits::md5sum<control_msgs::QueryTrajectoryState>(), "ec93cdecbd8062d761aa52b7c90cd44b");
}

}  // namespace
