// SPDX-License-Identifier: BSD-3-Clause
// The physics with the real robot model: servos, magnet, contacts, sleep.
#include "simulated_world/world.h"

#include <cmath>
#include <stdexcept>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

#include "simulated_world/robot_mjcf.h"
#include "simulated_world/testing/robot_in_world.h"

namespace simulated_world {
namespace {

using test_support::messageOf;
using ::testing::HasSubstr;

const std::string kUrdf = MP700_UR5E_DESCRIPTION_DIR "/urdf/mp700_ur5e.urdf";

// Folded, tool pointing down (config/arm_poses/stowed.yaml of the description).
ArmVector stowedArm() {
  return (ArmVector() << 0.0, -2.0, 2.4, -1.9707963267948966, -M_PI_2, 0.0).finished();
}

std::string robotBody() {
  RobotMjcfOptions options;
  options.arm.damping = 0.0;
  return robotMjcfFromFile(kUrdf, options);
}

WorldBrick brickAt(int id, const Eigen::Vector3d& centre_map) {
  WorldBrick brick;
  brick.placement.id = id;
  brick.placement.type = {"brick", {0.30, 0.20, 0.20}, 1.0, 0.6};
  brick.placement.T_map_brick.translation() = centre_map;
  return brick;
}

World makeWorld(const std::vector<WorldBrick>& bricks, const WorldConfig& config = {}, const Pose2d& start = {}) {
  return World(robotBody(), "", bricks, start, stowedArm(), config);
}

void run(World& world, double seconds) {
  const int steps = static_cast<int>(std::lround(seconds / world.config().physics.timestep_s));
  for (int i = 0; i < steps; ++i) {
    world.step();
  }
  world.refreshPoses();
}

// Moves the arm along a straight line in joint space at rest-to-rest speed; returns the largest deviation on the way.
double moveArm(World& world, const ArmVector& goal, double seconds) {
  const ArmVector start = world.armPosition();
  const double dt = world.config().physics.timestep_s;
  const int steps = static_cast<int>(std::lround(seconds / dt));
  double worst = 0.0;
  // Smooth from rest to rest, acceleration included.
  const auto reference = [&](double share, ArmVector* velocity, ArmVector* acceleration) {
    const double s = share;
    *velocity = 30.0 * s * s * (1.0 - s) * (1.0 - s) / seconds * (goal - start);
    *acceleration = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / (seconds * seconds) * (goal - start);
    return ArmVector(start + s * s * s * (10.0 - 15.0 * s + 6.0 * s * s) * (goal - start));
  };
  ArmVector velocity;
  ArmVector acceleration;
  for (int i = 0; i < steps; ++i) {
    const ArmVector position = reference(static_cast<double>(i) / steps, &velocity, &acceleration);
    worst = std::max(worst, (position - world.armPosition()).cwiseAbs().maxCoeff());
    world.setArmReference(position, velocity, acceleration);
    world.step();
  }
  world.setArmReference(goal, ArmVector::Zero(), ArmVector::Zero());
  world.refreshPoses();
  return worst;
}

ArmVector toolDownAt(World& world, double reach_m, double height_m) {
  ToolDown tool(world.model());
  const ArmVector q = tool.angles(reach_m, height_m);
  EXPECT_LT(tool.tipError(), 1e-6);
  return q;
}

Eigen::Vector3d tipPosition(World& world) {
  return world.linkPose("magnet_tip").translation();
}

constexpr double kReach_m = 0.75;  // of base_link: in front of the robot, clear of its nose
// The arm's plane lies beside its base: shoulder and wrist offsets put the tool 0.13 m off the middle.
double toolY(World& world) {
  ToolDown tool(world.model());
  return tool.tip(tool.angles(kReach_m, 0.5)).y();
}

TEST(World, ArmFollowsItsReference) {
  World world = makeWorld({});
  const ArmVector goal = toolDownAt(world, kReach_m, 0.6);
  // Computed torque on the exact model: what is left is the integrator's error, microradians to tenths of a milliradian.
  EXPECT_LT(moveArm(world, goal, 2.0), 1e-3);
  run(world, 0.5);
  EXPECT_LT((world.armPosition() - goal).cwiseAbs().maxCoeff(), 1e-4);
  EXPECT_LT(world.armVelocity().cwiseAbs().maxCoeff(), 1e-3);
  EXPECT_NEAR(tipPosition(world).z(), 0.6, 1e-4);
}

TEST(World, ArmStandsStillWithoutCommands) {
  World world = makeWorld({});
  const ArmVector before = world.armPosition();
  run(world, 5.0);
  EXPECT_LT((world.armPosition() - before).cwiseAbs().maxCoeff(), 1e-5);
  EXPECT_NEAR(world.basePose().x_m, 0.0, 1e-4);
  EXPECT_TRUE(world.takeTouches().empty()) << "the folded robot touches nothing, itself included";
}

TEST(World, BaseDrivesTheArcItIsAskedFor) {
  World world = makeWorld({});
  for (int i = 0; i < 2000; ++i) {  // 4 s, up to speed over one second
    const double ramp = std::min(1.0, i * 0.002);
    world.setBaseTwist({0.4 * ramp, 0.3 * ramp});
    world.step();
  }
  world.refreshPoses();
  Pose2d expected;
  for (int i = 0; i < 2000; ++i) {
    const double ramp = std::min(1.0, i * 0.002);
    expected = moveAlongArc(expected, {0.4 * ramp, 0.3 * ramp}, 0.002);
  }
  // 2 mm and 2 mrad: the servo lags by some acceleration / bandwidth^2 (0.4 / 2500 = 0.2 mm) and the arm sways.
  EXPECT_NEAR(world.basePose().x_m, expected.x_m, 0.002);
  EXPECT_NEAR(world.basePose().y_m, expected.y_m, 0.002);
  EXPECT_NEAR(world.basePose().yaw_rad, expected.yaw_rad, 0.002);
  EXPECT_NEAR(world.baseTwist().linear_m_s, 0.4, 0.004);
}

TEST(World, BlockedBaseStands) {
  // A heavy block before the nose: 700 N of traction do not move 400 kg at friction 0.6.
  WorldBrick block = brickAt(0, {0.9, 0.0, 0.5});
  block.placement.type.size_m = {0.8, 1.0, 1.0};
  block.placement.type.mass_kg = 400.0;
  World world = makeWorld({block});
  world.setBaseTwist({0.3, 0.0});
  run(world, 4.0);
  EXPECT_LT(world.basePose().x_m, 0.25) << "0.204 m of free way to the block";
  bool touched = false;
  for (const RobotTouch& touch : world.takeTouches()) {
    touched |= touch.brick_id == 0 && touch.force_N > 100.0;
  }
  EXPECT_TRUE(touched);
  // Its wheels were spinning: no way is left to be made up for.
  const double blocked_m = world.basePose().x_m;
  world.setBaseTwist({-0.3, 0.0});
  run(world, 1.0);
  EXPECT_LT(world.basePose().x_m, blocked_m - 0.25);
}

TEST(World, ToolFeelsWhatPushesIt) {
  World world = makeWorld({});
  moveArm(world, toolDownAt(world, kReach_m, 0.15), 3.0);
  run(world, 0.5);
  // The weight of the tool is taken out.
  EXPECT_LT(world.toolWrench().force_N.norm(), 0.05);
  // Two millimetres into the ground: it pushes up, against the tool's z.
  ArmVector low = toolDownAt(world, kReach_m, -0.002);
  moveArm(world, toolDownAt(world, kReach_m, 0.01), 1.0);
  moveArm(world, low, 1.0);
  run(world, 0.5);
  EXPECT_LT(world.toolWrench().force_N.z(), -5.0);
  bool ground = false;
  for (const RobotTouch& touch : world.takeTouches()) {
    ground |= touch.robot_body == "magnet" && touch.other_body == "ground";
  }
  EXPECT_TRUE(ground);
  EXPECT_GT(world.armPush().cwiseAbs().maxCoeff(), 1.0);
}

class Magnet : public testing::Test {
 protected:
  // A brick lies under the tool; its top is at 0.2 m.
  World worldWithBrick(const WorldConfig& config = {}, double offset_x_m = 0.0) {
    World probe = makeWorld({});
    return makeWorld({brickAt(7, {kReach_m + offset_x_m, toolY(probe), 0.1})}, config);
  }

