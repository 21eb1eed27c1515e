// SPDX-License-Identifier: BSD-3-Clause
// Which looks at the target become samples, on rendered images.
#include "brick_detection/calibration_session.h"

#include <gmock/gmock.h>

#include "support/tag_renderer.h"

namespace brick_detection {
namespace {

using mp700_ur5e_description::BrickCatalogue;
using mp700_ur5e_description::loadBrickTypes;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

const BrickCatalogue kBricks = loadBrickTypes(BRICKS_YAML);

CameraModel vga() {
  CameraModel camera;
  camera.width_px = 640;
  camera.height_px = 480;
  camera.fx_px = camera.fy_px = 615.0;
  camera.cx_px = 319.5;
  camera.cy_px = 239.5;
  return camera;
}

/// Seen from above an edge, so that two faces show.
Eigen::Isometry3d brickBeforeCamera(double x_m, double z_m) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() << x_m, 0.0, z_m;
  T.rotate(Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitY()));
  return T;
}

RenderedView view(const std::vector<RenderBrick>& bricks) {
  RenderScene scene;
  scene.camera = vga();
  scene.bricks = bricks;
  RenderEffects effects;
  effects.blur_sigma_px = 0.5;
  effects.noise_std = 2.0;
  return render(scene, effects, 1);
}

TEST(TargetFinder, FindsItsBrickAmongOthers) {
  const Eigen::Isometry3d T = brickBeforeCamera(-0.2, 1.2);
  const RenderedView seen =
      view({catalogueBrick(kBricks, 3, T), catalogueBrick(kBricks, 4, brickBeforeCamera(0.25, 1.3))});
  TargetFinder finder(kBricks, 3, BrickPoseConfig());
  std::string why_not;
  for (const bool has_depth : {true, false}) {
    const auto target = finder.find(seen.color, has_depth ? seen.depth_m : cv::Mat(), vga(), &why_not);
    ASSERT_TRUE(target) << why_not;
    // Two faces of 60 px, corners to 0.1 px: some millimetres along the line of sight.
    EXPECT_LT((target->T_camera_brick.translation() - T.translation()).norm(), 0.005);
    EXPECT_LT(Eigen::Quaterniond(target->T_camera_brick.linear()).angularDistance(Eigen::Quaterniond(T.linear())),
              0.01);
    EXPECT_EQ(target->has_depth, has_depth);
  }
  EXPECT_TRUE(finder.find(seen.grey, seen.depth_m, vga(), &why_not)) << "grey will do: " << why_not;
}

TEST(TargetFinder, SaysWhyThereIsNone) {
  TargetFinder finder(kBricks, 3, BrickPoseConfig());
  std::string why_not;
  const RenderBrick other = catalogueBrick(kBricks, 4, brickBeforeCamera(0.0, 1.2));
  EXPECT_FALSE(finder.find(view({other}).color, cv::Mat(), vga(), &why_not));
  EXPECT_THAT(why_not, HasSubstr("not in view"));
  const RenderBrick left = catalogueBrick(kBricks, 3, brickBeforeCamera(-0.3, 1.2));
  const RenderBrick right = catalogueBrick(kBricks, 3, brickBeforeCamera(0.3, 1.2));
  EXPECT_FALSE(finder.find(view({left, right}).color, cv::Mat(), vga(), &why_not));
  EXPECT_THAT(why_not, HasSubstr("more than once"));
  BrickPoseConfig strict;
  strict.min_side_px = 200.0;
  TargetFinder demanding(kBricks, 3, strict);
  EXPECT_FALSE(demanding.find(view({left}).color, cv::Mat(), vga(), &why_not));
  EXPECT_THAT(why_not, HasSubstr("of no use: too small"));
}

TEST(TargetFinder, ALoneTagIsATargetToo) {
  Eigen::Isometry3d T = poseSeenAt(vga(), {350.0, 200.0}, 0.9, 0.6, 0.3, 0.4);
  const RenderedView seen = view({tagBoard(17, 0.08, 0.12, T)});
  const BrickCatalogue tag = loneTag("tag36h11", 17, 0.08);
  TargetFinder finder(tag, 0, BrickPoseConfig());
  std::string why_not;
  const auto target = finder.find(seen.color, cv::Mat(), vga(), &why_not);
  ASSERT_TRUE(target) << why_not;
  EXPECT_LT((target->T_camera_brick.translation() - T.translation()).norm(), 0.005);
  EXPECT_LT(Eigen::Quaterniond(target->T_camera_brick.linear()).angularDistance(Eigen::Quaterniond(T.linear())), 0.03);
}

