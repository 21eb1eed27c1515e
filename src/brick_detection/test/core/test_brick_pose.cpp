// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/brick_pose.h"

#include <cmath>
#include <functional>
#include <limits>

#include <gmock/gmock.h>
#include <opencv2/core.hpp>

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


TEST_F(BrickPose, MovesWithTheCamera) {
  // The same view turned about the optical axis by a right angle: a square image, and pixels that stay what they are.
  CameraModel camera = camera_;
  camera.width_px = camera.height_px = 601;
  camera.cx_px = camera.cy_px = 300.0;
  camera.fy_px = camera.fx_px;
  const Eigen::Isometry3d T_turned_camera = makePose({0, 0, 0}, {0, 0, M_PI / 2.0});
  std::mt19937 engine(21);
  const Eigen::Isometry3d truth = corner({0.1, -0.05, 1.3});
  std::vector<TagObservation> tags = observeBrick(catalogue_, 3, truth, camera);
  addCornerNoise(0.3, engine, &tags);
  const cv::Mat depth_m = depthImage({truth}, size_m_, camera);
  std::vector<TagObservation> turned_tags = tags;
  for (TagObservation& tag : turned_tags) {
    for (Eigen::Vector2d& pixel : tag.corners_px) pixel = Eigen::Vector2d(600.0 - pixel.y(), pixel.x());
  }
  cv::Mat turned_depth_m;
  cv::rotate(depth_m, turned_depth_m, cv::ROTATE_90_CLOCKWISE);

  const auto plain = estimator_.estimate(tags, camera, depth_m);
  const auto turned = estimator_.estimate(turned_tags, camera, turned_depth_m);
  ASSERT_THAT(plain.bricks, SizeIs(1));
  ASSERT_THAT(turned.bricks, SizeIs(1));
  ASSERT_TRUE(plain.bricks[0].has_depth);
  // Depth draws other samples when its pixels come in another order: the planes' inliers, and so the poses, agree to a
  // part of their uncertainty only.
  const Vector6d off =
      stepBetween(T_turned_camera * plain.bricks[0].T_camera_brick, turned.bricks[0].T_camera_brick);
  EXPECT_LT(off.dot(turned.bricks[0].covariance.ldlt().solve(off)), 0.01);
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = T_turned_camera.linear();
  const Matrix6d expected = turn * plain.bricks[0].covariance * turn.transpose();
  EXPECT_LT((expected - turned.bricks[0].covariance).norm(), 0.02 * expected.norm());

  // Without depth nothing is drawn.
  const auto plain_colour = estimator_.estimate(tags, camera, no_depth_);
  const auto turned_colour = estimator_.estimate(turned_tags, camera, no_depth_);
  ASSERT_THAT(turned_colour.bricks, SizeIs(1));
  EXPECT_TRUE(turned_colour.bricks[0].T_camera_brick.isApprox(T_turned_camera * plain_colour.bricks[0].T_camera_brick,
                                                              1e-6));
}

TEST_F(BrickPose, EachFurtherTagMakesThePoseBetter) {
  const Eigen::Isometry3d truth = corner({0.0, 0.0, 1.3});
  const std::vector<TagObservation> exact = observeBrick(catalogue_, 0, truth, camera_, 0.3);
  ASSERT_THAT(exact, SizeIs(3));
  std::mt19937 engine(8);
  std::array<double, 4> error_m{};
  std::array<double, 4> claimed_m{};
  constexpr int kTrials = 100;
  for (int i = 0; i < kTrials; ++i) {
    std::vector<TagObservation> tags = exact;
    addCornerNoise(estimator_.config().corner_std_px, engine, &tags);
    for (std::size_t num = 1; num <= 3; ++num) {
      const auto result = estimator_.estimate({tags.begin(), tags.begin() + num}, camera_, no_depth_);
      ASSERT_THAT(result.bricks, SizeIs(1)) << num;
      EXPECT_THAT(result.bricks[0].faces, SizeIs(num));
      error_m[num] += (result.bricks[0].T_camera_brick.translation() - truth.translation()).squaredNorm() / kTrials;
      claimed_m[num] += result.bricks[0].covariance.topLeftCorner<3, 3>().trace() / kTrials;
    }
  }
  // Of independent equal tags two have half the variance; they see the brick from several sides, so it is less still.
  EXPECT_LT(error_m[2], 0.5 * error_m[1]);
  EXPECT_LT(error_m[3], error_m[2]);
  EXPECT_LT(claimed_m[2], 0.5 * claimed_m[1]);
  EXPECT_LT(claimed_m[3], claimed_m[2]);
}

/// Pose errors over noisy looks, normalised by the covariance.
struct Campaign {
  double mean_normalised{0.0};
  double rms_m{0.0};
  double rms_rad{0.0};
  int num_wrong{0};  ///< beyond chi-square 40: one in two million by chance
  int num_poses{0};
};

