// SPDX-License-Identifier: BSD-3-Clause
// What hangs on the magnet, and where it was taken from, against tf and messages of this test.
#include "motion_planning_ros/robot_state.h"

#include <memory>

#include <gtest/gtest.h>
#include <mp700_ur5e_description/robot_names.h>
#include <ros/ros.h>
#include <tf2_ros/transform_broadcaster.h>

#include <interactive_mapping_common_ros/testing/waiting.h>
#include "motion_planning_ros/planning_markers.h"
#include "support/urdf_text.h"

namespace motion_planning_ros {
namespace {

using interactive_mapping_msgs::AttachedBrick;
using motion_planning::ArmVector;
using mp700_ur5e_description::kMagnetTipFrame;
using node_tests::waitUntil;

class RobotStateTest : public testing::Test {
 protected:
  RobotStateTest() : attached_(nh_.advertise<AttachedBrick>("attached_brick", 5, true)) {
    arm_ = std::make_shared<motion_planning::ArmKinematics>(
        mp700_ur5e_description::RobotModel::parse(motion_planning::readFile(motion_planning::kUrdfFile), "test"));
    robot_ = std::make_unique<RobotState>(nh_, arm_, params_, 0.6);
  }

  /// The tip at (0.5, 0, z_m) in the map.
  void tellTip(const ros::Time& stamp, double z_m) {
    geometry_msgs::TransformStamped transform;
    transform.header.stamp = stamp;
    transform.header.frame_id = params_.map_frame;
    transform.child_frame_id = kMagnetTipFrame;
    transform.transform.translation.x = 0.5;
    transform.transform.translation.z = z_m;
    transform.transform.rotation.w = 1.0;
    broadcaster_.sendTransform(transform);
  }
  void tellJoints(const ArmVector& joints_rad) {
    sensor_msgs::JointState state;
    state.header.stamp = ros::Time::now();
    for (std::size_t i = 0; i < mp700_ur5e_description::kArmJoints.size(); ++i) {
      state.name.emplace_back(mp700_ur5e_description::kArmJoints[i]);
      state.position.push_back(joints_rad[static_cast<Eigen::Index>(i)]);
    }
    joints_.publish(state);
  }
  void attach(const ros::Time& stamp) {
    AttachedBrick brick;
    brick.header.frame_id = slash_ + kMagnetTipFrame;
    brick.header.stamp = stamp;
    brick.is_attached = 1;
    brick.id = 7;
    brick.size.x = brick.size.y = brick.size.z = 0.2;
    brick.pose.position.z = -0.1;
    brick.pose.orientation.w = 1.0;
    attached_.publish(brick);
    ASSERT_TRUE(waitUntil([this] { return robot_->held().has_value(); }));
  }
  /// Until tf has it.
  double awaitPlace() {
    EXPECT_TRUE(waitUntil([this] { return robot_->held()->vacated.has_value(); }));
    const auto held = robot_->held();
    return held && held->vacated ? held->vacated->T_map_box.translation().z() : 0.0;
  }
  bool hasTip(const ros::Time& stamp) {
    std::string why_not;
    return robot_->frameInMap(slash_ + kMagnetTipFrame, stamp, nullptr, &why_not).has_value();
  }

