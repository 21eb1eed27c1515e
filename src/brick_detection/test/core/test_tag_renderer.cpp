// SPDX-License-Identifier: BSD-3-Clause
#include "support/tag_renderer.h"

#include <cmath>

#include <gmock/gmock.h>
#include <opencv2/imgproc.hpp>

namespace brick_detection {
namespace {

CameraModel vga() {
  return {640, 480, 525.0, 525.0, 319.5, 239.5, Distortion::kNone, {}};
}

CameraModel small() {
  return {160, 120, 130.0, 130.0, 79.5, 59.5, Distortion::kNone, {}};
}

/// Two bricks, the second partly behind the first, on the ground.
RenderScene pair(const CameraModel& camera) {
  const auto catalogue = mp700_ur5e_description::loadBrickTypes(BRICKS_YAML);
  const Eigen::Vector2d middle(camera.cx_px, camera.cy_px);
  const double unit_px = camera.fx_px / 525.0;
  RenderScene scene;
  scene.camera = camera;
  scene.bricks.push_back(catalogueBrick(
      catalogue, 3, poseSeenAt(camera, middle - unit_px * Eigen::Vector2d(60.0, 20.0), 1.0, 0.6, 0.5, 0.3)));
  scene.bricks.push_back(catalogueBrick(
      catalogue, 4, poseSeenAt(camera, middle + unit_px * Eigen::Vector2d(70.0, 30.0), 1.3, 1.0, 2.5, 0.3)));
  scene.T_camera_ground = poseSeenAt(camera, middle, 1.5, 0.6, CV_PI, 0.0);
  return scene;
}

RenderScene boardAt(const Eigen::Isometry3d& T_camera_tag) {
  RenderScene scene;
  scene.camera = vga();
  scene.bricks = {tagBoard(7, 0.12, 0.17, T_camera_tag)};
  return scene;
}

TEST(TagRenderer, PixelsAreTheMeanOfAFinerImage) {
  RenderScene coarse = pair(small());
  RenderScene fine = coarse;
  constexpr int kFactor = 16;
  fine.camera = {160 * kFactor, 120 * kFactor, 130.0 * kFactor, 130.0 * kFactor, 0.0, 0.0, Distortion::kNone, {}};
  fine.camera.cx_px = kFactor * (coarse.camera.cx_px + 0.5) - 0.5;
  fine.camera.cy_px = kFactor * (coarse.camera.cy_px + 0.5) - 0.5;
  fine.samples = 1;
  const cv::Mat expected_fine = render(fine, {}, 1).grey;
  cv::Mat expected;
  cv::resize(expected_fine, expected, cv::Size(160, 120), 0.0, 0.0, cv::INTER_AREA);
  coarse.samples = 256;
  const cv::Mat grey = render(coarse, {}, 1).grey;
  cv::Mat difference;
  cv::absdiff(grey, expected, difference);
  double largest = 0.0;
  cv::minMaxLoc(difference, nullptr, &largest);
  // 256 samples each, of steps of at most 220 grey levels; an edge is found to one part in 16 by the finer image.
  EXPECT_LE(largest, 220.0 / 16.0);
  EXPECT_LT(cv::mean(difference)[0], 0.2);
}

TEST(TagRenderer, EdgesCoverPixelsByTheirShare) {
  // A border's edge at a known place within a column of pixels: black covers 0.5 + x of it.
  for (const double share : {0.1, 0.3, 0.55, 0.9}) {
    Eigen::Isometry3d T_camera_tag = poseSeenAt(vga(), {319.5, 239.5}, 1.05, 0.0, 0.0, 0.0);
    // Left edge of the border: -60 mm, 30 px left of the middle. Black begins where 1 - share of pixel 300 is passed.
    const double edge_u = 299.5 + (1.0 - share);
    T_camera_tag.translation().x() = (edge_u - 319.5) / 525.0 * 1.05 + 0.06;
    const RenderedView view = render(boardAt(T_camera_tag), {}, 1);
    const double black = view.grey.at<std::uint8_t>(239, 302);
    const double white = view.grey.at<std::uint8_t>(239, 297);
    ASSERT_GT(white - black, 100.0);
    const double seen = (white - view.grey.at<std::uint8_t>(239, 300)) / (white - black);
    EXPECT_NEAR(seen, share, 1.0 / 32.0 + 1.0 / 100.0) << "samples, and rounding to grey levels";
    EXPECT_NEAR(view.tags.at(0).corners_px[0].x(), edge_u, 1e-9);
  }
}

TEST(TagRenderer, DepthIsThatOfThePlanes) {
  CameraModel bent = vga();
  bent.distortion = Distortion::kPlumbBob;
  bent.coefficients = {-0.28, 0.09, 0.001, -0.0008};
  for (const CameraModel& camera : {vga(), bent}) {
    RenderScene scene;
    scene.camera = camera;
    const Eigen::Isometry3d T_camera_tag = poseSeenAt(camera, {400.0, 150.0}, 0.9, 0.7, 1.0, 0.4);
    scene.bricks = {tagBoard(7, 0.12, 0.17, T_camera_tag)};
    scene.T_camera_ground = poseSeenAt(camera, {320.0, 240.0}, 2.0, 0.5, CV_PI, 0.0);
    const RenderedView view = render(scene, {}, 1);
    const auto depthOf = [&](const Eigen::Isometry3d& T_camera_plane, const Eigen::Vector2d& pixel) {
      const Eigen::Vector3d ray = camera.bearing(pixel).homogeneous();
      const Eigen::Vector3d n = T_camera_plane.linear().col(2);
      return n.dot(T_camera_plane.translation()) / n.dot(ray);
    };
    EXPECT_NEAR(view.depth_m.at<float>(150, 400), depthOf(T_camera_tag, {400.0, 150.0}), 1e-5);
    EXPECT_NEAR(view.depth_m.at<float>(155, 410), depthOf(T_camera_tag, {410.0, 155.0}), 1e-5);
    // Under distortion a pixel's middle is taken as that of its corners.
    EXPECT_NEAR(view.depth_m.at<float>(470, 20), depthOf(*scene.T_camera_ground, {20.0, 470.0}), 1e-5);
  }
}

TEST(TagRenderer, NothingHasNoDepth) {
  const RenderedView view = render(boardAt(poseSeenAt(vga(), {319.5, 239.5}, 1.0, 0.0, 0.0, 0.0)), {}, 1);
  EXPECT_TRUE(std::isnan(view.depth_m.at<float>(10, 10)));
}

TEST(TagRenderer, VisibleShareCountsWhatHidesAndWhatIsOutside) {
  RenderScene scene = boardAt(poseSeenAt(vga(), {319.5, 239.5}, 1.0, 0.0, 0.0, 0.0));
  EXPECT_DOUBLE_EQ(render(scene, {}, 1).tags.at(0).visible_share, 1.0);
  RenderBox box;
  box.size_m = {0.2, 0.2, 0.02};
  box.T_camera_box = Eigen::Translation3d(0.1, 0.0, 0.5) * Eigen::Isometry3d::Identity();
  scene.boxes = {box};
  // Its left face's front edge is at x = 0, z = 0.49: the right half of the tag is hidden.
  EXPECT_NEAR(render(scene, {}, 1).tags.at(0).visible_share, 0.5, 0.5 / 24.0);
  scene = boardAt(poseSeenAt(vga(), {-0.5, 239.5}, 1.0, 0.0, 0.0, 0.0));
  EXPECT_NEAR(render(scene, {}, 1).tags.at(0).visible_share, 0.5, 0.5 / 24.0);
}

TEST(TagRenderer, TheNearerBrickHidesTheOtherInAnyOrder) {
  const RenderBrick near = tagBoard(1, 0.12, 0.17, poseSeenAt(vga(), {319.5, 239.5}, 0.8, 0.0, 0.0, 0.0));
  const RenderBrick far = tagBoard(2, 0.12, 0.17, poseSeenAt(vga(), {319.5, 239.5}, 1.2, 0.0, 0.0, 0.0));
  RenderScene scene;
  scene.camera = vga();
  for (const bool near_first : {true, false}) {
    scene.bricks = near_first ? std::vector<RenderBrick>{near, far} : std::vector<RenderBrick>{far, near};
    const RenderedView view = render(scene, {}, 1);
    EXPECT_NEAR(view.depth_m.at<float>(239, 319), 0.8, 1e-5);
    EXPECT_DOUBLE_EQ(view.tags.at(near_first ? 0 : 1).visible_share, 1.0);
    EXPECT_DOUBLE_EQ(view.tags.at(near_first ? 1 : 0).visible_share, 0.0);
  }
}

TEST(TagRenderer, TagsThatFaceAwayAreNotListed) {
  EXPECT_TRUE(render(boardAt(poseSeenAt(vga(), {319.5, 239.5}, 1.0, CV_PI, 0.0, 0.0)), {}, 1).tags.empty());
  EXPECT_EQ(render(pair(vga()), {}, 1).tags.size(), 5U);
}

TEST(TagRenderer, PoseSeenAtIsWhatItSays) {
  const Eigen::Isometry3d T_camera_tag = poseSeenAt(vga(), {100.0, 400.0}, 1.3, 0.7, 0.4, 1.1);
  EXPECT_NEAR(T_camera_tag.translation().norm(), 1.3, 1e-12);
  EXPECT_LT((vga().project(T_camera_tag.translation()) - Eigen::Vector2d(100.0, 400.0)).norm(), 1e-9);
  const double cosine = -T_camera_tag.linear().col(2).dot(T_camera_tag.translation().normalized());
  EXPECT_NEAR(std::acos(cosine), 0.7, 1e-9);
  EXPECT_NEAR(T_camera_tag.linear().determinant(), 1.0, 1e-12);
  // Upright: x to the right, y up in the image.
  EXPECT_LT((poseSeenAt(vga(), {319.5, 239.5}, 1.0, 0.0, 0.0, 0.0).linear() -
             Eigen::Matrix3d(Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal()))
                .norm(),
            1e-12);
}

TEST(TagRenderer, SeedsDecideTheNoise) {
  RenderEffects effects;
  effects.noise_std = 3.0;
  effects.depth_noise = 0.003;
  const RenderScene scene = pair(small());
  const RenderedView first = render(scene, effects, 1);
  const RenderedView again = render(scene, effects, 1);
  const RenderedView other = render(scene, effects, 2);
  EXPECT_EQ(cv::norm(first.color, again.color), 0.0);
  EXPECT_EQ(cv::norm(first.depth_m, again.depth_m, cv::NORM_INF, first.depth_m == first.depth_m), 0.0);
  EXPECT_GT(cv::norm(first.color, other.color), 0.0);
}

TEST(TagRenderer, NoiseHasTheSizeAskedFor) {
  RenderScene scene;
  scene.camera = vga();
  scene.background_rgb = {0.4, 0.4, 0.4};
  scene.T_camera_ground = poseSeenAt(vga(), {319.5, 239.5}, 1.25, 0.0, 0.0, 0.0);
  scene.ground_rgb = {0.4, 0.4, 0.4};
  RenderEffects effects;
  effects.noise_std = 4.0;
  effects.depth_noise = 0.002;
  effects.depth_noise_px = 4.0;
  effects.depth_holes = 0.05;
  const RenderedView view = render(scene, effects, 5);
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(view.grey, mean, deviation);
  EXPECT_NEAR(deviation[0], 4.0, 0.1);  // 300000 pixels: 0.2 %; rounding adds 1 %
  const cv::Mat has_depth = view.depth_m == view.depth_m;
  EXPECT_NEAR(1.0 - cv::mean(has_depth)[0] / 255.0, 0.05, 0.001);
  const cv::Mat inverse = 1.0 / view.depth_m;
  cv::meanStdDev(inverse, mean, deviation, has_depth);
  EXPECT_NEAR(deviation[0], 0.002, 0.0002);  // alike over 16 pixels: 20000 independent ones, and the holes take some
}

TEST(TagRenderer, EffectsDoWhatTheirNamesSay) {
  const RenderScene scene = boardAt(poseSeenAt(vga(), {319.5, 239.5}, 0.5, 0.0, 0.0, 0.0));
  const RenderedView plain = render(scene, {}, 1);
  const auto meanOf = [&](const RenderEffects& effects) { return cv::mean(render(scene, effects, 1).grey)[0]; };
  const double mean = cv::mean(plain.grey)[0];
  RenderEffects effects;
  effects.exposure = 0.5;
  EXPECT_NEAR(meanOf(effects), 0.5 * mean, 0.5);
  effects = {};
  effects.brightness = 10.0;
  EXPECT_NEAR(meanOf(effects), mean + 10.0, 0.5);
  effects = {};
  effects.contrast = 0.5;
  EXPECT_NEAR(meanOf(effects), 127.5 + 0.5 * (mean - 127.5), 0.5);
  effects = {};
  effects.gamma = 2.2;
  EXPECT_GT(meanOf(effects), mean + 10.0);
  effects = {};
  effects.light_gradient = {0.8, 0.0};
  const cv::Mat graded = render(scene, effects, 1).grey;
  EXPECT_NEAR(graded.at<std::uint8_t>(5, 5), 0.6 * plain.grey.at<std::uint8_t>(5, 5), 2.0);
  EXPECT_NEAR(graded.at<std::uint8_t>(5, 634), 1.4 * plain.grey.at<std::uint8_t>(5, 634), 2.0);
  // Motion along u blurs upright edges and no others; the picture's light stays.
  effects = {};
  effects.motion_px = {6.0, 0.0};
  const cv::Mat moved = render(scene, effects, 1).grey;
  EXPECT_NEAR(cv::mean(moved)[0], mean, 0.5);
  const auto steepest = [](const cv::Mat& image, int du, int dv) {
    cv::Mat slope;
    cv::Sobel(image, slope, CV_32F, du, dv, 1);
    double largest = 0.0;
    cv::minMaxLoc(cv::abs(slope), nullptr, &largest);
    return largest;
  };
  EXPECT_LT(steepest(moved, 1, 0), 0.5 * steepest(plain.grey, 1, 0));
  EXPECT_GT(steepest(moved, 0, 1), 0.9 * steepest(plain.grey, 0, 1));
}

TEST(TagRenderer, RefusesWhatItCannotDraw) {
  RenderScene scene = boardAt(poseSeenAt(vga(), {319.5, 239.5}, 1.0, 0.0, 0.0, 0.0));
  scene.family = "tag99h99";
  EXPECT_THROW(render(scene, {}, 1), std::invalid_argument);
  scene.family = "tag16h5";
  scene.bricks[0].tags = {{30, scene.bricks[0].tags.begin()->second}};
  EXPECT_THROW(render(scene, {}, 1), std::invalid_argument);
  scene = boardAt(poseSeenAt(vga(), {319.5, 239.5}, 1.0, 0.0, 0.0, 0.0));
  scene.camera.fx_px = 0.0;
  EXPECT_THROW(render(scene, {}, 1), std::invalid_argument);
}

}  // namespace
}  // namespace brick_detection