class NoisyBrickPose : public BrickPose {
 protected:
  Campaign look(const std::function<Eigen::Isometry3d(std::mt19937*)>& draw, bool has_depth, int num_trials,
                double least_facing = 0.25) const {
    const BrickPoseConfig& config = estimator_.config();
    std::mt19937 engine(17);
    std::normal_distribution<double> normal;
    Campaign campaign;
    for (int i = 0; i < num_trials; ++i) {
      const Eigen::Isometry3d truth = draw(&engine);
      std::vector<TagObservation> tags = observeBrick(catalogue_, 0, truth, camera_, least_facing);
      addCornerNoise(config.corner_std_px, engine, &tags);
      cv::Mat depth_m;
      if (has_depth) {
        depth_m = depthOf(truth);
        addDepthNoise(config.depth.inverse_depth_std, static_cast<int>(config.depth.correlation_px),
                      1.0 + config.depth.systematic_m * normal(engine), engine, &depth_m);
      }
      const auto result = estimator_.estimate(tags, camera_, depth_m);
      if (result.bricks.empty()) continue;
      ++campaign.num_poses;
      const BrickSighting& brick = result.bricks.front();
      const Vector6d off = stepBetween(brick.T_camera_brick, truth);
      const double normalised = off.dot(brick.covariance.ldlt().solve(off));
      campaign.num_wrong += normalised > 40.0 ? 1 : 0;
      campaign.mean_normalised += normalised;
      campaign.rms_m += off.head<3>().squaredNorm();
      campaign.rms_rad += off.tail<3>().squaredNorm();
    }
    campaign.mean_normalised /= campaign.num_poses;
    campaign.rms_m = std::sqrt(campaign.rms_m / campaign.num_poses);
    campaign.rms_rad = std::sqrt(campaign.rms_rad / campaign.num_poses);
    std::printf("XX nees %g rms %g m %g rad wrong %d of %d of %d\n", campaign.mean_normalised, campaign.rms_m, campaign.rms_rad,
       campaign.num_wrong, campaign.num_poses, num_trials);
    return campaign;
  }

  /// Depth round the brick alone: to render the whole image takes its time.
  cv::Mat depthOf(const Eigen::Isometry3d& T_camera_brick) const {
    cv::Mat depth_m(camera_.height_px, camera_.width_px, CV_32FC1, cv::Scalar(0.0f));
    const Eigen::Vector2d middle_px = camera_.project(T_camera_brick.translation());
    const double reach_px = 0.5 * size_m_.norm() * camera_.fx_px / (T_camera_brick.translation().z() - 0.2);
    const cv::Rect all(0, 0, camera_.width_px, camera_.height_px);
    const cv::Rect box = all & cv::Rect(static_cast<int>(middle_px.x() - reach_px),
                                        static_cast<int>(middle_px.y() - reach_px),
                                        static_cast<int>(2.0 * reach_px), static_cast<int>(2.0 * reach_px));
    for (int v = box.y; v < box.br().y; ++v) {
      for (int u = box.x; u < box.br().x; ++u) {
        const double depth = depthOfBox(T_camera_brick, size_m_, camera_.bearing(Eigen::Vector2d(u, v)));
        if (std::isfinite(depth)) depth_m.at<float>(v, u) = static_cast<float>(depth);
      }
    }
    return depth_m;
  }

  /// Any pose at a distance, near the middle of the image.
  std::function<Eigen::Isometry3d(std::mt19937*)> anywhere(double least_m, double most_m) const {
    return [least_m, most_m](std::mt19937* engine) {
      std::uniform_real_distribution<double> side(-0.15, 0.15);
      const double z = std::uniform_real_distribution<double>(least_m, most_m)(*engine);
      const Eigen::Vector3d p_camera(side(*engine) * z, side(*engine) * z, z);
      return Eigen::Translation3d(p_camera) * Eigen::Isometry3d(anyRotation(*engine));
    };
  }
};

TEST_F(NoisyBrickPose, CovarianceIsHonestWithoutDepth) {
  const Campaign campaign = look(anywhere(0.6, 2.0), false, 400);
}

TEST_F(NoisyBrickPose, CovarianceIsHonestWithDepth) {
  const Campaign campaign = look(anywhere(0.6, 2.0), true, 300);
}

TEST_F(NoisyBrickPose, Small) {
  for (double z : {1.8, 2.4, 3.0, 3.6}) {
   for (double tilt : {0.0, 0.05, 0.1, 0.2, 0.35, 0.6, 0.9}) {
    std::printf("z %g tilt %g\n", z, tilt);
    look([&](std::mt19937*) { return facing({0.05, 0.1, z}, tilt); }, true, 100, 0.5);
    look([&](std::mt19937*) { return facing({0.05, 0.1, z}, tilt); }, false, 100, 0.5);
   }
  }
}

}  // namespace
}  // namespace brick_detection
