// SPDX-License-Identifier: BSD-3-Clause
#include "depth_camera/pose_guard.h"

#include <cmath>
#include <limits>

#include <gmock/gmock.h>

namespace depth_camera {
namespace {

using testing::HasSubstr;
using Verdict = PoseGuard::Verdict;

PoseLimits limits() {
  PoseLimits limits;
  limits.max_step_m = 0.1;
  limits.max_step_rad = 0.2;
  limits.max_speed_mps = 1.0;
  limits.max_turn_radps = 1.0;
  limits.settle_frames = 3;
  return limits;
}

Eigen::Isometry3d pose(double x_m, double yaw_rad = 0.0) {
  return Eigen::Translation3d(x_m, 0.0, 0.0) * Eigen::Isometry3d(Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()));
}

TEST(PoseGuard, BelievesTheFirstPoseAndWhatItCanHaveMovedTo) {
  PoseGuard guard(limits());
  EXPECT_EQ(guard.check(pose(5.0), 10.0), Verdict::kBelieved);
  EXPECT_EQ(guard.check(pose(5.59), 10.5), Verdict::kBelieved) << "0.1 m + 0.5 s * 1 m/s allow 0.6 m";
  EXPECT_EQ(guard.check(pose(5.59, 0.69), 11.0), Verdict::kBelieved) << "0.2 rad + 0.5 s * 1 rad/s allow 0.7 rad";
}

TEST(PoseGuard, RefusesOneWrongPoseAndGoesOn) {
  PoseGuard guard(limits());
  guard.check(pose(0.0), 0.0);
  EXPECT_EQ(guard.check(pose(0.21), 0.1), Verdict::kJump) << "0.2 m are allowed";
  EXPECT_THAT(guard.message(), AllOf(HasSubstr("0.210 m"), HasSubstr("0.200 m")));
  EXPECT_EQ(guard.check(pose(0.01), 0.2), Verdict::kBelieved);
  EXPECT_EQ(guard.check(pose(0.01, 0.51), 0.3), Verdict::kJump) << "0.3 rad are allowed";
}

TEST(PoseGuard, BelievesAJumpThatLasts) {
  PoseGuard guard(limits());
  guard.check(pose(0.0), 0.0);
  EXPECT_EQ(guard.check(pose(2.0), 0.1), Verdict::kJump);
  EXPECT_EQ(guard.check(pose(2.01), 0.2), Verdict::kJump);
  EXPECT_EQ(guard.check(pose(2.02), 0.3), Verdict::kSettled);
  EXPECT_EQ(guard.check(pose(2.03), 0.4), Verdict::kBelieved);
}

TEST(PoseGuard, DoesNotSettleOnPosesThatDisagree) {
  PoseGuard guard(limits());
  guard.check(pose(0.0), 0.0);
  for (int i = 1; i < 20; ++i) {
    EXPECT_EQ(guard.check(pose(i % 2 == 0 ? 3.0 : -3.0), 0.1 * i), Verdict::kJump) << i;
  }
}

TEST(PoseGuard, CountsAgreeingPosesAnewAfterAReturn) {
  PoseGuard guard(limits());
  guard.check(pose(0.0), 0.0);
  guard.check(pose(2.0), 0.1);
  guard.check(pose(2.0), 0.2);
  EXPECT_EQ(guard.check(pose(0.0), 0.3), Verdict::kBelieved);
  EXPECT_EQ(guard.check(pose(2.0), 0.4), Verdict::kJump);
  EXPECT_EQ(guard.check(pose(2.0), 0.5), Verdict::kJump);
  EXPECT_EQ(guard.check(pose(2.0), 0.6), Verdict::kSettled);
}

TEST(PoseGuard, NeverSettlesWhenToldSo) {
  PoseLimits never = limits();
  never.settle_frames = 0;
  PoseGuard guard(never);
  guard.check(pose(0.0), 0.0);
  // 100 frames in half a second: the bound of 0.1 m + 0.5 s * 1 m/s does not grow to 2 m.
  for (int i = 1; i <= 100; ++i) ASSERT_EQ(guard.check(pose(2.0), 0.005 * i), Verdict::kJump) << i;
}

TEST(PoseGuard, BelievesAnyPoseAfterReset) {
  PoseGuard guard(limits());
  guard.check(pose(0.0), 100.0);
  guard.reset();
  EXPECT_EQ(guard.check(pose(50.0, 2.0), 1.0), Verdict::kBelieved);
}

TEST(PoseLimits, NameEveryImpossibleValue) {
  EXPECT_TRUE(interactive_mapping::problemsOf(PoseLimits{}).empty());
  PoseLimits bad;
  bad.max_step_m = -0.1;
  bad.max_turn_radps = std::numeric_limits<double>::quiet_NaN();
  bad.settle_frames = -1;
  const auto problems = interactive_mapping::problemsOf(bad);
  ASSERT_EQ(problems.size(), 3u);
  EXPECT_THAT(problems[0], HasSubstr("max_step_m = -0.1 m, must be in [0, 1000] m"));
  EXPECT_THAT(problems[1], HasSubstr("max_turn_radps = nan rad/s"));
  EXPECT_THAT(problems[2], HasSubstr("settle_frames = -1"));
}

}  // namespace
}  // namespace depth_camera
