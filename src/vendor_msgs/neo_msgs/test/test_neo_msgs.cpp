// SPDX-License-Identifier: BSD-3-Clause
// A node built with the original package talks to one built with these definitions if the MD5 sums agree: roscpp
// compares them on every connection.
#include <gtest/gtest.h>
#include <neo_msgs/EmergencyStopState.h>
#include <ros/message_traits.h>

namespace {

TEST(NeoMsgs, MessagesAreTheOriginalsOnTheWire) {
  EXPECT_STREQ(ros::message_traits::md5sum<neo_msgs::EmergencyStopState>(), "29fd87604c9bdbc72cb73a515633cc11");
}

}  // namespace