TEST(TargetFinder, ImpossibleTargetsAreRefused) {
  EXPECT_THROW(TargetFinder(kBricks, 100000, BrickPoseConfig()), std::invalid_argument);
  EXPECT_THROW(loneTag("tag36h11", 587, 0.1), std::invalid_argument) << "the family has 587 ids";
  EXPECT_NO_THROW(loneTag("tag36h11", 586, 0.1));
  EXPECT_THROW(loneTag("tag36h11", -1, 0.1), std::invalid_argument);
  EXPECT_THROW(loneTag("tag36h12", 1, 0.1), std::invalid_argument);
  EXPECT_THROW(loneTag("tag36h11", 1, 0.0), std::invalid_argument);
}

Eigen::Isometry3d toolAt(double x_m, double turn_rad) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation().x() = x_m;
  T.rotate(Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitZ()));
  return T;
}

TEST(CalibrationSession, AnArmThatMovesIsNotStill) {
  const CalibrationSession session{CalibrationSessionConfig()};
  EXPECT_EQ(session.whyNotStill({toolAt(0.0, 0.0), toolAt(0.0004, 0.0), toolAt(0.0, 0.0009)}), "");
  EXPECT_THAT(session.whyNotStill({toolAt(0.0006, 0.0), toolAt(0.0, 0.0)}), HasSubstr("moves: 0.6 mm"));
  EXPECT_THAT(session.whyNotStill({toolAt(0.0, 0.0011), toolAt(0.0, 0.0)}), HasSubstr("moves"));
  EXPECT_THAT(session.whyNotStill({toolAt(0.0, 0.0), toolAt(0.1, 0.0), toolAt(0.0, 0.0)}), HasSubstr("100.0 mm"))
      << "there and back";
  EXPECT_THROW(session.whyNotStill({}), std::invalid_argument);
}

TEST(CalibrationSession, ASampleMustDifferFromEachOther) {
  CalibrationSession session{CalibrationSessionConfig()};
  EXPECT_EQ(session.whyNotNew(toolAt(0.0, 0.0)), "");
  HandEyeSample sample;
  for (const double x_m : {0.0, 1.0, 2.0}) {
    sample.T_base_tool = toolAt(x_m, 0.0);
    session.add(sample);
  }
  EXPECT_THAT(session.whyNotNew(toolAt(0.96, 0.16)), HasSubstr("too like sample 1"));
  EXPECT_EQ(session.whyNotNew(toolAt(0.94, 0.16)), "") << "far enough";
  EXPECT_EQ(session.whyNotNew(toolAt(0.96, 0.18)), "") << "turned enough";
  EXPECT_TRUE(session.discardLast());
  EXPECT_EQ(session.whyNotNew(toolAt(2.0, 0.0)), "") << "the last was discarded";
  EXPECT_TRUE(session.discardLast());
  EXPECT_TRUE(session.discardLast());
  EXPECT_FALSE(session.discardLast());
  EXPECT_EQ(session.solve().failure, HandEyeFailure::kTooFewSamples);
}

TEST(CalibrationSession, ImpossibleConfigIsRefusedWithEveryKey) {
  CalibrationSessionConfig config;
  config.hand_eye.min_samples = 1;
  config.hand_eye.arm_std_m = -1.0;
  EXPECT_THAT(interactive_mapping::problemsOf(config),
              ElementsAre(HasSubstr("hand_eye/min_samples = 1"), HasSubstr("hand_eye/arm_std_m = -1 m")));
  EXPECT_THROW(CalibrationSession{config}, std::invalid_argument);
}

TEST(CalibrationSession, TableShowsEachSampleAndWhoWasLeftOut) {
  HandEyeResult result;
  result.residuals = {{0.0012, 0.01, false}, {0.35, 0.5, true}};
  result.num_used = 1;
  result.covariance = Matrix6d::Identity() * 1e-6;
  const std::string table = residualTable(result);
  EXPECT_THAT(table, HasSubstr("1.20"));
  EXPECT_THAT(table, HasSubstr("350.00       28.648   left out"));
  EXPECT_THAT(table, HasSubstr("+-(1.00, 1.00, 1.00) mm"));
  result.failure = HandEyeFailure::kSamplesDisagree;
  result.reason = "the samples disagree";
  EXPECT_THAT(residualTable(result), HasSubstr("left out\nthe samples disagree"));
}

}  // namespace
}  // namespace brick_detection
