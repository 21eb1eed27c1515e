// SPDX-License-Identifier: BSD-3-Clause
#include "depth_self_filter_ros/conversions.h"

#include <cmath>
#include <limits>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/robots.h"

namespace depth_self_filter_ros {
namespace {

using depth_self_filter::test::shippedRobot;
using gpis_mapping_ros::FrameStatus;
using interactive_mapping_msgs::AttachedBrick;
using interactive_mapping_msgs::SelfFilterUpdate;
using testing::HasSubstr;

TEST(Conversions, EveryStatusHasItsOwnName) {
  std::set<std::string> names;
  for (int status = 0; status < SelfFilterUpdate::NUM_STATUS; ++status) {
    names.insert(statusName(static_cast<std::uint8_t>(status)));
  }
  EXPECT_EQ(names.size(), std::size_t{SelfFilterUpdate::NUM_STATUS});
  EXPECT_EQ(names.count("?"), 0U);
  EXPECT_STREQ(statusName(SelfFilterUpdate::NUM_STATUS), "?");
}

TEST(Conversions, ReasonsOfTheMapsChecksKeepTheirMeaning) {
  EXPECT_EQ(toDrop({FrameStatus::kWrongEncoding, "seen"}).status, SelfFilterUpdate::WRONG_ENCODING);
  EXPECT_EQ(toDrop({FrameStatus::kMalformedImage, "seen"}).status, SelfFilterUpdate::MALFORMED_IMAGE);
  EXPECT_EQ(toDrop({FrameStatus::kSizeMismatch, "seen"}).status, SelfFilterUpdate::SIZE_MISMATCH);
  EXPECT_EQ(toDrop({FrameStatus::kBadCameraInfo, "seen"}).status, SelfFilterUpdate::BAD_CAMERA_INFO);
  EXPECT_EQ(toDrop({FrameStatus::kNoCameraInfo, "seen"}).status, SelfFilterUpdate::NO_CAMERA_INFO);
  EXPECT_EQ(toDrop({FrameStatus::kNoTransform, "seen"}).status, SelfFilterUpdate::NO_TRANSFORM);
  EXPECT_EQ(toDrop({FrameStatus::kBadTransform, "seen"}).status, SelfFilterUpdate::BAD_TRANSFORM);
  EXPECT_EQ(toDrop({FrameStatus::kPoseJump, "seen"}).status, SelfFilterUpdate::POSE_JUMP);
  EXPECT_EQ(toDrop({FrameStatus::kTimeRanBack, "seen"}).status, SelfFilterUpdate::TIME_RAN_BACK);
  EXPECT_EQ(toDrop({FrameStatus::kStampInFuture, "seen"}).status, SelfFilterUpdate::STAMP_IN_FUTURE);
  EXPECT_EQ(toDrop({FrameStatus::kRefusedByMap, "seen"}).status, SelfFilterUpdate::FAILED);
  EXPECT_EQ(toDrop({FrameStatus::kWrongEncoding, "seen"}).message, "seen");
}

TEST(Conversions, DepthBecomesAMessageThatReadsBackTheSame) {
  std::mt19937_64 random(1);
  const gpis_mapping::DepthImage image = depth_self_filter::test::randomImage(37, 21, 4.0, &random);
  const sensor_msgs::ImagePtr message = toMessage(image);
  EXPECT_EQ(message->encoding, "32FC1");
  EXPECT_EQ(message->step, 37U * 4U);
  gpis_mapping_ros::Refusal refusal;
  const auto back = gpis_mapping_ros::toDepthImage(*message, 1000.0, &refusal);
  ASSERT_TRUE(back) << refusal.message;
  ASSERT_EQ(back->depth_m.size(), image.depth_m.size());
  EXPECT_EQ(std::memcmp(back->depth_m.data(), image.depth_m.data(), image.depth_m.size() * sizeof(float)), 0);
}

TEST(Conversions, AHoleOf16BitStaysTheHoleThatTheMapKnows) {
  sensor_msgs::Image message;
  message.width = 3;
  message.height = 1;
  message.encoding = "16UC1";
  message.step = 6;
  message.data = {0, 0, 0xE8, 0x03, 0xFF, 0xFF};  // 0, 1000 mm, 65535
  gpis_mapping_ros::Refusal refusal;
  const auto image = gpis_mapping_ros::toDepthImage(message, 1000.0, &refusal);
  ASSERT_TRUE(image) << refusal.message;
  const auto back = gpis_mapping_ros::toDepthImage(*toMessage(*image), 1000.0, &refusal);
  ASSERT_TRUE(back) << refusal.message;
  EXPECT_THAT(back->depth_m, testing::ElementsAre(0.0F, 1.0F, 0.0F));
}

TEST(Conversions, InfoOfARawImageSaysTheSameByPAndK) {
  sensor_msgs::CameraInfo info;
  info.width = 64;
  info.height = 48;
  info.K = {50.0, 0.0, 31.0, 0.0, 51.0, 23.0, 0.0, 0.0, 1.0};
  info.P = {40.0, 0.0, 30.0, 0.5, 0.0, 41.0, 22.0, 0.0, 0.0, 0.0, 1.0, 0.0};
  gpis_mapping_ros::Refusal refusal;
  for (const bool is_rectified : {false, true}) {
    const auto seen = gpis_mapping_ros::toCameraModel(info, is_rectified, &refusal);
    // The output's topic is called image_rect.
    const auto told = gpis_mapping_ros::toCameraModel(toOutputInfo(info, is_rectified), true, &refusal);
    ASSERT_TRUE(seen && told);
    EXPECT_TRUE(*seen == *told) << is_rectified;
  }
  EXPECT_EQ(toOutputInfo(info, false).P[3], 0.0);
}

AttachedBrick attached() {
  AttachedBrick message;
  message.header.stamp.fromSec(12.5);
  message.header.frame_id = "/ur5e_tool0";
  message.is_attached = 1;
  message.size.x = 0.3;
  message.size.y = message.size.z = 0.2;
  message.pose.position.z = 0.2;
  message.pose.orientation.z = message.pose.orientation.w = std::sqrt(0.5);
  return message;
}

TEST(Conversions, AttachedBrickIsWhereTheMessageSays) {
  std::string problem;
  const auto change = toChange(attached(), *shippedRobot(), &problem);
  EXPECT_EQ(problem, "");
  EXPECT_TRUE(change.is_clear);
  EXPECT_DOUBLE_EQ(change.since_s, 12.5);
  ASSERT_TRUE(change.brick);
  EXPECT_EQ(change.brick->frame, "ur5e_tool0");
  EXPECT_EQ(change.brick->size_m, Eigen::Vector3d(0.3, 0.2, 0.2));
  EXPECT_TRUE((change.brick->T_frame_brick * Eigen::Vector3d(1.0, 0.0, 0.0)).isApprox(Eigen::Vector3d(0.0, 1.0, 0.2)));
}

TEST(Conversions, NothingAttachedIsClearWhateverElseTheMessageSays) {
  AttachedBrick message;
  message.pose.position.x = std::nan("");
  std::string problem = "?";
  const auto change = toChange(message, *shippedRobot(), &problem);
  EXPECT_EQ(problem, "");
  EXPECT_TRUE(change.is_clear);
  EXPECT_FALSE(change.brick);
}

TEST(Conversions, AnAttachedBrickThatIsNowhereIsNotClear) {
  std::string problem;
  AttachedBrick message = attached();
  message.header.frame_id = "gripper";
  EXPECT_FALSE(toChange(message, *shippedRobot(), &problem).is_clear);
  EXPECT_THAT(problem, HasSubstr("'gripper', must be a link of the URDF"));
  message = attached();
  message.pose.position.y = std::nan("");
  EXPECT_FALSE(toChange(message, *shippedRobot(), &problem).is_clear);
  EXPECT_THAT(problem, HasSubstr("not finite"));
  message = attached();
  message.pose.orientation.w = message.pose.orientation.z = 0.0;
  EXPECT_FALSE(toChange(message, *shippedRobot(), &problem).is_clear);
  EXPECT_THAT(problem, HasSubstr("no rotation"));
  message = attached();
  message.size.z = 0.0;
  EXPECT_FALSE(toChange(message, *shippedRobot(), &problem).is_clear);
  EXPECT_THAT(problem, HasSubstr("must be in (0, 2] m"));
}

}  // namespace
}  // namespace depth_self_filter_ros
