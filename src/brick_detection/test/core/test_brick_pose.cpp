// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/brick_pose.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <set>

#include <Eigen/Eigenvalues>
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
  const Vector6d off = stepBetween(T_turned_camera * plain.bricks[0].T_camera_brick, turned.bricks[0].T_camera_brick);
  EXPECT_LT(off.dot(turned.bricks[0].covariance.ldlt().solve(off)), 0.01);
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = T_turned_camera.linear();
  const Matrix6d expected = turn * plain.bricks[0].covariance * turn.transpose();
  EXPECT_LT((expected - turned.bricks[0].covariance).norm(), 0.02 * expected.norm());

  // Without depth nothing is drawn.
  const auto plain_colour = estimator_.estimate(tags, camera, no_depth_);
  const auto turned_colour = estimator_.estimate(turned_tags, camera, no_depth_);
  ASSERT_THAT(turned_colour.bricks, SizeIs(1));
  EXPECT_TRUE(
      turned_colour.bricks[0].T_camera_brick.isApprox(T_turned_camera * plain_colour.bricks[0].T_camera_brick, 1e-6));
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
    return campaign;
  }

  /// Depth round the brick alone: to render the whole image takes its time.
  cv::Mat depthOf(const Eigen::Isometry3d& T_camera_brick) const {
    cv::Mat depth_m(camera_.height_px, camera_.width_px, CV_32FC1, cv::Scalar(0.0f));
    const Eigen::Vector2d middle_px = camera_.project(T_camera_brick.translation());
    const double reach_px = 0.5 * size_m_.norm() * camera_.fx_px / (T_camera_brick.translation().z() - 0.2);
    const cv::Rect all(0, 0, camera_.width_px, camera_.height_px);
    const cv::Rect box =
        all & cv::Rect(static_cast<int>(middle_px.x() - reach_px), static_cast<int>(middle_px.y() - reach_px),
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

// Six degrees of freedom: the mean over 300 looks is 6 with a standard deviation of sqrt(12 / 300) = 0.2, if all is linear
// and Gaussian. Robust weights give up some information, and a lone tag's covariance is widened where its image hardly
// changes with its tilt: less is claimed than is known, never more than by chance.
constexpr double kLeastNormalised = 3.5;
constexpr double kMostNormalised = 6.6;

TEST_F(NoisyBrickPose, CovarianceIsHonestWithoutDepth) {
  const Campaign campaign = look(anywhere(0.6, 2.0), false, 400);
  EXPECT_GT(campaign.mean_normalised, kLeastNormalised);
  EXPECT_LT(campaign.mean_normalised, kMostNormalised);
  EXPECT_EQ(campaign.num_wrong, 0);
  EXPECT_GT(campaign.num_poses, 340) << "the others show one face from the front";
}

TEST_F(NoisyBrickPose, CovarianceIsHonestWithDepth) {
  const Campaign campaign = look(anywhere(0.6, 2.0), true, 300);
  EXPECT_GT(campaign.mean_normalised, kLeastNormalised);
  EXPECT_LT(campaign.mean_normalised, kMostNormalised);
  EXPECT_EQ(campaign.num_wrong, 0);
  EXPECT_GT(campaign.num_poses, 295);
}

TEST_F(NoisyBrickPose, DepthMakesThePoseBetter) {
  const Campaign colour = look(anywhere(0.6, 2.0), false, 100);
  const Campaign both = look(anywhere(0.6, 2.0), true, 100);
  EXPECT_LT(both.rms_m, 0.7 * colour.rms_m);
  EXPECT_LT(both.rms_rad, 0.7 * colour.rms_rad);
}

TEST_F(NoisyBrickPose, ASmallTagSeenFromTheFrontIsRightWithDepthAndRefusedOrRightWithout) {
  constexpr int kTrials = 40;
  for (const double z : {1.8, 2.4, 3.4}) {  // 40, 30 and 21 px
    for (const double tilt : {0.0, 0.1, 0.2, 0.35}) {
      const auto draw = [&](std::mt19937*) { return facing({0.05, 0.1, z}, tilt); };
      const Campaign with_depth = look(draw, true, kTrials, 0.7);
      EXPECT_EQ(with_depth.num_wrong, 0) << z << " m, " << tilt;
      EXPECT_LT(with_depth.mean_normalised, kMostNormalised) << z << " m, " << tilt;
      // Depth's noise grows with the distance's square: at 3.4 m a plane of 25 px is known to 0.1 rad, which leaves two
      // poses 0.4 rad apart ambiguous for every second tag.
      EXPECT_LT(with_depth.rms_rad, z < 2.0 ? 0.04 : z < 3.0 ? 0.09 : 0.17) << z << " m, " << tilt;
      EXPECT_GE(with_depth.num_poses, z < 3.0 ? 38 : 16) << z << " m, " << tilt;
      const Campaign colour = look(draw, false, kTrials, 0.7);
      EXPECT_EQ(colour.num_wrong, 0) << z << " m, " << tilt;
      EXPECT_LE(colour.num_poses, kTrials / 2 + (tilt > 0.3 ? kTrials / 2 : 0)) << z << " m, " << tilt;
    }
  }
}

TEST_F(BrickPose, DepthDecidesBetweenTheTwoPosesOfATag) {
  // 30 px and tilted by 0.35: without noise both poses fit to a twentieth of a pixel.
  for (const double tilt : {0.35, -0.35}) {
    const Eigen::Isometry3d truth = facing({0.05, 0.1, 2.4}, tilt);
    const auto tags = observeBrick(catalogue_, 4, truth, camera_, 0.7);
    ASSERT_THAT(tags, SizeIs(1));
    const auto colour = estimator_.estimate(tags, camera_, no_depth_);
    EXPECT_THAT(statusOf(colour), ElementsAre(TagStatus::kAmbiguous));
    EXPECT_THAT(colour.bricks, IsEmpty());
    const auto both = estimator_.estimate(tags, camera_, depthImage({truth}, size_m_, camera_));
    EXPECT_THAT(statusOf(both), ElementsAre(TagStatus::kUsed));
    ASSERT_THAT(both.bricks, SizeIs(1));
    EXPECT_TRUE(both.bricks[0].has_depth);
    EXPECT_LT(stepBetween(truth, both.bricks[0].T_camera_brick).norm(), 1e-4);
    EXPECT_THAT(both.bricks[0].faces, ElementsAre(BrickFace::kPlusZ));
  }
}

TEST_F(BrickPose, AnotherTagOfTheBrickDecidesBetweenTheTwoPosesOfATag) {
  const Eigen::Isometry3d truth = facing({0.0, 0.0, 2.4}, 0.45, 0.05);
  std::vector<TagObservation> tags = observeBrick(catalogue_, 4, truth, camera_, 0.1);
  ASSERT_THAT(tags, SizeIs(2)) << "the other nearly from the side";
  const auto alone = observeBrick(catalogue_, 4, truth, camera_, 0.8);
  ASSERT_THAT(alone, SizeIs(1));
  ASSERT_THAT(statusOf(estimator_.estimate(alone, camera_, no_depth_)), ElementsAre(TagStatus::kAmbiguous));
  const auto result = estimator_.estimate(tags, camera_, no_depth_);
  EXPECT_THAT(statusOf(result), Each(TagStatus::kUsed));
  ASSERT_THAT(result.bricks, SizeIs(1));
  EXPECT_LT(stepBetween(truth, result.bricks[0].T_camera_brick).norm(), 1e-6);
  EXPECT_THAT(result.bricks[0].faces, SizeIs(2));
}

TEST_F(BrickPose, IsRefusedWhereNoPoseFitsTheDepth) {
  const Eigen::Isometry3d truth = facing({0.0, 0.0, 1.2}, 0.5);
  const auto tags = observeBrick(catalogue_, 4, truth, camera_, 0.7);
  ASSERT_THAT(tags, SizeIs(1));
  const auto with = [&](const Eigen::Isometry3d& shown) {
    return estimator_.estimate(tags, camera_, depthImage({shown}, size_m_, camera_));
  };
  EXPECT_THAT(statusOf(with(truth)), ElementsAre(TagStatus::kUsed));
  const auto turned = with(facing({0.0, 0.0, 1.2}, 0.1));
  EXPECT_THAT(statusOf(turned), ElementsAre(TagStatus::kContradictsDepth));
  EXPECT_THAT(turned.bricks, IsEmpty());
  const auto nearer = with(facing({0.0, 0.0, 1.0}, 0.5));
  EXPECT_THAT(statusOf(nearer), ElementsAre(TagStatus::kContradictsDepth));
}

TEST_F(BrickPose, IsFoundWithoutDepthWhereTheDepthImageHasAHole) {
  const Eigen::Isometry3d truth = corner({0.0, 0.0, 1.3});
  const cv::Mat nothing(camera_.height_px, camera_.width_px, CV_32FC1, cv::Scalar(0.0f));
  const auto result = estimator_.estimate(observeBrick(catalogue_, 0, truth, camera_), camera_, nothing);
  ASSERT_THAT(result.bricks, SizeIs(1));
  EXPECT_FALSE(result.bricks[0].has_depth);
  EXPECT_LT(stepBetween(truth, result.bricks[0].T_camera_brick).norm(), 1e-6);
}

TEST_F(BrickPose, OneBadCornerAmongThreeTagsHardlyPulls) {
  const Eigen::Isometry3d truth = corner({0.0, 0.0, 1.0});
  const auto tags = observeBrick(catalogue_, 0, truth, camera_, 0.3);
  ASSERT_THAT(tags, SizeIs(3));
  const cv::Mat depth_m = depthImage({truth}, size_m_, camera_);
  for (const double off_px : {1.5, 3.0, 20.0}) {
    for (std::size_t bad = 0; bad < 3; ++bad) {
      auto spoilt = tags;
      spoilt[bad].corners_px[1] += Eigen::Vector2d(off_px, -off_px);
      for (const cv::Mat& depth : {no_depth_, depth_m}) {
        const auto result = estimator_.estimate(spoilt, camera_, depth);
        ASSERT_THAT(result.bricks, SizeIs(1)) << off_px << " px, tag " << bad;
        EXPECT_FALSE(result.bricks[0].has_duplicate) << off_px << " px, tag " << bad;
        const Vector6d off = stepBetween(result.bricks[0].T_camera_brick, truth);
        // Less than a usual error: a good corner's noise makes chi-square 6 in the mean.
        EXPECT_LT(off.dot(result.bricks[0].covariance.ldlt().solve(off)), 4.0) << off_px << " px, tag " << bad;
      }
    }
  }
}

TEST_F(BrickPose, ABadlySeenTagIsNoSecondBrick) {
  const Eigen::Isometry3d truth = corner({0.0, 0.0, 1.0});
  auto tags = observeBrick(catalogue_, 0, truth, camera_, 0.3);
  ASSERT_THAT(tags, SizeIs(3));
  // One tag turned about its middle by half a radian: a good square, where the brick is, but not the brick's.
  const auto tag = *catalogue_.brickOfTag(tags[2].id);
  tags[2] = observe(tags[2].id, tag.black_border_edge_m,
                    truth * tag.T_brick_tag * Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitZ()), camera_);
  const auto result = estimator_.estimate(tags, camera_, no_depth_);
  ASSERT_THAT(result.bricks, SizeIs(1));
  EXPECT_FALSE(result.bricks[0].has_duplicate);
  EXPECT_THAT(result.bricks[0].faces, SizeIs(2));
  const std::vector<TagStatus> status = statusOf(result);
  EXPECT_EQ(std::count(status.begin(), status.end(), TagStatus::kInconsistent), 1);
}

TEST_F(BrickPose, TwoBricksWithOneIdAreTwoSightings) {
  const Eigen::Isometry3d left = corner({-0.25, 0.0, 1.4});
  const Eigen::Isometry3d right = facing({0.25, 0.05, 1.4}, 0.6);
  auto tags = observeBrick(catalogue_, 2, right, camera_, 0.3);
  const auto other = observeBrick(catalogue_, 2, left, camera_, 0.3);
  tags.insert(tags.end(), other.begin(), other.end());
  for (int i = 0; i < 6; ++i) {
    const auto result = estimator_.estimate(tags, camera_, no_depth_);
    ASSERT_THAT(result.bricks, SizeIs(2)) << "order " << i;
    EXPECT_THAT(result.bricks, Each(Field(&BrickSighting::has_duplicate, true)));
    EXPECT_THAT(result.bricks, Each(Field(&BrickSighting::brick_id, 2)));
    for (const Eigen::Isometry3d& truth : {left, right}) {
      const auto off = [&truth](const BrickSighting& brick) { return stepBetween(truth, brick.T_camera_brick).norm(); };
      EXPECT_LT(std::min(off(result.bricks[0]), off(result.bricks[1])), 1e-6) << "order " << i;
    }
    std::rotate(tags.begin(), tags.begin() + 1, tags.end());
  }
}

TEST_F(BrickPose, TwoBricksSideBySideWithOneIdAreTwoSightingsToo) {
  const Eigen::Isometry3d left = corner({0.0, 0.0, 1.4});
  const Eigen::Isometry3d right = left * Eigen::Translation3d(0.0, size_m_.y(), 0.0);  // touching, and parallel
  auto tags = observeBrick(catalogue_, 2, left, camera_, 0.3);
  const auto other = observeBrick(catalogue_, 2, right, camera_, 0.3);
  tags.insert(tags.end(), other.begin(), other.end());
  const auto result = estimator_.estimate(tags, camera_, depthImage({left, right}, size_m_, camera_));
  EXPECT_THAT(result.bricks, SizeIs(2));
  EXPECT_THAT(result.bricks, Each(Field(&BrickSighting::has_duplicate, true)));
}

TEST_F(BrickPose, ARefusedTagElsewhereIsEvidenceOfASecondBrick) {
  const Eigen::Isometry3d good = corner({-0.25, 0.0, 1.4});
  const Eigen::Isometry3d unclear = facing({0.5, 0.05, 2.4}, 0.35);
  auto tags = observeBrick(catalogue_, 2, good, camera_, 0.3);
  const auto other = observeBrick(catalogue_, 2, unclear, camera_, 0.7);
  ASSERT_THAT(other, SizeIs(1));
  tags.push_back(other[0]);
  const auto result = estimator_.estimate(tags, camera_, no_depth_);
  EXPECT_EQ(result.tags.back().status, TagStatus::kAmbiguous);
  ASSERT_THAT(result.bricks, SizeIs(1));
  EXPECT_TRUE(result.bricks[0].has_duplicate);
}

TEST_F(BrickPose, BricksComeInOrderOfTheirIds) {
  std::vector<TagObservation> tags;
  for (const int id : {9, 1, 4}) {
    const auto more = observeBrick(catalogue_, id, corner({0.1 * id - 0.5, 0.0, 2.0}), camera_, 0.3);
    tags.insert(tags.end(), more.begin(), more.end());
  }
  const auto result = estimator_.estimate(tags, camera_, no_depth_);
  EXPECT_THAT(result.bricks, ElementsAre(Field(&BrickSighting::brick_id, 1), Field(&BrickSighting::brick_id, 4),
                                         Field(&BrickSighting::brick_id, 9)));
  ASSERT_THAT(result.tags, SizeIs(tags.size()));
  for (std::size_t i = 0; i < tags.size(); ++i) EXPECT_EQ(result.tags[i].tag.id, tags[i].id);
  EXPECT_EQ(result.tags[0].brick_id, 9);
  EXPECT_EQ(result.tags[0].face, catalogue_.brickOfTag(tags[0].id)->face);
}

// A tag whose second pose is out of the question, and whose rotation still is not known as well as asked for.
TEST_F(BrickPose, RefusesWhatItDoesNotKnowWellEnough) {
  const auto tags = observeBrick(catalogue_, 2, facing({0.0, 0.0, 1.0}, 0.6), camera_, 0.7);
  ASSERT_THAT(tags, SizeIs(1));
  BrickPoseConfig config;
  config.label_std_m = 0.0;  // comes on top, and is no reason to refuse
  const auto usual = BrickPoseEstimator(catalogue_, config).estimate(tags, camera_, no_depth_);
  ASSERT_THAT(usual.bricks, SizeIs(1));
  const Eigen::Matrix3d of_rotation = usual.bricks[0].covariance.bottomRightCorner<3, 3>();
  const double std_rad = std::sqrt(of_rotation.selfadjointView<Eigen::Lower>().eigenvalues().maxCoeff());
  for (const double share : {0.9, 1.1}) {
    config.max_rotation_std_rad = share * std_rad;
    const auto result = BrickPoseEstimator(catalogue_, config).estimate(tags, camera_, no_depth_);
    EXPECT_EQ(result.tags[0].status, share < 1.0 ? TagStatus::kAmbiguous : TagStatus::kUsed) << std_rad;
  }
}

TEST_F(BrickPose, EachGateHasItsStatus) {
  const auto good = observeBrick(catalogue_, 2, facing({0.0, 0.0, 1.0}, 0.6), camera_, 0.7);
  ASSERT_THAT(good, SizeIs(1));
  const auto statusWith = [&](const std::function<void(TagObservation*)>& spoil) {
    auto tags = good;
    spoil(&tags[0]);
    const auto result = estimator_.estimate(tags, camera_, no_depth_);
    EXPECT_EQ(result.bricks.empty(), result.tags[0].status != TagStatus::kUsed);
    return result.tags[0].status;
  };
  EXPECT_EQ(statusWith([](TagObservation*) {}), TagStatus::kUsed);
  EXPECT_EQ(statusWith([](TagObservation* tag) { tag->id = 100000; }), TagStatus::kUnknownId);
  EXPECT_EQ(statusWith([](TagObservation* tag) { tag->id = -1; }), TagStatus::kUnknownId);
  EXPECT_EQ(statusWith([](TagObservation* tag) { tag->hamming = 2; }), TagStatus::kUnsure);
  EXPECT_EQ(statusWith([](TagObservation* tag) { tag->margin = BrickPoseConfig().min_margin - 0.1; }),
            TagStatus::kUnsure);
  EXPECT_EQ(statusWith([](TagObservation* tag) { tag->margin = std::nan(""); }), TagStatus::kUnsure);
  const auto shrink = [](TagObservation* tag) {
    for (Eigen::Vector2d& corner : tag->corners_px) corner *= 0.15;  // 72 px to 11 px
  };
  EXPECT_EQ(statusWith(shrink), TagStatus::kTooSmall);
  EXPECT_EQ(statusWith([](TagObservation* tag) { tag->corners_px[2].x() = std::nan(""); }), TagStatus::kInconsistent);
  EXPECT_EQ(statusWith([](TagObservation* tag) { tag->corners_px[0].y() = std::numeric_limits<double>::infinity(); }),
            TagStatus::kInconsistent);
  EXPECT_EQ(statusWith([](TagObservation* tag) { tag->corners_px[0].x() += 25.0; }), TagStatus::kInconsistent);
  EXPECT_EQ(statusWith([](TagObservation* tag) { std::swap(tag->corners_px[0], tag->corners_px[1]); }),
            TagStatus::kInconsistent);
  EXPECT_EQ(statusWith([](TagObservation* tag) { std::reverse(tag->corners_px.begin(), tag->corners_px.end()); }),
            TagStatus::kInconsistent);
}

TEST_F(BrickPose, NothingInNothingOut) {
  const auto result = estimator_.estimate({}, camera_, no_depth_);
  EXPECT_THAT(result.bricks, IsEmpty());
  EXPECT_THAT(result.tags, IsEmpty());
}

TEST_F(BrickPose, RefusesImpossibleInput) {
  CameraModel bad = camera_;
  bad.fx_px = 0.0;
  EXPECT_THROW(estimator_.estimate({}, bad, no_depth_), std::invalid_argument);
  EXPECT_THROW(estimator_.estimate({}, camera_, cv::Mat(480, 640, CV_16UC1)), std::invalid_argument);
  EXPECT_THROW(estimator_.estimate({}, camera_, cv::Mat(480, 320, CV_32FC1)), std::invalid_argument);
  BrickPoseConfig config;
  config.corner_std_px = 0.0;
  config.depth.grow = -1.0;
  EXPECT_THAT(interactive_mapping::problemsOf(config),
              ElementsAre(HasSubstr("corner_std_px = 0 px, must be in [0.01, 10] px"),
                          HasSubstr("depth/grow = -1, must be in [")));
  EXPECT_THROW(BrickPoseEstimator(catalogue_, config), std::invalid_argument);
  EXPECT_THAT(interactive_mapping::problemsOf(BrickPoseConfig()), IsEmpty());
}

TEST(TagStatusNames, AreAllDifferent) {
  std::set<std::string> names;
  for (int i = 0; i <= static_cast<int>(TagStatus::kInconsistent); ++i) {
    names.insert(toString(static_cast<TagStatus>(i)));
  }
  EXPECT_THAT(names, SizeIs(7));
}

}  // namespace
}  // namespace brick_detection
