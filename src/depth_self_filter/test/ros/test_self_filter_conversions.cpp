// SPDX-License-Identifier: BSD-3-Clause
#include "depth_self_filter_ros/conversions.h"

#include <cmath>
#include <limits>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/mask_oracle.h"
#include "support/robots.h"

namespace depth_self_filter_ros {
namespace {

using depth_camera_ros::FrameStatus;
using depth_self_filter::test::shippedRobot;
using interactive_mapping_msgs::AttachedBrick;
using interactive_mapping_msgs::SelfFilterUpdate;
using testing::HasSubstr;

TEST(Conversions, EveryStatusHasItsOwnName) {
  std::set<std::string> names;
  for (int status = 0; status < SelfFilterUpdate::NUM_STATUS; ++status) {
    names.insert(toString(static_cast<SelfFilterStatus>(status)));
  }
  EXPECT_EQ(names.size(), std::size_t{SelfFilterUpdate::NUM_STATUS});
  EXPECT_EQ(names.count("?"), 0U);
  EXPECT_STREQ(toString(static_cast<SelfFilterStatus>(SelfFilterUpdate::NUM_STATUS)), "?");
}

TEST(Conversions, ReasonsOfTheMapsChecksKeepTheirMeaning) {
  EXPECT_EQ(toDrop({FrameStatus::kWrongEncoding, "seen"}).status, SelfFilterStatus::kWrongEncoding);
  EXPECT_EQ(toDrop({FrameStatus::kMalformedImage, "seen"}).status, SelfFilterStatus::kMalformedImage);
  EXPECT_EQ(toDrop({FrameStatus::kSizeMismatch, "seen"}).status, SelfFilterStatus::kSizeMismatch);
  EXPECT_EQ(toDrop({FrameStatus::kBadCameraInfo, "seen"}).status, SelfFilterStatus::kBadCameraInfo);
  EXPECT_EQ(toDrop({FrameStatus::kNoCameraInfo, "seen"}).status, SelfFilterStatus::kNoCameraInfo);
  EXPECT_EQ(toDrop({FrameStatus::kNoTransform, "seen"}).status, SelfFilterStatus::kNoTransform);
  EXPECT_EQ(toDrop({FrameStatus::kBadTransform, "seen"}).status, SelfFilterStatus::kBadTransform);
  EXPECT_EQ(toDrop({FrameStatus::kPoseJump, "seen"}).status, SelfFilterStatus::kPoseJump);
  EXPECT_EQ(toDrop({FrameStatus::kTimeRanBack, "seen"}).status, SelfFilterStatus::kTimeRanBack);
  EXPECT_EQ(toDrop({FrameStatus::kStampInFuture, "seen"}).status, SelfFilterStatus::kStampInFuture);
  EXPECT_EQ(toDrop({FrameStatus::kRefusedByMap, "seen"}).status, SelfFilterStatus::kFailed);
  EXPECT_EQ(toDrop({FrameStatus::kWrongEncoding, "seen"}).message, "seen");
}

TEST(Conversions, DepthBecomesAMessageThatReadsBackTheSame) {
  std::mt19937_64 random(1);
  const depth_camera::DepthImage image = depth_self_filter::test::randomImage(37, 21, 4.0, &random);
  const sensor_msgs::ImagePtr message = toMessage(image);
  EXPECT_EQ(message->encoding, "32FC1");
  EXPECT_EQ(message->step, 37U * 4U);
  depth_camera_ros::Refusal refusal;
  const auto back = depth_camera_ros::toDepthImage(*message, 1000.0, &refusal);
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
  depth_camera_ros::Refusal refusal;
  const auto image = depth_camera_ros::toDepthImage(message, 1000.0, &refusal);
  ASSERT_TRUE(image) << refusal.message;
  const auto back = depth_camera_ros::toDepthImage(*toMessage(*image), 1000.0, &refusal);
  ASSERT_TRUE(back) << refusal.message;
  EXPECT_THAT(back->depth_m, testing::ElementsAre(0.0F, 1.0F, 0.0F));
}

sensor_msgs::CameraInfo distortedInfo() {
  sensor_msgs::CameraInfo info;
  info.width = 192;
  info.height = 144;
  info.distortion_model = "plumb_bob";
  info.D = {0.6, 0.0, 0.0, 0.0, 0.0};
  info.K = {140.0, 0.0, 95.0, 0.0, 141.0, 72.0, 0.0, 0.0, 1.0};
  info.P = {60.0, 0.0, 46.0, 0.5, 0.0, 61.0, 35.0, 0.0, 0.0, 0.0, 1.0, 0.0};
  return info;
}

TEST(Conversions, OutputInfoIsThatOfTheRectifiedImage) {
  sensor_msgs::CameraInfo info = distortedInfo();
  info.header.frame_id = "eye";
  info.roi.x_offset = 8;
  info.roi.width = 80;
  info.roi.height = 60;
  info.binning_x = 2;
  depth_camera_ros::Refusal refusal;
  for (const bool is_rectified : {false, true}) {
    depth_camera::DepthRectifier rectifier;
    ASSERT_TRUE(depth_camera_ros::toDepthRectifier(info, is_rectified, &rectifier, &refusal)) << refusal.message;
    const sensor_msgs::CameraInfo output = toOutputInfo(info, rectifier.camera());
    EXPECT_EQ(output.header.frame_id, "eye");
    EXPECT_EQ(output.P[3], 0.0);
    EXPECT_EQ(output.R[0] * output.R[4] * output.R[8], 1.0);
    for (const bool reads_P : {false, true}) {
      depth_camera::DepthRectifier told;
      ASSERT_TRUE(depth_camera_ros::toDepthRectifier(output, reads_P, &told, &refusal)) << refusal.message;
      EXPECT_TRUE(told.distortion().isZero());
      EXPECT_TRUE(told.camera() == rectifier.camera()) << is_rectified;
    }
  }
}

TEST(Conversions, TheMaskFitsARectifiedImage) {
  constexpr float kWall_m = 3.0F;
  const auto robot = shippedRobot();
  const Eigen::VectorXd q = depth_self_filter::test::positions(*robot, depth_self_filter::test::kArmInView);
  // Turned until the arm is in a corner of the image, where distortion counts.
  const Eigen::Isometry3d T_root_camera =
      robot->framePose(mp700_ur5e_description::kDepthFrame, q) * Eigen::AngleAxisd(0.35, Eigen::Vector3d::UnitY());
  const sensor_msgs::CameraInfo info = distortedInfo();
  depth_camera::DepthRectifier rectifier;
  depth_camera_ros::Refusal refusal;
  ASSERT_TRUE(depth_camera_ros::toDepthRectifier(info, false, &rectifier, &refusal)) << refusal.message;
  // The robot itself before a wall, through the lens.
  const depth_self_filter::RobotMask bare(robot, depth_self_filter::test::exactConfig());
  const auto shapes = depth_self_filter::test::oracleShapes(bare, T_root_camera, q, std::nullopt, 0.0);
  const depth_camera::CameraModel& raw = rectifier.rawCamera();
  depth_camera::DepthImage image{raw.width, raw.height, {}};
  for (int v = 0; v < raw.height; ++v) {
    for (int u = 0; u < raw.width; ++u) {
      const Eigen::Vector2d seen((u - raw.cx) / raw.fx, (v - raw.cy) / raw.fy);
      double r = seen.norm();
      for (int i = 0; i < 50; ++i) r -= (r + info.D[0] * r * r * r - seen.norm()) / (1.0 + 3.0 * info.D[0] * r * r);
      const Eigen::Vector2d ray = seen.norm() > 0.0 ? Eigen::Vector2d(seen * (r / seen.norm())) : seen;
      double z = kWall_m;
      for (const auto& shape : shapes) {
        z = std::min(z, depth_self_filter::test::walk(shape, Eigen::Vector3d(ray.x(), ray.y(), 1.0), false));
      }
      image.depth_m.push_back(static_cast<float>(z));
    }
  }
  depth_self_filter::RobotMask mask(robot, depth_self_filter::RobotMaskConfig());
  const auto left = [&](const depth_camera::CameraModel& camera, depth_camera::DepthImage of) {
    mask.apply(camera, T_root_camera, q, std::nullopt, &of);
    std::size_t num_robot = 0;
    std::size_t num_wall = 0;
    for (const float z : of.depth_m) {
      num_robot += z < 0.97F * kWall_m;
      num_wall += std::abs(z - kWall_m) < 1e-3F;
    }
    return std::make_pair(num_robot, num_wall);
  };
  EXPECT_GT(left(raw, image).first, 10U) << "the distortion shows";
  const auto [num_robot, num_wall] = left(rectifier.camera(), rectifier.rectify(image));
  EXPECT_EQ(num_robot, 0U);
  EXPECT_GT(num_wall, image.depth_m.size() / 4);
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
