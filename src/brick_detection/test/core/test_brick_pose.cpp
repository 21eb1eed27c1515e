// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/brick_pose.h"

#include <cmath>
#include <limits>

#include <gmock/gmock.h>

#include "support/brick_scene.h"

namespace brick_detection {
namespace {

using mp700_ur5e_description::BrickFace;
using testing::Each;
using testing::ElementsAre;
using testing::Field;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

class BrickPose : public testing::Test {
 protected:
  std::vector<TagStatus> statusOf(const BrickPoseEstimator::Result& result) const {
    std::vector<TagStatus> status;
    for (const TagSighting& tag : result.tags) status.push_back(tag.status);
    return status;
  }

  /// Lying before the camera with three faces in view.
  Eigen::Isometry3d corner(const Eigen::Vector3d& p_camera) const {
    return Eigen::Translation3d(p_camera) * Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitX()) *
           Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitY()) *
           Eigen::Isometry3d(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()));
  }

  /// Its +z face against the camera, tilted.
  Eigen::Isometry3d facing(const Eigen::Vector3d& p_camera, double tilt_rad = 0.0, double about_rad = 0.3) const {
    const Eigen::Vector3d axis(std::cos(about_rad), std::sin(about_rad), 0.0);
    return Eigen::Translation3d(p_camera) * Eigen::AngleAxisd(tilt_rad, axis) *
           Eigen::Isometry3d(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()));
  }

  CameraModel camera_ = testCamera();
  mp700_ur5e_description::BrickCatalogue catalogue_ = testCatalogue();
  Eigen::Vector3d size_m_ = catalogue_.types.front().size_m;
  BrickPoseEstimator estimator_{catalogue_, BrickPoseConfig()};
  cv::Mat no_depth_;
};

TEST_F(BrickPose, IsExactForExactCornersOfAnyFacesInAnyPose) {
  std::mt19937 engine(5);
  std::uniform_real_distribution<double> side(-0.3, 0.3);
  std::uniform_real_distribution<double> away(0.6, 2.5);
  int num_used = 0;
  for (int i = 0; i < 300; ++i) {
    const double z = away(engine);
    const Eigen::Isometry3d truth =
        Eigen::Translation3d(side(engine) * z, side(engine) * z, z) * Eigen::Isometry3d(anyRotation(engine));
    const auto result = estimator_.estimate(observeBrick(catalogue_, 7, truth, camera_), camera_, no_depth_);
    if (result.bricks.empty()) {
      EXPECT_THAT(statusOf(result), Each(testing::AnyOf(TagStatus::kAmbiguous, TagStatus::kTooSmall)));
      continue;
    }
    ASSERT_THAT(result.bricks, SizeIs(1));
    ++num_used;
    EXPECT_EQ(result.bricks[0].brick_id, 7);
    EXPECT_LT(stepBetween(truth, result.bricks[0].T_camera_brick).norm(), 1e-6);
    EXPECT_LT(result.bricks[0].reprojection_rms_px, 1e-6);
    EXPECT_FALSE(result.bricks[0].has_depth);
    EXPECT_FALSE(result.bricks[0].has_duplicate);
  }
  EXPECT_GT(num_used, 240) << "most poses show several faces, or one from the side";
}

}  // namespace
}  // namespace brick_detection