  void lowerTo(World& world, double tip_height_m) {
    moveArm(world, toolDownAt(world, kReach_m, 0.3), 2.0);
    moveArm(world, toolDownAt(world, kReach_m, tip_height_m), 2.0);
    run(world, 0.2);
  }

  void lift(World& world) {
    moveArm(world, toolDownAt(world, kReach_m, 0.5), 2.0);
    run(world, 0.3);
  }
};

TEST_F(Magnet, LiftsABrickItTouches) {
  World world = worldWithBrick();
  lowerTo(world, 0.2 - 0.001);
  world.setMagnet(true);
  run(world, 0.1);
  ASSERT_EQ(world.heldBrick(), 7);
  lift(world);
  ASSERT_EQ(world.heldBrick(), 7);
  EXPECT_NEAR(world.brick(7)->T_map_brick.translation().z(), 0.4, 0.005);
  // Its weight hangs on the tool; the tool points down, so along its z.
  EXPECT_NEAR(world.toolWrench().force_N.z(), 9.81, 0.3);
  world.setPayload(1.0, {0.0, 0.0, 0.2});
  run(world, 0.5);
  EXPECT_LT(world.toolWrench().force_N.norm(), 0.3) << "the declared payload is taken out";
  world.setMagnet(false);
  run(world, 1.0);
  EXPECT_FALSE(world.heldBrick().has_value());
  EXPECT_LT(world.brick(7)->T_map_brick.translation().z(), 0.2);
  ASSERT_TRUE(world.takeRelease().has_value());
  EXPECT_FALSE(world.takeRelease().has_value()) << "told once";
}

TEST_F(Magnet, DoesNotLiftWithoutContact) {
  World world = worldWithBrick();
  lowerTo(world, 0.2 + 0.003);
  world.setMagnet(true);
  run(world, 0.5);
  EXPECT_FALSE(world.heldBrick().has_value());
  lift(world);
  EXPECT_NEAR(world.brick(7)->T_map_brick.translation().z(), 0.1, 0.001);
}

TEST_F(Magnet, DoesNotLiftWhenOff) {
  World world = worldWithBrick();
  lowerTo(world, 0.2 - 0.001);
  lift(world);
  EXPECT_NEAR(world.brick(7)->T_map_brick.translation().z(), 0.1, 0.001);
}

TEST_F(Magnet, HoldsOnThePlateOnly) {
  // The plate ends 0.085 m from the face's middle; the face reaches to 0.15 m.
  World world = worldWithBrick({}, 0.11);
  lowerTo(world, 0.2 - 0.001);
  world.setMagnet(true);
  run(world, 0.5);
  EXPECT_FALSE(world.heldBrick().has_value());
}

TEST_F(Magnet, HoldsOnFacesWithAPlateOnly) {
  World probe = makeWorld({});
  WorldBrick brick = brickAt(7, {kReach_m, toolY(probe), 0.1});
  for (const bool has_top_plate : {true, false}) {
    brick.has_plate = {false, false, false, false, has_top_plate, !has_top_plate};  // top or bottom
    World world = makeWorld({brick});
    lowerTo(world, 0.2 - 0.001);
    world.setMagnet(true);
    run(world, 0.5);
    EXPECT_EQ(world.heldBrick().has_value(), has_top_plate);
  }
}

TEST_F(Magnet, WeakOneComesOff) {
  World world = worldWithBrick();
  world.setMagnetStrength(0.05);  // 4.5 N for 9.8 N of brick
  lowerTo(world, 0.2 - 0.001);
  world.setMagnet(true);
  run(world, 0.1);
  lift(world);
  EXPECT_FALSE(world.heldBrick().has_value());
  EXPECT_NEAR(world.brick(7)->T_map_brick.translation().z(), 0.1, 0.01);
  const auto release = world.takeRelease();
  ASSERT_TRUE(release.has_value());
  EXPECT_EQ(release->reason, ReleaseReason::kPulledOff);
}

TEST_F(Magnet, LosesItsBrickOnCommandAndTakesNoneUntilSwitched) {
  World world = worldWithBrick();
  EXPECT_FALSE(world.dropHeldBrick());
  lowerTo(world, 0.2 - 0.001);
  world.setMagnet(true);
  run(world, 0.1);
  ASSERT_EQ(world.heldBrick(), 7);
  EXPECT_TRUE(world.dropHeldBrick());
  run(world, 0.2);
  EXPECT_FALSE(world.heldBrick().has_value()) << "still touching, still on";
  world.setMagnet(false);
  world.setMagnet(true);
  run(world, 0.1);
  EXPECT_EQ(world.heldBrick(), 7);
}

TEST(WorldSleep, RestingBricksSleepAndWakeWhenOneIsTaken) {
  std::vector<WorldBrick> bricks{brickAt(0, {3.0, 0.0, 0.1}), brickAt(1, {3.0, 0.0, 0.3}), brickAt(2, {5.0, 0.0, 0.1})};
  World world = makeWorld(bricks);
  EXPECT_EQ(world.numAwake(), 3);
  run(world, 1.5);
  EXPECT_EQ(world.numAwake(), 0);
  const Eigen::Vector3d top = world.brick(1)->T_map_brick.translation();
  run(world, 1.0);
  EXPECT_EQ(world.brick(1)->T_map_brick.translation(), top) << "asleep is still, to the bit";
  Eigen::Isometry3d away = Eigen::Isometry3d::Identity();
  away.translation() = Eigen::Vector3d(0.0, 3.0, 0.1);
  world.moveBrick(0, away);
  EXPECT_EQ(world.numAwake(), 2) << "the one moved and the one it carried; not the third";
  run(world, 2.0);
  EXPECT_NEAR(world.brick(1)->T_map_brick.translation().z(), 0.1, 0.002);
  EXPECT_NEAR(world.brick(0)->T_map_brick.translation().y(), 3.0, 0.002);
  EXPECT_EQ(world.numAwake(), 0);
}

TEST(WorldSleep, MovingBrickWakesWhatItHits) {
  World world = makeWorld({brickAt(0, {3.0, 0.0, 0.1}), brickAt(1, {5.0, 0.0, 0.1})});
  run(world, 1.5);
  ASSERT_EQ(world.numAwake(), 0);
  Eigen::Isometry3d above = Eigen::Isometry3d::Identity();
  above.translation() = Eigen::Vector3d(3.1, 0.05, 0.6);
  world.moveBrick(1, above);
  run(world, 2.0);
  EXPECT_GT(world.brick(1)->T_map_brick.translation().z(), 0.05) << "fell on it or beside it, never into it";
  const Eigen::Vector3d first = world.brick(0)->T_map_brick.translation();
  const Eigen::Vector3d second = world.brick(1)->T_map_brick.translation();
  EXPECT_GT((first - second).norm(), 0.199);
}

TEST(WorldSleep, DrivingRobotPushesASleepingBrick) {
  World world = makeWorld({brickAt(0, {0.9, 0.0, 0.1})});
  run(world, 1.5);
  ASSERT_EQ(world.numAwake(), 0);
  world.setBaseTwist({0.3, 0.0});
  run(world, 3.0);
  EXPECT_GT(world.brick(0)->T_map_brick.translation().x(), 1.0);
  EXPECT_NEAR(world.basePose().x_m, 0.9, 0.02) << "a kilogram does not stop it";
}

TEST(World, SameCallsSameBits) {
  std::array<std::uint64_t, 2> digests{};
  for (std::uint64_t& digest : digests) {
    World world = makeWorld({brickAt(0, {3.0, 0.0, 0.5}), brickAt(1, {3.05, 0.1, 0.8})});
    world.setBaseTwist({0.3, 0.1});
    moveArm(world, toolDownAt(world, kReach_m, 0.4), 1.0);
    run(world, 1.0);
    digest = world.digest();
  }
  EXPECT_EQ(digests[0], digests[1]);
  World other = makeWorld({brickAt(0, {3.0, 0.0, 0.5}), brickAt(1, {3.05, 0.1, 0.8000001})});
  run(other, 1.0);
  EXPECT_NE(other.digest(), digests[0]);
}

TEST(World, BrickInTheContainerIsSeenThere) {
  World world = makeWorld({brickAt(3, {2.0, 0.0, 0.1})});
  EXPECT_TRUE(world.bricksInContainer().empty());
  Eigen::Isometry3d over = Eigen::Isometry3d::Identity();
  over.translation() = world.linkPose("container_place_3").translation() + Eigen::Vector3d(0.0, 0.0, 0.05);
  world.moveBrick(3, over);
  ASSERT_EQ(world.bricksInContainer().size(), 1U);
  EXPECT_FALSE(world.bricksInContainer().front().is_seated) << "not there yet";
  run(world, 2.0);
  ASSERT_EQ(world.bricksInContainer().size(), 1U);
  EXPECT_EQ(world.bricksInContainer().front().id, 3);
  EXPECT_TRUE(world.bricksInContainer().front().is_at_rest);
  EXPECT_TRUE(world.bricksInContainer().front().is_seated);
  world.takeAwayBrick(3);
  EXPECT_TRUE(world.bricksInContainer().empty());
  EXPECT_TRUE(world.bricks().empty());
  EXPECT_THROW(world.takeAwayBrick(3), std::invalid_argument);
  run(world, 1.0);
}

TEST(World, BrickThatWasTakenAwayCanBeBroughtBack) {
  World world = makeWorld({brickAt(0, {2.0, 0.0, 0.1}), brickAt(1, {2.0, 1.0, 0.1})});
  run(world, 2.0);  // they sleep
  world.takeAwayBrick(1);
  run(world, 2.0);
  const auto at = [](double x, double y, double z) {
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.translation() << x, y, z;
    return pose;
  };
  EXPECT_EQ(world.obstacleAt(1, at(2.0, 0.05, 0.1)), "brick_0");
  EXPECT_EQ(world.obstacleAt(1, at(2.0, 1.0, 0.12)), "");
  // Beside it, 20 cm from middle to middle: 6 mm deep is inside, 4 mm is not.
  EXPECT_EQ(world.obstacleAt(1, at(2.0, 0.194, 0.1)), "brick_0");
  EXPECT_EQ(world.obstacleAt(1, at(2.0, 0.196, 0.1)), "");
  // In the ground, and of a cylinder in a brick, just so: its radius beyond the brick's face.
  EXPECT_EQ(world.obstacleAt(1, at(2.0, 1.0, 0.094)), "ground");
  EXPECT_EQ(world.obstacleAt(1, at(2.0, 1.0, 0.096)), "");
  EXPECT_EQ(world.thingAt({2.0, 0.1 + kObstacleRadius_m - 0.006}), "brick_0");
  EXPECT_EQ(world.thingAt({2.0, 0.1 + kObstacleRadius_m - 0.004}), "");
  EXPECT_TRUE(world.knowsBrick(1));
  EXPECT_FALSE(world.knowsBrick(2));
  // On the other one: it falls, is carried, and is met by what comes next, as one that never was away.
  world.moveBrick(1, at(2.0, 0.0, 0.35));
  ASSERT_EQ(world.bricks().size(), 2u);
  run(world, 2.0);
  EXPECT_NEAR(world.brick(1)->T_map_brick.translation().z(), 0.3, 0.01);
  EXPECT_EQ(world.obstacleAt(0, at(2.0, 0.05, 0.3)), "brick_1");
  run(world, 2.0);
  EXPECT_NEAR(world.brick(1)->T_map_brick.translation().z(), 0.3, 0.01);
}

TEST(World, BricksThatAreGoneCostNothing) {
  World never = makeWorld({});
  World world = makeWorld({brickAt(0, {3.0, 0.0, 0.1}), brickAt(1, {3.0, 1.0, 0.1}), brickAt(2, {3.0, 2.0, 0.1})});
  run(never, 0.5);
  run(world, 0.5);
  for (const int id : {0, 1, 2}) world.takeAwayBrick(id);
  run(never, 0.5);
  run(world, 0.5);
  EXPECT_EQ(world.numContacts(), never.numContacts());
}

TEST(World, RefusesWhatCannotBe) {
  WorldBrick bad = brickAt(0, {3.0, 0.0, 0.1});
  bad.placement.type.mass_kg = 0.0;
  EXPECT_THROW(makeWorld({bad}), std::invalid_argument);
  EXPECT_THROW(makeWorld({brickAt(1, {3, 0, 1}), brickAt(1, {4, 0, 1})}), std::invalid_argument);
  WorldConfig config;
  config.physics.timestep_s = 0.1;
  EXPECT_THAT(messageOf<std::invalid_argument>([&] { makeWorld({}, config); }),
              HasSubstr("timestep_s = 0.1 s, must be in"));
  World world = makeWorld({brickAt(0, {3.0, 0.0, 0.1})});
  EXPECT_THROW(world.moveBrick(5, Eigen::Isometry3d::Identity()), std::invalid_argument);
  EXPECT_THROW(world.linkPose("tail"), std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
