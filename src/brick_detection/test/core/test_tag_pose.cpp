// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <limits>

#include <gmock/gmock.h>

#include "brick_detection/brick_pose.h"
#include "support/brick_scene.h"

namespace brick_detection {
namespace {

constexpr double kEdge_m = 0.12;

/// Tag before the camera, its printed side tilted away from it about an axis in the tag's plane.
Eigen::Isometry3d tagAt(const Eigen::Vector3d& p_camera, double tilt_rad, double about_rad, double spin_rad = 0.0) {
  // Tag's z against the view, y up: camera's x is right, y down.
  const Eigen::Quaterniond facing(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()));
  const Eigen::Vector3d axis(std::cos(about_rad), std::sin(about_rad), 0.0);
  return Eigen::Translation3d(p_camera) * Eigen::AngleAxisd(tilt_rad, axis) * facing *
         Eigen::Isometry3d(Eigen::AngleAxisd(spin_rad, Eigen::Vector3d::UnitZ()));
}

std::vector<CameraModel> cameras() {
  CameraModel plumb_bob = testCamera();
  plumb_bob.distortion = Distortion::kPlumbBob;
  plumb_bob.coefficients = {0.08, -0.15, 0.001, -0.0008, 0.05};
  CameraModel fisheye = testCamera();
  fisheye.distortion = Distortion::kEquidistant;
  fisheye.coefficients = {-0.02, 0.01, -0.003, 0.0005};
  return {testCamera(), plumb_bob, fisheye};
}

TEST(TagPoses, FindsThePoseOfExactCornersAtAnyDistanceAndTilt) {
  for (const CameraModel& camera : cameras()) {
    for (const double distance_m : {0.5, 1.0, 2.0, 3.0}) {
      for (const double tilt_deg : {0.0, 1.0, 10.0, 30.0, 50.0, 70.0}) {
        for (const double about_rad : {0.0, 0.7, 2.1, 4.0}) {
          const Eigen::Vector3d p_camera = distance_m * Eigen::Vector3d(0.18, -0.12, 1.0);
          const Eigen::Isometry3d truth = tagAt(p_camera, tilt_deg * M_PI / 180.0, about_rad, 0.4);
          const std::vector<TagPose> poses = tagPoses(observe(0, kEdge_m, truth, camera).corners_px, kEdge_m, camera);
          ASSERT_FALSE(poses.empty());
          // Lens models are inverted by iteration to 1e-9 or so, and a small tag magnifies it.
          const double tolerance = camera.distortion == Distortion::kNone ? 1e-6 : 1e-4;
          EXPECT_LT(stepBetween(truth, poses[0].T_camera_tag).norm(), tolerance)
              << distance_m << " m, " << tilt_deg << " deg about " << about_rad;
          EXPECT_LT(poses[0].reprojection_rms_px, 1e-4);
        }
      }
    }
  }
}

TEST(TagPoses, GivesTheMirroredPoseAsWell) {
  // Seen from afar, a square tilted one way is seen as one tilted the other way: about the line of sight, the normals
  // are mirror images.
  const Eigen::Isometry3d truth = tagAt({0.0, 0.0, 3.0}, 0.4, 0.3);
  const CameraModel camera = testCamera();
  const std::vector<TagPose> poses = tagPoses(observe(0, kEdge_m, truth, camera).corners_px, kEdge_m, camera);
  ASSERT_EQ(poses.size(), 2u);
  const Eigen::Vector3d mirrored = tagAt({0.0, 0.0, 3.0}, -0.4, 0.3).linear().col(2);
  // Perspective moves the minimum by about edge / distance = 0.04 rad.
  EXPECT_LT(std::acos(poses[1].T_camera_tag.linear().col(2).dot(mirrored)), 0.04);
  EXPECT_GT(poses[1].reprojection_rms_px, poses[0].reprojection_rms_px);
}

TEST(TagPoses, SaysNothingOfCornersThatAreNoPrintedSquare) {
  const CameraModel camera = testCamera();
  const auto good = observe(0, kEdge_m, tagAt({0.0, 0.0, 1.0}, 0.4, 0.3), camera).corners_px;
  const auto isRefused = [&](const std::array<Eigen::Vector2d, 4>& corners) {
    return tagPoses(corners, kEdge_m, camera).empty();
  };
  ASSERT_FALSE(isRefused(good));
  EXPECT_TRUE(isRefused({good[3], good[2], good[1], good[0]})) << "mirrored: the print seen from behind";
  EXPECT_TRUE(isRefused({good[0], good[2], good[1], good[3]})) << "a bow tie";
  EXPECT_TRUE(isRefused({good[0], good[0], good[0], good[0]})) << "a point";
  EXPECT_TRUE(isRefused({good[0], good[1], good[1], good[0]})) << "a line";
  EXPECT_TRUE(isRefused({good[0], good[1], 0.5 * (good[1] + good[3]), good[3]})) << "a triangle";
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    auto corners = good;
    corners[2].y() = bad;
    EXPECT_TRUE(isRefused(corners)) << bad;
  }
}

TEST(TagPoses, RefusesAnImpossibleEdge) {
  const auto corners = observe(0, kEdge_m, tagAt({0.0, 0.0, 1.0}, 0.4, 0.3), testCamera()).corners_px;
  for (const double bad : {0.0, -0.1, std::nan(""), std::numeric_limits<double>::infinity()}) {
    EXPECT_THROW(tagPoses(corners, bad, testCamera()), std::invalid_argument) << bad;
  }
}

TEST(TagPoses, SurvivesAnyCorners) {
  std::mt19937 engine(3);
  std::uniform_real_distribution<double> pixel(-1000.0, 1000.0);
  for (const CameraModel& camera : cameras()) {
    for (int i = 0; i < 2000; ++i) {
      std::array<Eigen::Vector2d, 4> corners;
      for (Eigen::Vector2d& corner : corners) corner = {pixel(engine), pixel(engine)};
      for (const TagPose& pose : tagPoses(corners, kEdge_m, camera)) {
        ASSERT_TRUE(pose.T_camera_tag.matrix().allFinite());
        ASSERT_NEAR(pose.T_camera_tag.linear().determinant(), 1.0, 1e-9);
        ASSERT_GT(pose.T_camera_tag.translation().z(), 0.0);
      }
    }
  }
}

}  // namespace
}  // namespace brick_detection
