// SPDX-License-Identifier: BSD-3-Clause
// A node built with the original package talks to one built with these definitions if the MD5 sums agree: roscpp
// compares them on every connection. The sums are those of the original, version 1.5.2.
#include <control_msgs/FollowJointTrajectoryAction.h>
#include <control_msgs/JointTolerance.h>
#include <control_msgs/JointTrajectoryControllerState.h>
#include <gtest/gtest.h>
#include <ros/message_traits.h>

namespace {

using ros::message_traits::md5sum;

TEST(ControlMsgs, MessagesAreTheOriginalsOnTheWire) {
  EXPECT_STREQ(md5sum<control_msgs::JointTolerance>(), "f544fe9c16cf04547e135dd6063ff5be");
  EXPECT_STREQ(md5sum<control_msgs::JointTrajectoryControllerState>(), "10817c60c2486ef6b33e97dcd87f4474");
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

}  // namespace
