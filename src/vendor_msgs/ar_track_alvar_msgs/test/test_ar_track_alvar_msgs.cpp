// SPDX-License-Identifier: BSD-3-Clause
// A node built with the original package talks to one built with these definitions if the MD5 sums agree: roscpp
// compares them on every connection. The sums are those of the original, version 0.7.1.
#include <ar_track_alvar_msgs/AlvarMarker.h>
#include <ar_track_alvar_msgs/AlvarMarkers.h>
#include <gtest/gtest.h>
#include <ros/message_traits.h>

namespace {

using ros::message_traits::md5sum;

TEST(ArTrackAlvarMsgs, MessagesAreTheOriginalsOnTheWire) {
  EXPECT_STREQ(md5sum<ar_track_alvar_msgs::AlvarMarker>(), "ef2b6ad42bcb18e16b22fefb5c0fb85f");
  EXPECT_STREQ(md5sum<ar_track_alvar_msgs::AlvarMarkers>(), "943fe17bfb0b4ea7890368d0b25ad0ad");
}

}  // namespace