  std::string slash_;  // before frames that come from outside
  ros::NodeHandle nh_;
  MotionPlanningParams params_;
  tf2_ros::TransformBroadcaster broadcaster_;
  ros::Publisher attached_;
  ros::Publisher joints_ = nh_.advertise<sensor_msgs::JointState>("joint_states", 5);
  std::shared_ptr<const motion_planning::ArmKinematics> arm_;
  std::unique_ptr<RobotState> robot_;
  const ros::Time taken_at_ = ros::Time::now();
  const double place_m_ = 0.3 - 0.1;
};

TEST_F(RobotStateTest, PlaceTakenFromIsThatOfTheMessagesTimeWhenTheArmHasLiftedSince) {
  ASSERT_TRUE(waitUntil([this] {  // its first connection takes a while
    tellTip(taken_at_, 0.3);
    return hasTip(taken_at_);
  }));
  const ros::Time later = taken_at_ + ros::Duration(0.4);
  tellTip(later, 0.5);
  ASSERT_TRUE(waitUntil([&] { return hasTip(later); }));
  attach(taken_at_);
  EXPECT_NEAR(awaitPlace(), place_m_, 1e-9);
}

TEST_F(RobotStateTest, TakesFramesWithALeadingSlash) {
  slash_ = "/";
  ASSERT_TRUE(waitUntil([this] {
    tellTip(taken_at_, 0.3);
    return hasTip(taken_at_);
  }));
  std::string why_not;
  EXPECT_TRUE(robot_->frameInMap("/" + params_.map_frame, taken_at_, nullptr, &why_not)) << why_not;
  attach(taken_at_);
  EXPECT_NEAR(awaitPlace(), place_m_, 1e-9);
}

TEST_F(RobotStateTest, PlaceTakenFromIsFoundWhenTfComesLater) {
  ASSERT_TRUE(waitUntil([this] {
    tellTip(taken_at_ - ros::Duration(0.1), 0.3);
    return hasTip(taken_at_ - ros::Duration(0.1));
  }));
  attach(taken_at_);
  EXPECT_FALSE(robot_->held()->vacated) << "tf has nothing of that time";
  tellTip(taken_at_ + ros::Duration(0.1), 0.3);
  EXPECT_NEAR(awaitPlace(), place_m_, 1e-9);
}

TEST_F(RobotStateTest, LatchedMessageFromBeforeTfSaysNothingOfThePlace) {
  ASSERT_TRUE(waitUntil([this] {
    tellTip(taken_at_, 0.3);
    return hasTip(taken_at_);
  }));
  attach(taken_at_ - ros::Duration(60.0));
  EXPECT_FALSE(robot_->held()->vacated);
  // Nor does what comes after.
  tellTip(taken_at_ + ros::Duration(0.1), 0.3);
  ASSERT_TRUE(waitUntil([&] { return hasTip(taken_at_ + ros::Duration(0.1)); }));
  EXPECT_FALSE(robot_->held()->vacated);
  attached_.publish(AttachedBrick());
  EXPECT_TRUE(waitUntil([this] { return !robot_->held(); }));
}

TEST_F(RobotStateTest, WhatIsLetGoOverTheContainerLiesInIt) {
  const Eigen::Isometry3d T_base_place =
      arm_->robot().framePose(mp700_ur5e_description::kContainerPlaces[0], arm_->robotPositions(ArmVector::Zero()));
  Eigen::Isometry3d T_base_tip = T_base_place;  // it looks down, the brick's middle 0.1 m above it
  T_base_tip.translation().z() += 0.25;
  T_base_tip.rotate(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()));
  const ArmVector over_place = arm_->inverse(T_base_tip, ArmVector::Zero()).at(0);
  const auto letGo = [&](const ArmVector& joints_rad, bool is_driver_silent = false) {
    ASSERT_TRUE(waitUntil([&] {
      tellJoints(joints_rad);
      std::string why_not;
      const auto known = robot_->arm(&why_not);
      return known && known->isApprox(joints_rad);
    }));
    attach(ros::Time::now());
    std::string why_not;
    ASSERT_TRUE(!is_driver_silent || waitUntil([&] { return !robot_->arm(&why_not); }));
    attached_.publish(AttachedBrick());
    ASSERT_TRUE(waitUntil([this] { return !robot_->held(); }));
  };
  letGo(ArmVector::Zero());
  EXPECT_TRUE(robot_->load().empty()) << "it fell beside the robot";
  for (int i = 0; i < 2; ++i) {  // the second stands for the first, which somebody took out
    letGo(over_place);
    ASSERT_EQ(robot_->load().size(), 1u);
    EXPECT_LT((robot_->load()[0].T_base_brick.translation() - T_base_place.translation()).head<2>().norm(), 1e-5);
  }
  robot_->emptied();
  EXPECT_TRUE(robot_->load().empty());
  letGo(over_place, true);
  EXPECT_EQ(robot_->load().size(), 1u);
}

TEST_F(RobotStateTest, AnotherLoadOfAsManyBricksIsShown) {
  ros::NodeHandle private_nh("~");
  PlanningMarkers markers(private_nh, params_.map_frame, arm_, 1);
  double shown_z_m = 0.0;
  const ros::Subscriber load = private_nh.subscribe<visualization_msgs::MarkerArray>(
      "load", 5,
      [&](const visualization_msgs::MarkerArrayConstPtr& shown) { shown_z_m = shown->markers.back().pose.position.z; });
  motion_planning::LoadedBrick brick{Eigen::Isometry3d::Identity(), {0.2, 0.1, 0.05}};
  for (const double z_m : {0.3, 0.5}) {
    brick.T_base_brick.translation().z() = z_m;
    markers.showLoad({brick});
    EXPECT_TRUE(waitUntil([&] { return shown_z_m == z_m; })) << shown_z_m;
  }
}

}  // namespace
}  // namespace motion_planning_ros
