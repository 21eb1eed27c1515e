// SPDX-License-Identifier: BSD-3-Clause
// A node built with the original package talks to one built with these definitions if the MD5 sums agree: roscpp
// compares them on every connection. The sums are those of the original, version 1.4.0.
#include <gtest/gtest.h>
#include <ros/message_traits.h>
#include <ros/service_traits.h>
#include <ur_msgs/Analog.h>
#include <ur_msgs/Digital.h>
#include <ur_msgs/IOStates.h>
#include <ur_msgs/SetIO.h>
#include <ur_msgs/SetPayload.h>
#include <ur_msgs/SetSpeedSliderFraction.h>

namespace {

using ros::message_traits::md5sum;

TEST(UrMsgs, MessagesAreTheOriginalsOnTheWire) {
  EXPECT_STREQ(md5sum<ur_msgs::Analog>(), "6be678008703fe11fbea12281a3d6d23");
  EXPECT_STREQ(md5sum<ur_msgs::Digital>(), "83707be3fa18d2ffe57381ea034aa262");
  EXPECT_STREQ(md5sum<ur_msgs::IOStates>(), "b341cc0bc3ea976e9cacf81c26adeb88");
}

TEST(UrMsgs, ServicesAreTheOriginalsOnTheWire) {
  EXPECT_STREQ(ros::service_traits::md5sum<ur_msgs::SetIO>(), "f539fc0b1a42859fb186a5aaba22d4b0");
  EXPECT_STREQ(ros::service_traits::md5sum<ur_msgs::SetPayload>(), "3e3a97c1edb6d0acdd0d0c9e9e4a538a");
  EXPECT_STREQ(ros::service_traits::md5sum<ur_msgs::SetSpeedSliderFraction>(), "172aeb6c49379a44cf68480fa5bfad3c");
}

}  // namespace
