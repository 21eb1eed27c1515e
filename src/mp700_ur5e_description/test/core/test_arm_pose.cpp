// SPDX-License-Identifier: BSD-3-Clause
#include "mp700_ur5e_description/arm_pose.h"

#include <stdexcept>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

namespace mp700_ur5e_description {
namespace {

using test_support::messageOf;
using ::testing::AllOf;
using ::testing::HasSubstr;

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
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { parseArmPose(text, "test"); }),
              AllOf(HasSubstr("test: wrist_3_joint = (missing)"), HasSubstr("test: wrist_4_joint is unknown"),
                    HasSubstr("test: elbow_joint = 300, must be a number in [-6.2832, 6.2832] rad")));
}

}  // namespace
}  // namespace mp700_ur5e_description
