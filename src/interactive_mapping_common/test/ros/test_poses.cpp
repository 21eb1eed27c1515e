// SPDX-License-Identifier: BSD-3-Clause
#include "interactive_mapping_common_ros/poses.h"

#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include <gmock/gmock.h>

namespace interactive_mapping_ros {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

TEST(Poses, PoseGoesRoundTrip) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() << 1.0, -2.0, 0.5;
  T.rotate(Eigen::AngleAxisd(2.5, Eigen::Vector3d(1.0, 2.0, -0.5).normalized()));
  const std::optional<Eigen::Isometry3d> back = toIsometry(toPose(T));
  ASSERT_TRUE(back);
  EXPECT_TRUE(back->isApprox(T, 1e-12));
}

TEST(Poses, PoseThatIsNoneIsRefused) {
  geometry_msgs::Pose pose;  // a message that nobody has filled: quaternion of length 0
  EXPECT_FALSE(toIsometry(pose));
  pose.orientation.w = 1.0;
  EXPECT_TRUE(toIsometry(pose));
  pose.orientation.w = 1.02;  // beyond the 1 % that float32 sources never reach
  EXPECT_FALSE(toIsometry(pose));
  pose.orientation.w = kNaN;
  EXPECT_FALSE(toIsometry(pose));
  pose.orientation.w = 1.0;
  pose.position.y = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(toIsometry(pose));
}

TEST(Poses, AreReadAsTransformsAre) {
  geometry_msgs::Pose pose;
  pose.position.x = 1.0;
  pose.position.y = -2.0;
  pose.position.z = 0.5;
  const Eigen::Quaterniond q(Eigen::AngleAxisd(2.5, Eigen::Vector3d(1.0, 2.0, -0.5).normalized()));
  pose.orientation.w = q.w();
  pose.orientation.x = q.x();
  pose.orientation.y = q.y();
  pose.orientation.z = q.z();
  const auto T = toIsometry(pose);
  ASSERT_TRUE(T);
  EXPECT_LT((T->linear() - q.toRotationMatrix()).norm(), 1e-12);
  EXPECT_EQ(T->translation(), Eigen::Vector3d(1.0, -2.0, 0.5));
  std::string reason;
  pose.position.y = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(toIsometry(pose, &reason));
  EXPECT_THAT(reason, testing::HasSubstr("pose is not finite or no rotation"));
  pose.position.y = 0.0;
  for (const double length : {1.009, 0.991, 1.02, 0.98}) {
    pose.orientation.w = pose.orientation.x = pose.orientation.y = 0.0;
    pose.orientation.z = length;
    const auto stretched = toIsometry(pose);
    EXPECT_EQ(stretched.has_value(), std::abs(length - 1.0) < 0.01) << length;
    if (stretched) {
      EXPECT_NEAR(stretched->linear().determinant(), 1.0, 1e-12);
    }
  }
}

TEST(Poses, FrameNamesLoseTheirLeadingSlash) {
  EXPECT_EQ(withoutSlash("/map"), "map");
  EXPECT_EQ(withoutSlash("map"), "map");
  EXPECT_EQ(withoutSlash(""), "");
}

}  // namespace
}  // namespace interactive_mapping_ros
