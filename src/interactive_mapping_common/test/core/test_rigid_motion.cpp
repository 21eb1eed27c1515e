// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common/geometry/rigid_motion.h>

#include <limits>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

namespace interactive_mapping {
namespace {

using ::testing::HasSubstr;

std::string refusalOf(const Eigen::Isometry3d& pose) {
  return test_support::messageOf<std::invalid_argument>([&] { requireRigid(pose, "pose of the box"); });
}

TEST(RigidMotion, HoldsForTurnsAndShiftsInFloats) {
  Eigen::Isometry3d pose(Eigen::AngleAxisd(2.5, Eigen::Vector3d(1.0, 2.0, 3.0).normalized()));
  pose.translation() << 1.0, -2.0, 3.0;
  EXPECT_EQ(refusalOf(pose.cast<float>().cast<double>()), "");
  EXPECT_FALSE(isRigid(pose.cast<float>().cast<double>(), 1e-9));
}

TEST(RigidMotion, OthersAreNamed) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation().x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(refusalOf(pose), "pose of the box is not finite");
  pose = Eigen::Isometry3d::Identity();
  pose.linear()(0, 0) = -1.0;  // a mirror
  EXPECT_THAT(refusalOf(pose), HasSubstr("pose of the box is no rigid motion"));
  pose.linear() = 1.0001 * Eigen::Matrix3d::Identity();
  EXPECT_THAT(refusalOf(pose), HasSubstr("by 0.000346"));
  pose = Eigen::Isometry3d::Identity();
  pose.matrix()(3, 0) = 0.5;  // no isometry, though the type says so
  EXPECT_FALSE(isRigid(pose));
}

}  // namespace
}  // namespace interactive_mapping
