// SPDX-License-Identifier: BSD-3-Clause
#include "depth_self_filter/joint_history.h"

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/robots.h"

namespace depth_self_filter {
namespace {

using mp700_ur5e_description::kArmJoints;
using mp700_ur5e_description::RobotModel;
using test::shippedRobot;
using testing::HasSubstr;
using Verdict = JointHistory::Verdict;

const std::vector<std::string> kArm(kArmJoints.begin(), kArmJoints.end());

JointHistory history(const JointHistoryConfig& config = {}) {
  return JointHistory(shippedRobot(), config);
}

std::vector<double> all(double value) {
  return std::vector<double>(kArm.size(), value);
}

double positionOf(const JointHistory::Answer& answer, const std::string& joint) {
  static const auto kRobot = shippedRobot();
  return answer.positions_rad[static_cast<Eigen::Index>(kRobot->jointIndex(joint))];
}

TEST(JointHistory, InterpolatesBetweenTheStatesAboutTheStamp) {
  JointHistory joints = history();
  // A straight line in each joint: what comes back at any stamp is on it.
  for (int i = 0; i <= 40; ++i) {
    const double t = 100.0 + 0.05 * i + 0.01 * std::sin(i);
    std::vector<double> q;
    for (std::size_t j = 0; j < kArm.size(); ++j) q.push_back(0.3 * static_cast<double>(j) - 0.5 + (t - 101.0) * 0.7);
    EXPECT_EQ(joints.add(t, kArm, q), "");
  }
  for (double t = 100.01; t < 101.9; t += 0.0137) {
    const JointHistory::Answer answer = joints.at(t);
    ASSERT_EQ(answer.verdict, Verdict::kKnown) << answer.message;
    for (std::size_t j = 0; j < kArm.size(); ++j) {
      EXPECT_NEAR(positionOf(answer, kArm[j]), 0.3 * static_cast<double>(j) - 0.5 + (t - 101.0) * 0.7, 1e-12);
    }
  }
}

TEST(JointHistory, TakesJointsInAnyOrderAndInSeveralMessages) {
  JointHistory joints = history();
  // The arm's driver tells them by name, elbow first; a gripper's joint is in between.
  const std::vector<std::string> some = {"elbow_joint", "finger_joint", "shoulder_lift_joint", "shoulder_pan_joint"};
  const std::vector<std::string> wrist = {"wrist_3_joint", "wrist_1_joint", "wrist_2_joint"};
  EXPECT_EQ(joints.add(10.0, some, {3.0, 99.0, 2.0, 1.0}), "");
  EXPECT_EQ(joints.at(10.0).verdict, Verdict::kNeverHeard);
  EXPECT_THAT(joints.at(10.0).message, HasSubstr("wrist_1_joint, wrist_2_joint, wrist_3_joint"));
  EXPECT_EQ(joints.add(10.0, wrist, {6.0, 4.0, 5.0}), "");
  const JointHistory::Answer answer = joints.at(10.0);
  ASSERT_EQ(answer.verdict, Verdict::kKnown) << answer.message;
  for (std::size_t j = 0; j < kArm.size(); ++j) EXPECT_EQ(positionOf(answer, kArm[j]), 1.0 + static_cast<double>(j));
}

TEST(JointHistory, WheelsNeedNotComeAndDoNotCount) {
  JointHistory joints = history();
  joints.add(10.0, {"wheel_front_left_joint", "wheel_front_right_joint"}, {1e4, std::nan("")});
  EXPECT_EQ(joints.at(10.0).verdict, Verdict::kNeverHeard);
  joints.add(10.0, kArm, all(0.5));
  const JointHistory::Answer answer = joints.at(10.0);
  EXPECT_EQ(answer.verdict, Verdict::kKnown);
  EXPECT_EQ(positionOf(answer, "wheel_front_left_joint"), 0.0);
}

TEST(JointHistory, AStampAfterTheNewestStateWaits) {
  JointHistory joints = history();
  joints.add(10.00, kArm, all(0.0));
  joints.add(10.05, kArm, all(1.0));
  EXPECT_EQ(joints.at(10.05).verdict, Verdict::kKnown);
  const JointHistory::Answer answer = joints.at(10.055);
  EXPECT_EQ(answer.verdict, Verdict::kNotYet);
  EXPECT_THAT(answer.message, HasSubstr("is 0.005 s before the image"));
  // One joint of six that is late is late.
  joints.add(10.10, {kArm.begin(), kArm.begin() + 5}, std::vector<double>(5, 2.0));
  EXPECT_EQ(joints.at(10.08).verdict, Verdict::kNotYet);
  EXPECT_THAT(joints.at(10.08).message, HasSubstr("wrist_3_joint"));
  joints.add(10.10, {"wrist_3_joint"}, {2.0});
  EXPECT_NEAR(positionOf(joints.at(10.08), "wrist_3_joint"), 1.6, 1e-12);
}

TEST(JointHistory, AGapIsNotBridged) {
  JointHistory joints = history();
  joints.add(10.00, kArm, all(0.0));
  joints.add(10.11, kArm, all(1.0));  // 10 ms more than allowed
  joints.add(10.20, kArm, all(2.0));
  EXPECT_EQ(joints.at(10.05).verdict, Verdict::kGap);
  EXPECT_THAT(joints.at(10.05).message, HasSubstr("0.110000 s apart, must be at most 0.100000 s (max_gap_s)"));
  EXPECT_EQ(joints.at(10.00).verdict, Verdict::kKnown);  // a state of that very time
  EXPECT_EQ(joints.at(10.15).verdict, Verdict::kKnown);
}

// Seconds since 1970 as a double: 0.1 s apart is 0.0999999 or 0.1000001.
TEST(JointHistory, AGapOfExactlyWhatIsAllowedIsBridgedWhateverTheClock) {
  for (int tenth = 0; tenth < 10; ++tenth) {
    JointHistory joints = history();
    joints.add(1.7e9 + 0.1 * tenth, kArm, all(0.0));
    joints.add(1.7e9 + 0.1 * (tenth + 1), kArm, all(1.0));
    const JointHistory::Answer answer = joints.at(1.7e9 + 0.1 * tenth + 0.05);
    EXPECT_EQ(answer.verdict, Verdict::kKnown) << answer.message;
  }
}

TEST(JointHistory, AGapThatIsALittleTooLongShowsItsDigits) {
  JointHistory joints = history();
  joints.add(10.0, kArm, all(0.0));
  joints.add(10.10002, kArm, all(1.0));
  EXPECT_THAT(joints.at(10.05).message, HasSubstr("0.100020 s apart, must be at most 0.100000 s"));
}

TEST(JointHistory, AStampBeforeAllThatIsRememberedIsForgotten) {
  JointHistoryConfig config;
  config.memory_s = 1.0;
  JointHistory joints = history(config);
  for (int i = 0; i <= 40; ++i) joints.add(10.0 + 0.05 * i, kArm, all(i));
  EXPECT_EQ(joints.at(11.5).verdict, Verdict::kKnown);
  EXPECT_EQ(joints.at(10.9).verdict, Verdict::kForgotten);
  EXPECT_THAT(joints.at(10.9).message, HasSubstr("after the image, must be at or before it"));
}

TEST(JointHistory, TimeThatRunsBackBeginsAnew) {
  JointHistory joints = history();
  for (int i = 0; i <= 20; ++i) joints.add(100.0 + 0.05 * i, kArm, all(1.0));
  joints.add(100.5, kArm, all(9.0));  // out of order: left out
  EXPECT_EQ(positionOf(joints.at(100.5), "elbow_joint"), 1.0);
  joints.add(10.0, kArm, all(5.0));
  EXPECT_EQ(joints.at(100.5).verdict, Verdict::kNotYet);
  ASSERT_EQ(joints.at(10.0).verdict, Verdict::kKnown);
  EXPECT_EQ(positionOf(joints.at(10.0), "elbow_joint"), 5.0);
}

TEST(JointHistory, StatesThatSayNothingAreLeftOutAsAWhole) {
  JointHistory joints = history();
  joints.add(10.00, kArm, all(0.0));
  std::vector<double> bad = all(1.0);
  bad[2] = std::nan("");
  EXPECT_THAT(joints.add(10.05, kArm, bad), HasSubstr("joint elbow_joint is at nan rad"));
  bad[2] = std::numeric_limits<double>::infinity();
  EXPECT_THAT(joints.add(10.05, kArm, bad), HasSubstr("elbow_joint"));
  EXPECT_THAT(joints.add(10.05, kArm, {1.0}), HasSubstr("6 names and 1 positions"));
  EXPECT_THAT(joints.add(0.0, kArm, all(1.0)), HasSubstr("must be > 0 s"));
  EXPECT_THAT(joints.add(std::nan(""), kArm, all(1.0)), HasSubstr("must be > 0 s"));
  EXPECT_EQ(joints.at(10.05).verdict, Verdict::kNotYet);
  joints.add(10.10, kArm, all(2.0));
  EXPECT_NEAR(positionOf(joints.at(10.05), "elbow_joint"), 1.0, 1e-12);  // between what is known
}

TEST(JointHistory, AnEndlessJointTakesTheShorterWay) {
  const auto robot = RobotModel::parse(
      "<robot name='r'><link name='a'/><link name='b'><collision><geometry><box size='1 1 1'/></geometry></collision>"
      "</link><joint name='j' type='continuous'><parent link='a'/><child link='b'/><axis xyz='0 0 1'/></joint></robot>",
      "r");
  JointHistory joints(robot, {});
  joints.add(10.0, {"j"}, {M_PI - 0.1});
  joints.add(10.1, {"j"}, {-M_PI + 0.1});
  EXPECT_NEAR(std::remainder(joints.at(10.05).positions_rad[0] - M_PI, 2.0 * M_PI), 0.0, 1e-9);
  // An arm's joint has ends, and knows its turns.
  JointHistory arm = history();
  arm.add(10.0, kArm, all(M_PI - 0.1));
  arm.add(10.1, kArm, all(-M_PI + 0.1));
  EXPECT_NEAR(positionOf(arm.at(10.05), "wrist_3_joint"), 0.0, 1e-9);
}

TEST(JointHistory, ImpossibleConfigurationsAreRefused) {
  JointHistoryConfig config;
  config.max_gap_s = -1.0;
  config.memory_s = std::nan("");
  EXPECT_THAT(
      interactive_mapping::problemsOf(config),
      testing::ElementsAre("max_gap_s = -1 s, must be in [0, 10] s", "memory_s = nan s, must be in [0.1, 600] s"));
  EXPECT_THROW(history(config), std::invalid_argument);
}

}  // namespace
}  // namespace depth_self_filter
