// SPDX-License-Identifier: BSD-3-Clause
#include "system_diagnostics/tree_watch.h"

#include <limits>
#include <stdexcept>

#include <gmock/gmock.h>

namespace system_diagnostics {
namespace {

using testing::AllOf;
using testing::HasSubstr;

TEST(TreeWatch, OnePublisherOfEachFrameIsAllRight) {
  TreeWatch tree(10.0);
  for (double now_s = 0.0; now_s < 5.0; now_s += 0.1) {
    tree.add(now_s, "map", "odom", "/localisation", false);
    tree.add(now_s, "odom", "base_link", "/kinematics", false);
  }
  tree.add(5.0, "base_link", "camera_link", "/robot_state_publisher", true);
  EXPECT_EQ(tree.report(5.0).level, Level::kOk) << tree.report(5.0).message;
  EXPECT_EQ(tree.edges(), 3);
}

TEST(TreeWatch, TwoPublishersOfAFrameAreAnErrorThatNamesThem) {
  TreeWatch tree(10.0);
  tree.add(0.0, "odom", "base_link", "/kinematics", false);
  tree.add(0.1, "odom", "base_link", "/visual_odometry", false);
  EXPECT_EQ(tree.report(0.1).level, Level::kError);
  EXPECT_THAT(tree.report(0.1).message,
              AllOf(HasSubstr("frame base_link"), HasSubstr("/kinematics"), HasSubstr("/visual_odometry")));
}

TEST(TreeWatch, TwoParentsOfAFrameAreAnErrorEvenFromOneNode) {
  TreeWatch tree(10.0);
  tree.add(0.0, "odom", "base_link", "/driver", false);
  tree.add(0.1, "map", "base_link", "/driver", false);
  EXPECT_EQ(tree.report(0.1).level, Level::kError);
}

TEST(TreeWatch, APublisherThatHasGoneIsForgotten) {
  TreeWatch tree(10.0);
  tree.add(0.0, "map", "odom", "/amcl", false);
  tree.add(1.0, "map", "odom", "/neo_localization", false);
  EXPECT_EQ(tree.report(9.0).level, Level::kError);
  tree.add(10.5, "map", "odom", "/neo_localization", false);
  EXPECT_EQ(tree.report(10.5).level, Level::kOk);
}

TEST(TreeWatch, TwoStaticOnesAreAWarningAndAStaticBesideAMovingOneAnError) {
  TreeWatch tree(10.0);
  tree.add(0.0, "base_link", "camera_link", "/robot_state_publisher", true);
  tree.add(0.0, "base_link", "camera_link", "/camera", true);
  EXPECT_EQ(tree.report(1000.0).level, Level::kWarning);
  tree.add(1000.0, "map", "odom", "/nothing_corrects_odometry", true);
  tree.add(1000.0, "map", "odom", "/amcl", false);
  EXPECT_EQ(tree.report(1000.0).level, Level::kError);
}

TEST(TreeWatch, AnImpossibleWindowIsRefused) {
  EXPECT_THROW(TreeWatch(0.0), std::invalid_argument);
  EXPECT_THROW(TreeWatch(std::numeric_limits<double>::quiet_NaN()), std::invalid_argument);
}

}  // namespace
}  // namespace system_diagnostics
