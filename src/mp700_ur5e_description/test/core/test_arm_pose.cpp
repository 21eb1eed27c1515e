// SPDX-License-Identifier: BSD-3-Clause
#include "mp700_ur5e_description/arm_pose.h"

#include <stdexcept>

#include <gtest/gtest.h>

namespace mp700_ur5e_description {
namespace {

const std::string kInAnotherOrder =
    "{wrist_3_joint: 6, shoulder_pan_joint: 1, elbow_joint: 3, wrist_1_joint: 4, shoulder_lift_joint: 2, "
    "wrist_2_joint: 5}\n";

TEST(ArmPose, IsInTheControllersOrderWhateverTheFiles) {
  ArmPose expected;
  expected << 1, 2, 3, 4, 5, 6;
  EXPECT_EQ(parseArmPose(kInAnotherOrder, "test"), expected);
}

TEST(ArmPose, RefusesMissingUnknownAndImpossibleJoints) {
  std::string text = kInAnotherOrder;
  text.replace(text.find("wrist_3_joint"), 13, "wrist_4_joint");
  text.replace(text.find(": 3"), 3, ": 300");
  try {
    parseArmPose(text, "test");
    FAIL() << "accepted: " << text;
  } catch (const std::invalid_argument& error) {
    const std::string message = error.what();
    EXPECT_NE(message.find("test: wrist_3_joint = (missing)"), std::string::npos) << message;
    EXPECT_NE(message.find("test: wrist_4_joint is unknown"), std::string::npos) << message;
    EXPECT_NE(message.find("test: elbow_joint = 300, must be a number in [-6.2832, 6.2832] rad"), std::string::npos)
        << message;
  }
}

}  // namespace
}  // namespace mp700_ur5e_description
