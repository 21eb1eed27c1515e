// SPDX-License-Identifier: BSD-3-Clause
// A node built with the original package talks to one built with these definitions if the MD5 sums agree: roscpp
// compares them on every connection. The sums are those of the original, version 3.2.1.
#include <apriltag_ros/AnalyzeSingleImage.h>
#include <apriltag_ros/AprilTagDetection.h>
#include <apriltag_ros/AprilTagDetectionArray.h>
#include <gtest/gtest.h>
#include <ros/message_traits.h>
#include <ros/service_traits.h>

namespace {

using ros::message_traits::md5sum;

TEST(ApriltagRos, MessagesAreTheOriginalsOnTheWire) {
  EXPECT_STREQ(md5sum<apriltag_ros::AprilTagDetection>(), "090173a6e2b6c8fd96ce000fe9378b4e");
  EXPECT_STREQ(md5sum<apriltag_ros::AprilTagDetectionArray>(), "2b6c03434883a5c9897c13b5594dbd91");
}

TEST(ApriltagRos, ServicesAreTheOriginalsOnTheWire) {
  EXPECT_STREQ(ros::service_traits::md5sum<apriltag_ros::AnalyzeSingleImage>(), "d60d994450f73cbdba772751d78c9952");
}

}  // namespace
