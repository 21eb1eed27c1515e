// SPDX-License-Identifier: BSD-3-Clause
// A node built with the original package talks to one built with these definitions if the MD5 sums agree: roscpp
// compares them on every connection. The sums are those of the original, version 2.4.1.
#include <gtest/gtest.h>
#include <ros/message_traits.h>
#include <ros/service_traits.h>
#include <ur_dashboard_msgs/AddToLog.h>
#include <ur_dashboard_msgs/GetLoadedProgram.h>
#include <ur_dashboard_msgs/GetProgramState.h>
#include <ur_dashboard_msgs/GetRobotMode.h>
#include <ur_dashboard_msgs/GetSafetyMode.h>
#include <ur_dashboard_msgs/IsInRemoteControl.h>
#include <ur_dashboard_msgs/IsProgramRunning.h>
#include <ur_dashboard_msgs/IsProgramSaved.h>
#include <ur_dashboard_msgs/Load.h>
#include <ur_dashboard_msgs/Popup.h>
#include <ur_dashboard_msgs/ProgramState.h>
#include <ur_dashboard_msgs/RobotMode.h>
#include <ur_dashboard_msgs/SafetyMode.h>
#include <ur_dashboard_msgs/SetModeAction.h>

namespace {

using ros::message_traits::md5sum;

TEST(UrDashboardMsgs, MessagesAreTheOriginalsOnTheWire) {
  EXPECT_STREQ(md5sum<ur_dashboard_msgs::ProgramState>(), "0cf2a8b9397741f9e4ac8b71fd354966");
  EXPECT_STREQ(md5sum<ur_dashboard_msgs::RobotMode>(), "73b72d58742c4889c47118411b03a3b4");
  EXPECT_STREQ(md5sum<ur_dashboard_msgs::SafetyMode>(), "5da08725a63d4237bad689481131a84b");
}

TEST(UrDashboardMsgs, SetModeActionIsTheOriginalOnTheWire) {
  EXPECT_STREQ(md5sum<ur_dashboard_msgs::SetModeAction>(), "7048f11efd68ac8c7a2750e444f501df");
  EXPECT_STREQ(md5sum<ur_dashboard_msgs::SetModeActionFeedback>(), "831678737b3029b95af045136cbfc40f");
  EXPECT_STREQ(md5sum<ur_dashboard_msgs::SetModeActionGoal>(), "0012d5645be9adc78c7732326d965640");
  EXPECT_STREQ(md5sum<ur_dashboard_msgs::SetModeActionResult>(), "1471476fb0fc7d1ce25819ffcafc3f6d");
  EXPECT_STREQ(md5sum<ur_dashboard_msgs::SetModeFeedback>(), "d48caaba06f88e6be0ba90bf29940534");
  EXPECT_STREQ(md5sum<ur_dashboard_msgs::SetModeGoal>(), "a32b63f0e8a660b2b96916617d699c39");
  EXPECT_STREQ(md5sum<ur_dashboard_msgs::SetModeResult>(), "937c9679a518e3a18d831e57125ea522");
}

TEST(UrDashboardMsgs, ServicesAreTheOriginalsOnTheWire) {
  EXPECT_STREQ(ros::service_traits::md5sum<ur_dashboard_msgs::AddToLog>(), "2054bf354d51f4d6a4dce330cf7bb805");
  EXPECT_STREQ(ros::service_traits::md5sum<ur_dashboard_msgs::GetLoadedProgram>(), "0193dad3cdb834b9f37e420a88468ebe");
  EXPECT_STREQ(ros::service_traits::md5sum<ur_dashboard_msgs::GetProgramState>(), "522d35a6f2ebd9702cb1e33489e1aa96");
  EXPECT_STREQ(ros::service_traits::md5sum<ur_dashboard_msgs::GetRobotMode>(), "ef94c03da2e53bb8c576236bb003fe8a");
  EXPECT_STREQ(ros::service_traits::md5sum<ur_dashboard_msgs::GetSafetyMode>(), "42900ff79a0c74f885536dc5add71b7e");
  EXPECT_STREQ(ros::service_traits::md5sum<ur_dashboard_msgs::IsInRemoteControl>(), "032fdd19f824627299e7ba024ba3c0bc");
  EXPECT_STREQ(ros::service_traits::md5sum<ur_dashboard_msgs::IsProgramRunning>(), "290f0cb02c3a44353957f0a92f954209");
  EXPECT_STREQ(ros::service_traits::md5sum<ur_dashboard_msgs::IsProgramSaved>(), "e922e4e4f5e4157c23417860c8b2336a");
  EXPECT_STREQ(ros::service_traits::md5sum<ur_dashboard_msgs::Load>(), "abbee7d5c683c0b3af261ba331da1fbb");
  EXPECT_STREQ(ros::service_traits::md5sum<ur_dashboard_msgs::Popup>(), "2054bf354d51f4d6a4dce330cf7bb805");
}

}  // namespace
