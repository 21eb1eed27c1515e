// SPDX-License-Identifier: BSD-3-Clause
// The judge of plans against another engine (MuJoCo's collision) and against cases with a known answer.
#include "planning_problems/exact_checker.h"

#include <set>

#include <gmock/gmock.h>
#include <mp700_ur5e_description/arm_pose.h>

#include "problem_files.h"
#include "simulated_world/robot_mjcf.h"
#include "simulated_world/world.h"
#include "synthetic_depth/seeded_random.h"

namespace experiments {
namespace {

using motion_planning::ArmVector;
using simulated_world::BrickPlacement;
using synthetic_depth::SeededRandom;
using ::testing::IsEmpty;

const std::string kDescription = MP700_UR5E_DESCRIPTION_DIR;

std::shared_ptr<const mp700_ur5e_description::RobotModel> robot() {
  static const auto model = mp700_ur5e_description::RobotModel::load(kDescription + "/urdf/mp700_ur5e.urdf");
  return model;
}

ArmVector stowed() {
  return mp700_ur5e_description::loadArmPose(kDescription + "/config/arm_poses/stowed.yaml");
}

BrickPlacement brickAt(int id, const Eigen::Vector3d& xyz_m, double yaw_rad = 0.0) {
  BrickPlacement brick;
  brick.id = id;
  brick.type = {"brick", Eigen::Vector3d(0.3, 0.2, 0.2), 1.0, 0.6};
  brick.T_map_brick.translation() = xyz_m;
  brick.T_map_brick.linear() = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).matrix();
  return brick;
}

/// Reaching down in front of the robot.
ArmVector reachingDown() {
  return (ArmVector() << 0.0, -0.9, 1.5, -2.1707963267948966, -M_PI_2, 0.0).finished();
}

TEST(ExactChecker, StowedArmTouchesNothing) {
  ExactChecker checker(robot(), {brickAt(0, {0.6, 0.0, 0.1})}, Eigen::Isometry3d::Identity());
  EXPECT_THAT(checker.overlaps(stowed()), IsEmpty());
}

TEST(ExactChecker, MeasuresDepthAndDistanceOfTheMagnet) {
  ExactChecker empty(robot(), {}, Eigen::Isometry3d::Identity());
  const Eigen::Isometry3d T_base_tip = empty.tipInBase(reachingDown());
  const Eigen::Vector3d tip = T_base_tip.translation();
  ASSERT_LT((T_base_tip.linear().col(2) + Eigen::Vector3d::UnitZ()).norm(), 1e-6) << "not straight down";
  for (const double gap_m : {0.03, 0.004, -0.004, -0.03}) {
    const BrickPlacement brick = brickAt(7, tip - Eigen::Vector3d(0.0, 0.0, 0.1 + gap_m), 0.4);
    ExactChecker checker(robot(), {brick}, Eigen::Isometry3d::Identity());
    const std::vector<Overlap> overlaps = checker.overlaps(reachingDown());
    if (gap_m > 0.0) {
      EXPECT_THAT(overlaps, IsEmpty());
      EXPECT_NEAR(checker.clearance(reachingDown(), 0.2), gap_m, 2e-4);
      EXPECT_EQ(checker.clearance(reachingDown(), 0.2, 7), 0.2);
    } else {
      ASSERT_EQ(overlaps.size(), 1U);
      EXPECT_EQ(overlaps[0].first, "magnet");
      EXPECT_EQ(overlaps[0].second, "brick_7");
      EXPECT_EQ(overlaps[0].brick_id, 7);
      EXPECT_NEAR(overlaps[0].depth_m, -gap_m, 3e-4);  // bisected to 1e-4, touching within 2e-5
      EXPECT_EQ(checker.clearance(reachingDown(), 0.2), 0.0);
    }
  }
}

TEST(ExactChecker, KnowsWhereTheRobotStands) {
  ExactChecker empty(robot(), {}, Eigen::Isometry3d::Identity());
  const Eigen::Vector3d tip = empty.tipInBase(reachingDown()).translation();
  Eigen::Isometry3d T_map_base = Eigen::Isometry3d::Identity();
  T_map_base.translation() << 3.0, -2.0, 0.5;
  T_map_base.rotate(Eigen::AngleAxisd(1.1, Eigen::Vector3d::UnitZ()));
  BrickPlacement brick = brickAt(1, {0.0, 0.0, 0.0});
  brick.T_map_brick = T_map_base * Eigen::Translation3d(tip);
  ExactChecker checker(robot(), {brick}, T_map_base);
  EXPECT_FALSE(checker.overlaps(reachingDown()).empty());
  ExactChecker elsewhere(robot(), {brick}, Eigen::Isometry3d::Identity());
  EXPECT_THAT(elsewhere.overlaps(reachingDown()), IsEmpty());
}

TEST(ExactChecker, HeldBrickMovesWithTheMagnet) {
  ExactChecker empty(robot(), {}, Eigen::Isometry3d::Identity());
  const Eigen::Vector3d tip = empty.tipInBase(reachingDown()).translation();
  const BrickPlacement target = brickAt(0, tip - Eigen::Vector3d(0.0, 0.0, 0.1));
  const BrickPlacement beside = brickAt(1, tip + Eigen::Vector3d(0.0, 0.19, -0.1));  // 1 cm into the target
  Eigen::Isometry3d T_tip_brick = Eigen::Isometry3d::Identity();
  T_tip_brick.translation() << 0.0, 0.0, 0.1;
  T_tip_brick.linear() = empty.tipInBase(reachingDown()).linear().transpose() * target.T_map_brick.linear();
  ExactChecker checker(robot(), {target, beside}, Eigen::Isometry3d::Identity());
  checker.hold(0, T_tip_brick);
  EXPECT_LT((checker.heldPose(reachingDown()).matrix() - target.T_map_brick.matrix()).norm(), 1e-9);
  const std::vector<Overlap> overlaps = checker.overlaps(reachingDown());
  ASSERT_EQ(overlaps.size(), 1U);
  EXPECT_EQ(overlaps[0].first, "held");
  EXPECT_EQ(overlaps[0].brick_id, 1);
  EXPECT_NEAR(overlaps[0].depth_m, 0.01, 3e-4);
  ArmVector turned = reachingDown();
  turned[0] += 1.0;
  EXPECT_THAT(checker.overlaps(turned), IsEmpty());
  // Let down until half of it is in the ground.
  ArmVector low = reachingDown();
  while (checker.heldPose(low).translation().z() > 0.0) low[1] += 0.01;
  double depth_m = 0.0;
  for (const Overlap& overlap : checker.overlaps(low)) {
    if (overlap.first == "held" && overlap.second == "ground") depth_m = overlap.depth_m;
  }
  EXPECT_GT(depth_m, 0.1);  // half its height, and tilted
}

TEST(ExactChecker, AgreesWithMuJoCoOnRandomPostures) {
  // MuJoCo's own shapes, kinematics and collision; postures where its depth and ours both are beyond what the iterative
  // solvers (MuJoCo's convex collision and ours) may miss are compared.
  SeededRandom random(11);
  std::vector<BrickPlacement> bricks;
  std::vector<simulated_world::WorldBrick> world_bricks;
  for (int i = 0; i < 8; ++i) {
    bricks.push_back(brickAt(i, {0.60 + 0.35 * (i / 4), -0.6 + 0.4 * (i % 4), 0.1 + 0.25 * (i % 3)}, 0.3 * i));
    simulated_world::WorldBrick world_brick;
    world_brick.placement = bricks.back();
    world_bricks.push_back(world_brick);
  }
  simulated_world::World world(simulated_world::robotMjcfFromFile(kDescription + "/urdf/mp700_ur5e.urdf"), "",
                               world_bricks, {}, stowed(), simulated_world::WorldConfig());
  const mjModel& model = world.model();
  const simulated_world::DataPtr data = simulated_world::makeData(model);
  const auto bodyOf = [&](int geom) { return std::string(mj_id2name(&model, mjOBJ_BODY, model.geom_bodyid[geom])); };
  ExactChecker checker(robot(), bricks, Eigen::Isometry3d::Identity());
  int overlapping = 0;
  int free = 0;
  for (int k = 0; k < 1500; ++k) {
    ArmVector q;
    for (int i = 0; i < 6; ++i) {
      q[i] = random.uniform(-M_PI, M_PI);
      const int joint =
          simulated_world::requireId(model, mjOBJ_JOINT, simulated_world::kArmJoints[static_cast<std::size_t>(i)]);
      data->qpos[model.jnt_qposadr[joint]] = q[i];
    }
    mj_kinematics(&model, data.get());
    mj_collision(&model, data.get());
    std::map<std::pair<std::string, std::string>, double> theirs;
    for (int i = 0; i < data->ncon; ++i) {
      std::string a = bodyOf(data->contact[i].geom1);
      std::string b = bodyOf(data->contact[i].geom2);
      if (a.rfind("brick_", 0) == 0) std::swap(a, b);
      if (b.rfind("brick_", 0) != 0 || a.rfind("brick_", 0) == 0 || a == "world") continue;
      double& depth_m = theirs[{a, b}];
      depth_m = std::max(depth_m, -data->contact[i].dist);
    }
    std::map<std::pair<std::string, std::string>, double> ours;
    for (const Overlap& overlap : checker.overlaps(q)) {
      if (overlap.brick_id < 0) continue;
      double& depth_m = ours[{overlap.first, overlap.second}];
      depth_m = std::max(depth_m, overlap.depth_m);
    }
    constexpr double kSure_m = 0.003;
    for (const auto& [pair, depth_m] : theirs) {
      if (depth_m > kSure_m) {
        EXPECT_TRUE(ours.count(pair)) << k << ": " << pair.first << " " << pair.second << " " << depth_m;
      }
    }
    for (const auto& [pair, depth_m] : ours) {
      if (depth_m > kSure_m) {
        EXPECT_TRUE(theirs.count(pair)) << k << ": " << pair.first << " " << pair.second << " " << depth_m;
      }
    }
    (ours.empty() ? free : overlapping) += 1;
  }
  EXPECT_GT(overlapping, 200);
  EXPECT_GT(free, 200);
}

}  // namespace
}  // namespace experiments
