// SPDX-License-Identifier: BSD-3-Clause
#include "depth_self_filter/robot_mask.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/mask_oracle.h"
#include "support/robots.h"

namespace depth_self_filter {
namespace {

using depth_camera::CameraModel;
using depth_camera::DepthImage;
using mp700_ur5e_description::RobotModel;
using test::constantImage;
using test::exactConfig;
using test::positions;
using test::robotOf;
using test::shippedRobot;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
const CameraModel kCamera{160, 120, 130.0, 130.0, 79.5, 59.5};

std::size_t at(const CameraModel& camera, int u, int v) {
  return static_cast<std::size_t>(v) * static_cast<std::size_t>(camera.width) + static_cast<std::size_t>(u);
}

/// A camera that looks at the origin of the root frame from `distance_m`, root's x to the right and y down.
Eigen::Isometry3d before(double distance_m) {
  Eigen::Isometry3d T_root_camera = Eigen::Isometry3d::Identity();
  T_root_camera.translation().z() = -distance_m;
  return T_root_camera;
}

const Eigen::VectorXd kNoJoints;

bool isSameValue(float a, float b) {
  return std::memcmp(&a, &b, sizeof(float)) == 0 || (std::isnan(a) && std::isnan(b));
}

/// What the mask makes of the image must lie between what brute force makes of it with shapes shrunk and grown by what
/// single precision gets wrong.
struct Compared {
  std::size_t wrong{0};
  std::size_t on_border{0};  // where both differ
  std::size_t masked{0};
  std::size_t kept{0};
};

Compared compare(RobotMask* mask, const CameraModel& camera, const Eigen::Isometry3d& T_root_camera,
                 const Eigen::VectorXd& q, const std::optional<HeldBrick>& brick, const DepthImage& image) {
  // Some float roundings (6e-8 relative) of coordinates of a few metres.
  constexpr double kBorder_m = 5e-6;
  const DepthImage least = test::oracleMask(*mask, camera, T_root_camera, q, brick, image, -kBorder_m);
  const DepthImage most = test::oracleMask(*mask, camera, T_root_camera, q, brick, image, kBorder_m);
  DepthImage masked = image;
  const MaskStatistics statistics = mask->apply(camera, T_root_camera, q, brick, &masked);
  Compared result;
  std::size_t nan_px = 0;
  std::size_t nan_before_px = 0;
  for (std::size_t i = 0; i < image.depth_m.size(); ++i) {
    const float value = masked.depth_m[i];
    const bool is_like_least = isSameValue(value, least.depth_m[i]);
    const bool is_like_most = isSameValue(value, most.depth_m[i]);
    result.wrong += is_like_least || is_like_most ? 0 : 1;
    result.on_border += isSameValue(least.depth_m[i], most.depth_m[i]) ? 0 : 1;
    nan_px += std::isnan(value) ? 1 : 0;
    nan_before_px += std::isnan(image.depth_m[i]) ? 1 : 0;
  }
  result.masked = statistics.masked_px + statistics.shadow_px;
  result.kept = statistics.in_front_px;
  // Pixels that were NaN before count as masked within the silhouette.
  EXPECT_GE(result.masked + nan_before_px, nan_px);
  EXPECT_GE(nan_px, result.masked);
  return result;
}

TEST(RobotMask, AgreesWithBruteForceOnTheRobot) {
  const auto robot = shippedRobot();
  RobotMask mask(robot, RobotMaskConfig());
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> angle(-3.1, 3.1);
  std::uniform_real_distribution<double> offset(-0.3, 0.3);
  std::uniform_real_distribution<double> distance(0.3, 1.5);
  const CameraModel camera{64, 48, 52.5, 50.0, 33.2, 21.7};
  Compared sum;
  std::size_t pixels = 0;
  for (int frame = 0; frame < 16; ++frame) {
    Eigen::VectorXd q = positions(*robot, test::kArmInView);
    q += Eigen::VectorXd::NullaryExpr(q.size(), [&](Eigen::Index) { return offset(random); });
    Eigen::Isometry3d T_root_camera = robot->framePose(mp700_ur5e_description::kDepthFrame, q);
    std::optional<HeldBrick> brick;
    if (frame % 2 == 1) {
      brick = HeldBrick{mp700_ur5e_description::kToolFrame, test::randomPose(&random, 0.2), {0.3, 0.2, 0.2}};
      // Any arm, seen from anywhere: looking at it from 0.3 m and more, turned about all axes a little.
      q = Eigen::VectorXd::NullaryExpr(q.size(), [&](Eigen::Index) { return angle(random); });
      const Eigen::Isometry3d anywhere = test::randomPose(&random, 0.0);
      T_root_camera = Eigen::Translation3d(0.1, 0.0, 0.6) * anywhere *
                      Eigen::Translation3d(0.0, 0.0, -distance(random)) *
                      Eigen::AngleAxisd(offset(random), Eigen::Vector3d::UnitX());
    }
    const Compared compared =
        compare(&mask, camera, T_root_camera, q, brick, test::randomImage(camera.width, camera.height, 2.0, &random));
    EXPECT_EQ(compared.wrong, 0U) << "frame " << frame;
    sum.on_border += compared.on_border;
    sum.masked += compared.masked;
    sum.kept += compared.kept;
    pixels += static_cast<std::size_t>(camera.width * camera.height);
  }
  // Borders are lines, thinner than 1e-5 m: next to no pixel lies on one. And there is something to compare.
  EXPECT_LT(sum.on_border, pixels / 1000);
  EXPECT_GT(sum.masked, pixels / 10);
  EXPECT_GT(sum.kept, pixels / 20);
}

TEST(RobotMask, AgreesWithBruteForceOnShapesAboutTheImagePlane) {
  std::mt19937_64 random(2);
  const CameraModel camera{48, 40, 20.0, 24.0, 20.0, 30.0};  // wide: 100 degrees and more
  RobotMaskConfig config;
  config.edge_px = 1;
  std::size_t straddling = 0;
  std::size_t masked = 0;
  for (const char* geometry : {"<box size='0.5 0.2 0.9'/>", "<cylinder radius='0.2' length='1.2'/>",
                               "<sphere radius='0.35'/>", "<cylinder radius='0.5' length='0.02'/>"}) {
    RobotMask mask(robotOf(geometry), config);
    for (int frame = 0; frame < 40; ++frame) {
      const Eigen::Isometry3d T_root_camera = test::randomPose(&random, 0.6);
      const Compared compared = compare(&mask, camera, T_root_camera, kNoJoints, std::nullopt,
                                        test::randomImage(camera.width, camera.height, 1.5, &random));
      EXPECT_EQ(compared.wrong, 0U) << geometry << ", frame " << frame;
      const auto shapes = mask.place(T_root_camera, kNoJoints, std::nullopt);
      // Its middle is behind the camera, and still it is seen.
      straddling += !shapes.empty() && shapes.front().T_camera_shape.translation().z() < 0.0 && compared.masked > 0;
      masked += compared.masked;
    }
  }
  EXPECT_GT(straddling, 10U);
  EXPECT_GT(masked, 20000U);
}

TEST(RobotMask, AgreesWithBruteForceForCamerasOfAllSizes) {
  std::mt19937_64 random(3);
  const auto robot = shippedRobot();
  std::uniform_int_distribution<int> size(16, 70);
  std::uniform_real_distribution<double> share(-0.5, 1.5);
  std::uniform_real_distribution<double> focal(0.3, 3.0);
  std::uniform_int_distribution<int> edge(0, 6);
  for (int frame = 0; frame < 20; ++frame) {
    RobotMaskConfig config;
    config.edge_px = edge(random);
    config.baseline_m = frame % 3 == 0 ? 0.0 : 0.03;
    RobotMask mask(robot, config);
    for (int view = 0; view < 2; ++view) {  // the second with the first one's buffers
      const int width = size(random);
      const int height = size(random);
      const CameraModel camera{
          width, height, width * focal(random), width * focal(random), width * share(random), height * share(random)};
      Eigen::Isometry3d T_root_camera = test::randomPose(&random, 1.5);
      const Compared compared = compare(&mask, camera, T_root_camera, positions(*robot, test::kArmInView), std::nullopt,
                                        test::randomImage(width, height, 2.0, &random));
      EXPECT_EQ(compared.wrong, 0U) << width << " x " << height << ", edge " << config.edge_px;
    }
  }
}

TEST(RobotMask, SilhouetteOfASphereIsTheAnalyticOne) {
  // Seen from d, a sphere fills the directions within asin(r / d) of its middle.
  constexpr double kRadius_m = 0.3;
  constexpr double kDistance_m = 1.2;
  RobotMask mask(robotOf("<sphere radius='0.3'/>"), exactConfig());
  DepthImage image = constantImage(kCamera, 5.0F);
  mask.apply(kCamera, before(kDistance_m), kNoJoints, std::nullopt, &image);
  const double limit_rad = std::asin(kRadius_m / kDistance_m);
  for (int v = 0; v < kCamera.height; ++v) {
    for (int u = 0; u < kCamera.width; ++u) {
      const double off_axis_rad = std::atan(std::hypot((u - kCamera.cx) / kCamera.fx, (v - kCamera.cy) / kCamera.fy));
      if (std::abs(off_axis_rad - limit_rad) < 1e-5) continue;  // a thousandth of a pixel
      EXPECT_EQ(std::isnan(image.depth_m[at(kCamera, u, v)]), off_axis_rad < limit_rad) << u << " " << v;
    }
  }
}

TEST(RobotMask, RaysAlongACylindersAxisAreInsideForGoodOrNever) {
  const CameraModel camera{161, 121, 130.0, 130.0, 80.0, 60.0};  // the ray of the middle pixel is the optical axis
  for (const double aside_m : {0.0, 0.05, 0.15}) {
    RobotMask mask(robotOf("<cylinder radius='0.1' length='0.4'/>"), exactConfig());
    Eigen::Isometry3d T_root_camera = before(1.0);
    T_root_camera.translation().x() = aside_m;
    DepthImage image = constantImage(camera, 5.0F);
    mask.apply(camera, T_root_camera, kNoJoints, std::nullopt, &image);
    EXPECT_EQ(std::isnan(image.depth_m[at(camera, 80, 60)]), aside_m < 0.1) << aside_m;
  }
}

TEST(RobotMask, WhatHidesTheRobotIsKeptAndWhatTheRobotHidesIsNot) {
  RobotMask mask(robotOf("<box size='1 1 0.2'/>"), exactConfig());  // its front is at 0.9 m
  const std::vector<std::pair<float, bool>> kept = {{0.5F, true},   {0.899F, true}, {0.901F, false}, {1.5F, false},
                                                    {0.0F, false},  {kInf, false},  {-kInf, false},  {kNaN, false},
                                                    {-0.2F, false}, {1e-4F, true}};
  for (const auto& [value, is_kept] : kept) {
    DepthImage image = constantImage(kCamera, value);
    const MaskStatistics statistics = mask.apply(kCamera, before(1.0), kNoJoints, std::nullopt, &image);
    const float middle = image.depth_m[at(kCamera, 80, 60)];
    EXPECT_TRUE(isSameValue(middle, is_kept ? value : kNaN)) << value << " became " << middle;
    // Beside the box nothing changes: 1 m at 0.9 m is 144 px of the 160.
    EXPECT_TRUE(isSameValue(image.depth_m[at(kCamera, 2, 60)], value)) << value;
    EXPECT_EQ(is_kept ? statistics.in_front_px : statistics.masked_px, 144U * 120U) << value;
    EXPECT_EQ(is_kept ? statistics.masked_px : statistics.in_front_px, 0U) << value;
  }
}

TEST(RobotMask, NoiseIsNoObjectBeforeTheRobot) {
  RobotMaskConfig config = exactConfig();
  config.noise_sigmas = 5.0;
  config.noise = {0.001, 0.002, 0.003};
  RobotMask mask(robotOf("<box size='1 1 0.2'/>"), config);
  const double front_m = 0.9;
  const double sigma_m = 0.001 + 0.002 * front_m + 0.003 * front_m * front_m;
  for (const double sigmas : {4.9, 5.1}) {
    DepthImage image = constantImage(kCamera, static_cast<float>(front_m - sigmas * sigma_m));
    mask.apply(kCamera, before(1.0), kNoJoints, std::nullopt, &image);
    EXPECT_EQ(std::isnan(image.depth_m[at(kCamera, 80, 60)]), sigmas < 5.0) << sigmas;
  }
}

/// Width of what is masked in the middle row [px].
int maskedWidth(const RobotMaskConfig& config, double distance_m, const char* geometry = "<box size='0.3 1 0.2'/>") {
  RobotMask mask(robotOf(geometry), config);
  DepthImage image = constantImage(kCamera, 50.0F);
  mask.apply(kCamera, before(distance_m), kNoJoints, std::nullopt, &image);
  int width = 0;
  for (int u = 0; u < kCamera.width; ++u) width += std::isnan(image.depth_m[at(kCamera, u, 60)]) ? 1 : 0;
  return width;
}

TEST(RobotMask, PaddingIsMetresAtTheShape) {
  // 0.3 m at a front of 0.9 m: 43.3 px, that is the 44 centres at +-0.5 ... +-21.5 px. With 2 cm: 0.34 m at 0.88 m, 50.2 px.
  RobotMaskConfig config = exactConfig();
  EXPECT_EQ(maskedWidth(config, 1.0), 44);
  config.padding_m = 0.02;
  EXPECT_EQ(maskedWidth(config, 1.0), 50);
  // With 0.1 rad of the 1 m to the middle and the 0.532 m from there to a corner: 0.153 m, 0.606 m at 0.747 m, 105.6 px.
  config = exactConfig();
  config.padding_rad = 0.1;
  EXPECT_EQ(maskedWidth(config, 1.0), 106);
}

TEST(RobotMask, EdgesSpreadByPixels) {
  RobotMaskConfig config = exactConfig();
  const int width = maskedWidth(config, 1.0);
  config.edge_px = 3;
  EXPECT_EQ(maskedWidth(config, 1.0), width + 6);
}

TEST(RobotMask, HolesBesideTheRobotAreItsShadow) {
  RobotMaskConfig config = exactConfig();
  config.baseline_m = 0.05;
  RobotMask mask(robotOf("<box size='0.3 1 0.2'/>"), config);
  DepthImage image = constantImage(kCamera, 0.0F);
  for (std::size_t i = 0; i < image.depth_m.size(); i += 2) image.depth_m[i] = 3.0F;  // every other column is measured
  const MaskStatistics statistics = mask.apply(kCamera, before(1.0), kNoJoints, std::nullopt, &image);
  // Disparity at 0.9 m: 130 * 0.05 / 0.9 = 7.2 px, and 2 more: 9 pixels beyond the 44 in columns 58 to 101.
  for (int u = 0; u < kCamera.width; ++u) {
    const bool is_robot = u >= 58 && u <= 101;
    const bool is_shadow = u % 2 == 1 && u >= 49 && u <= 110;
    EXPECT_EQ(std::isnan(image.depth_m[at(kCamera, u, 60)]), is_robot || is_shadow) << u;
  }
  EXPECT_EQ(statistics.shadow_px, 120U * (5 + 4));
}

TEST(RobotMask, AnObjectBeforeTheRobotThrowsNoShadowOfTheRobot) {
  RobotMaskConfig config = exactConfig();
  config.baseline_m = 0.05;
  RobotMask mask(robotOf("<box size='0.3 1 0.2'/>"), config);
  DepthImage image = constantImage(kCamera, 0.4F);
  image.depth_m[at(kCamera, 56, 60)] = 0.0F;
  mask.apply(kCamera, before(1.0), kNoJoints, std::nullopt, &image);
  EXPECT_EQ(image.depth_m[at(kCamera, 56, 60)], 0.0F);
}

TEST(RobotMask, WhatCarriesTheCameraDoesNotBlindIt) {
  const auto robot = shippedRobot();
  const Eigen::VectorXd q = positions(*robot, {0.0, -2.5, 2.4, -1.5, -1.57, 0.0});
  const Eigen::Isometry3d T_root_camera = robot->framePose(mp700_ur5e_description::kDepthFrame, q);
  const CameraModel camera{160, 120, 131.25, 131.25, 79.5, 59.5};
  // The housing ends 2 mm, the mast 1 cm behind the optical centre: paddings of any size stay behind it. The arm is beside
  // the view; what is in view of the base keeps below a quarter of it.
  for (const double padding_m : {0.0, 0.01, 0.1}) {
    RobotMaskConfig config;
    config.padding_m = padding_m;
    RobotMask mask(robot, config);
    for (const PlacedShape& placed : mask.place(T_root_camera, q, std::nullopt)) {
      EXPECT_GT(test::signedDistance(placed.shape, placed.T_camera_shape.inverse() * Eigen::Vector3d::Zero()), 0.0);
    }
    DepthImage image = constantImage(camera, 3.0F);
    const MaskStatistics statistics = mask.apply(camera, T_root_camera, q, std::nullopt, &image);
    EXPECT_LT(statistics.masked_px, 160U * 120U / 4) << padding_m;
  }
  // A camera whose optical centre is inside of its housing.
  RobotMask mask(robotOf("<box size='0.1 0.1 0.1'/>"), RobotMaskConfig());
  DepthImage image = constantImage(camera, 3.0F);
  EXPECT_EQ(mask.apply(camera, before(0.02), kNoJoints, std::nullopt, &image).masked_px, 0U);
  EXPECT_GT(mask.apply(camera, before(0.2), kNoJoints, std::nullopt, &image).masked_px, 0U);
}

TEST(RobotMask, ShapesBehindTheCameraAreNotSeen) {
  Eigen::Isometry3d T_root_camera = before(1.0);
  T_root_camera.rotate(Eigen::AngleAxisd(3.14159265358979, Eigen::Vector3d::UnitX()));
  for (const char* geometry :
       {"<box size='0.3 1 0.2'/>", "<cylinder radius='0.3' length='1'/>", "<sphere radius='0.3'/>"}) {
    RobotMask mask(robotOf(geometry), RobotMaskConfig());
    DepthImage image = constantImage(kCamera, 3.0F);
    EXPECT_EQ(mask.apply(kCamera, T_root_camera, kNoJoints, std::nullopt, &image).masked_px, 0U) << geometry;
  }
}

TEST(RobotMask, TheBrickInTheHandGoesWithTheTool) {
  const auto robot = shippedRobot();
  RobotMask mask(robot, RobotMaskConfig());
  Eigen::VectorXd q = positions(*robot, test::kArmInView);
  const CameraModel camera{160, 120, 131.25, 131.25, 79.5, 59.5};
  const Eigen::Isometry3d T_root_camera = robot->framePose(mp700_ur5e_description::kDepthFrame, q);
  HeldBrick brick{mp700_ur5e_description::kToolFrame, Eigen::Isometry3d::Identity(), {0.3, 0.2, 0.2}};
  brick.T_frame_brick.translation().z() = 0.2;
  // Of the brick's corners in view: how many are masked.
  const auto maskedCorners = [&](const std::optional<HeldBrick>& held, int* in_view) {
    DepthImage image = constantImage(camera, 5.0F);
    mask.apply(camera, T_root_camera, q, held, &image);
    int masked = 0;
    *in_view = 0;
    for (int i = 0; i < 8; ++i) {
      const Eigen::Vector3d corner((i & 1) != 0 ? 0.15 : -0.15, (i & 2) != 0 ? 0.1 : -0.1, (i & 4) != 0 ? 0.1 : -0.1);
      const Eigen::Vector3d p =
          T_root_camera.inverse() * robot->framePose(brick.frame, q) * (brick.T_frame_brick * corner);
      const int u = static_cast<int>(std::lround(camera.fx * p.x() / p.z() + camera.cx));
      const int v = static_cast<int>(std::lround(camera.fy * p.y() / p.z() + camera.cy));
      if (u < 0 || u >= camera.width || v < 0 || v >= camera.height) continue;
      ++*in_view;
      masked += std::isnan(image.depth_m.at(at(camera, u, v))) ? 1 : 0;
    }
    return masked;
  };
  for (const double turn_rad : {0.0, -0.15, -0.1}) {  // of the arm, and the brick with it
    q[static_cast<Eigen::Index>(robot->jointIndex("shoulder_pan_joint"))] += turn_rad;
    int in_view = 0;
    const int without = maskedCorners(std::nullopt, &in_view);
    EXPECT_GE(in_view, 5);
    EXPECT_LE(without, in_view - 2) << "the arm hides it";
    EXPECT_EQ(maskedCorners(brick, &in_view), in_view);
  }
}

/// The message with which it is refused; the image must stay as it was.
std::string refusal(const CameraModel& camera, const Eigen::Isometry3d& T_root_camera, const Eigen::VectorXd& q,
                    const std::optional<HeldBrick>& brick, DepthImage image) {
  static const auto kRobot = shippedRobot();
  RobotMask mask(kRobot, RobotMaskConfig());
  const DepthImage before_it = image;
  try {
    mask.apply(camera, T_root_camera, q, brick, &image);
  } catch (const std::invalid_argument& error) {
    EXPECT_TRUE(std::equal(image.depth_m.begin(), image.depth_m.end(), before_it.depth_m.begin(), isSameValue));
    return error.what();
  }
  return "";
}

TEST(RobotMask, BadArgumentsAreNamedAndChangeNothing) {
  const auto robot = shippedRobot();
  const Eigen::VectorXd q = positions(*robot, test::kArmInView);
  const Eigen::Isometry3d T = robot->framePose(mp700_ur5e_description::kDepthFrame, q);
  const DepthImage image = constantImage(kCamera, 1.0F);
  const HeldBrick good{mp700_ur5e_description::kToolFrame, Eigen::Isometry3d::Identity(), {0.3, 0.2, 0.2}};
  EXPECT_EQ(refusal(kCamera, T, q, good, image), "");

  EXPECT_THAT(refusal(kCamera, T, q.head(5), {}, image), HasSubstr("5 joint positions"));
  Eigen::VectorXd bad_q = q;
  bad_q[2] = kNaN;
  EXPECT_THAT(refusal(kCamera, T, bad_q, {}, image), HasSubstr("joint positions are not finite"));
  Eigen::Isometry3d bad_T = T;
  bad_T.translation().x() = kInf;
  EXPECT_THAT(refusal(kCamera, bad_T, q, {}, image), HasSubstr("camera's pose"));
  bad_T = T;
  bad_T.linear() *= 1.1;
  EXPECT_THAT(refusal(kCamera, bad_T, q, {}, image), HasSubstr("camera's pose"));
  CameraModel bad_camera = kCamera;
  bad_camera.fx = 0.0;
  EXPECT_THAT(refusal(bad_camera, T, q, {}, image), HasSubstr("fx = 0 px"));
  bad_camera = kCamera;
  bad_camera.width = 161;
  EXPECT_THAT(refusal(bad_camera, T, q, {}, image), HasSubstr("161 x 120"));
  HeldBrick bad = good;
  bad.frame = "hand";
  EXPECT_THAT(refusal(kCamera, T, q, bad, image), HasSubstr("frame 'hand', must be a link of the URDF"));
  bad = good;
  bad.size_m.y() = 0.0;
  EXPECT_THAT(refusal(kCamera, T, q, bad, image), HasSubstr("must be in (0, 2] m"));
  bad.size_m.y() = kNaN;
  EXPECT_THAT(refusal(kCamera, T, q, bad, image), HasSubstr("must be in (0, 2] m"));
  bad = good;
  bad.T_frame_brick.linear() *= 0.5;
  EXPECT_THAT(refusal(kCamera, T, q, bad, image), HasSubstr("no rotation"));
}

TEST(RobotMask, ImpossibleConfigurationsAreRefused) {
  EXPECT_THAT(interactive_mapping::problemsOf(RobotMaskConfig()), IsEmpty());
  RobotMaskConfig config;
  config.padding_m = -0.01;
  config.edge_px = 21;
  config.noise.c_per_m = kNaN;
  EXPECT_THAT(interactive_mapping::problemsOf(config),
              ElementsAre("padding_m = -0.01 m, must be in [0, 0.5] m", "edge_px = 21 px, must be in [0, 20] px",
                          "noise/c_per_m = nan 1/m, must be in [0, 0.1] 1/m"));
  EXPECT_THROW(RobotMask(shippedRobot(), config), std::invalid_argument);
  EXPECT_THROW(RobotMask(nullptr, RobotMaskConfig()), std::invalid_argument);
}

TEST(MovesShapes, OnlyWheelsMoveNone) {
  const auto robot = shippedRobot();
  for (std::size_t joint = 0; joint < robot->joints().size(); ++joint) {
    const std::string& name = robot->joints()[joint].name;
    EXPECT_EQ(movesShapes(*robot, joint), name.find("wheel") == std::string::npos) << name;
  }
  EXPECT_GT(robot->joints().size(), 7U);
}

TEST(MovesShapes, AnEndlessJointDoesUnlessAllIsRoundAboutItsAxis) {
  const auto moves = [](const std::string& collision) {
    return movesShapes(*RobotModel::parse("<robot name='r'><link name='a'/><link name='b'><collision>" + collision +
                                              "</collision></link><joint name='j' type='continuous'><parent link='a'/>"
                                              "<child link='b'/><axis xyz='0 0 1'/></joint></robot>",
                                          "r"),
                       0);
  };
  EXPECT_FALSE(moves("<geometry><cylinder radius='0.1' length='0.2'/></geometry>"));
  EXPECT_FALSE(moves("<origin xyz='0 0 0.3'/><geometry><cylinder radius='0.1' length='0.2'/></geometry>"));
  EXPECT_FALSE(moves("<geometry><sphere radius='0.1'/></geometry>"));
  EXPECT_TRUE(moves("<origin xyz='0.01 0 0'/><geometry><cylinder radius='0.1' length='0.2'/></geometry>"));
  EXPECT_TRUE(moves("<origin rpy='0.1 0 0'/><geometry><cylinder radius='0.1' length='0.2'/></geometry>"));
  EXPECT_TRUE(moves("<origin xyz='0 0.01 0'/><geometry><sphere radius='0.1'/></geometry>"));
  EXPECT_TRUE(moves("<geometry><box size='0.1 0.1 0.1'/></geometry>"));
}

}  // namespace
}  // namespace depth_self_filter
