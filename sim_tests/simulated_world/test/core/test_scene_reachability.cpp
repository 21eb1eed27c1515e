// SPDX-License-Identifier: BSD-3-Clause
// Scenes are made to be cleared: what lies on top can be touched by the magnet from somewhere beside the pile.
#include <algorithm>

#include <gtest/gtest.h>

#include "arm_reach.h"
#include "brick_types.h"
#include "simulated_world/box_separation.h"
#include "simulated_world/settle.h"

namespace simulated_world {
namespace test {
namespace {

// The solver's tolerance of 1e-7, and the digits of pi in the URDF.
constexpr double kTipTolerance_m = 1e-5;

/// How many there are: counted, so that a test which looks at none fails.
int topmostThatAreReached(const std::string& scene, std::uint64_t seed) {
  const std::vector<BrickPlacement> bricks = settlePile(world(scene), seed).scene.bricks;
  ArmReach arm(bricks);
  int reached = 0;
  for (const BrickPlacement& brick : bricks) {
    if (!arm.isTopmost(brick)) continue;
    const std::optional<Reach> reach = arm.find(brick);
    if (!reach) {
      ADD_FAILURE() << scene << ", seed " << seed << ": brick " << brick.id << " at "
                    << brick.T_map_brick.translation().transpose() << " m is out of reach";
      continue;
    }
    // By other kinematics than the solver's: the tip is in the middle of a face and looks into it.
    const Eigen::Isometry3d T_brick_tip = brick.T_map_brick.inverse() * arm.tip(*reach);
    const Eigen::Vector3d inwards = T_brick_tip.linear().col(2);
    const Eigen::Vector3d face = -0.5 * brick.type.size_m.cwiseProduct(inwards);
    EXPECT_NEAR(inwards.cwiseAbs().maxCoeff(), 1.0, kTipTolerance_m) << scene << ", brick " << brick.id;
    EXPECT_LT((T_brick_tip.translation() - face).norm(), kTipTolerance_m) << scene << ", brick " << brick.id;
    ++reached;
  }
  return reached;
}

TEST(SceneReachability, TopmostBricksOfTheHeapAreReached) {
  for (const std::uint64_t seed : {1U, 2U}) EXPECT_GE(topmostThatAreReached("one_heap", seed), 3);  // its top layer
}

TEST(SceneReachability, TopmostBricksOfTheRidgesAreReached) {
  for (const std::uint64_t seed : {1U, 2U}) EXPECT_GE(topmostThatAreReached("two_ridges", seed), 6);
}

TEST(SceneReachability, TopmostBricksOfThreeHeapsAreReached) {
  for (const std::uint64_t seed : {1U, 2U}) EXPECT_GE(topmostThatAreReached("three_heaps", seed), 6);
}

TEST(SceneReachability, TopmostBricksOfTheRowsAreReached) {
  // The two on top; each lies on two of the lower rows, of which the outer four stay free.
  for (const std::uint64_t seed : {1U, 2U}) EXPECT_EQ(topmostThatAreReached("two_rows", seed), 6);
}

TEST(SceneReachability, TopmostBricksOfTinyScenesAreReached) {
  EXPECT_EQ(topmostThatAreReached("single_brick", 1), 1);
  EXPECT_EQ(topmostThatAreReached("two_stacked", 1), 1);
  EXPECT_EQ(topmostThatAreReached("three_pyramid", 1), 1);
  for (const std::uint64_t seed : {1U, 2U}) EXPECT_EQ(topmostThatAreReached("four_bricks", seed), 4);
  EXPECT_EQ(topmostThatAreReached("wall", 1), 3);
}

// The check itself.

TEST(ArmReach, ABrickInTheMiddleOfAWideFieldIsOutOfReach) {
  // 13 x 9 bricks, 3.9 m x 1.8 m wide: 1.3 m from the middle one to the robot's shoulder at least.
  std::vector<BrickPlacement> bricks;
  for (int row = -6; row <= 6; ++row) {
    for (int column = -4; column <= 4; ++column) {
      bricks.push_back(brickAt(static_cast<int>(bricks.size()), {0.3 * row, 0.2 * column, 0.1}));
    }
  }
  ArmReach arm(bricks);
  EXPECT_FALSE(arm.find(bricks[bricks.size() / 2]));
  EXPECT_TRUE(arm.find(bricks.front()));
}

TEST(ArmReach, ABrickUnderARoofIsOutOfReachFromAbove) {
  // The middle of its top is covered by the brick across it, and its sides are by those around.
  const std::vector<BrickPlacement> bricks = {
      brickAt(0, {0.0, 0.0, 0.1}),   brickAt(1, {0.0, 0.0, 0.3}, M_PI_2),  brickAt(2, {0.0, 0.21, 0.1}),
      brickAt(3, {0.0, -0.21, 0.1}), brickAt(4, {0.26, 0.0, 0.1}, M_PI_2), brickAt(5, {-0.26, 0.0, 0.1}, M_PI_2)};
  ArmReach arm(bricks);
  EXPECT_FALSE(arm.isTopmost(bricks[0]));
  EXPECT_TRUE(arm.isTopmost(bricks[1]));
  EXPECT_FALSE(arm.isTopmost(bricks[2]));  // carries the roof's end
  EXPECT_TRUE(arm.isTopmost(bricks[4]));
  EXPECT_FALSE(arm.find(bricks[0]));
  EXPECT_TRUE(arm.find(bricks[1]));
}

TEST(ArmReach, StandsBeforeThePile) {
  const std::vector<BrickPlacement> bricks = settlePile(world("two_ridges"), 1).scene.bricks;
  const ArmReach arm(bricks);
  // Footprint of config/base_profile.yaml in a box, as high as the world.
  const Eigen::Vector3d size_m(0.851, 0.62, 4.0);
  int num_poses = 0;
  for (const Pose2d& pose : arm.standingPoses(bricks.front())) {
    Eigen::Isometry3d T_map_box = Eigen::Isometry3d::Identity();
    T_map_box.translation() << pose.x_m, pose.y_m, 0.0;
    T_map_box.rotate(Eigen::AngleAxisd(pose.yaw_rad, Eigen::Vector3d::UnitZ()));
    T_map_box.translate(Eigen::Vector3d(0.5 * (0.296 - 0.555), 0.5 * (0.305 - 0.315), 0.0));
    double gap_m = 1e9;
    for (const BrickPlacement& brick : bricks) {
      gap_m = std::min(gap_m, boxSeparation(T_map_box, size_m, brick.T_map_brick, brick.type.size_m));
    }
    // A separating axis is a lower bound of the distance: corner to corner it may be short by a factor of sqrt(2).
    EXPECT_GT(gap_m, 0.05 / std::sqrt(2.0) - 1e-6);
    EXPECT_LT(gap_m, std::hypot(0.30, 0.05) + 1e-6);  // corner to corner
    ++num_poses;
  }
  EXPECT_GT(num_poses, 300);
}

TEST(ArmReach, SeesABrickInTheArmsWay) {
  const std::vector<BrickPlacement> bricks = {brickAt(0, {0.0, 0.0, 0.1}), brickAt(1, {10.0, 0.0, 0.1})};
  ArmReach arm(bricks);
  const std::optional<Reach> reach = arm.find(bricks[0]);
  ASSERT_TRUE(reach);
  EXPECT_TRUE(arm.collisions(*reach, 0).empty());
  EXPECT_FALSE(arm.collisions(*reach, 1).empty());  // touching what is not the target
  const Eigen::Isometry3d T_map_tip = arm.tip(*reach);
  arm.moveBrick(1, T_map_tip * Eigen::Vector3d(0.0, 0.0, -0.25));  // where the wrist is
  const std::set<std::string> touched = arm.collisions(*reach, 0);
  EXPECT_TRUE(std::any_of(touched.begin(), touched.end(),
                          [](const std::string& pair) { return pair.find("brick_1 - ur5e_wrist") == 0; }));
}

}  // namespace
}  // namespace test
}  // namespace simulated_world
