// SPDX-License-Identifier: BSD-3-Clause
// What the arm can do on this base: fold away, and lay a brick into the container.
#include <cmath>
#include <optional>
#include <random>

#include <gtest/gtest.h>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainiksolverpos_lma.hpp>

#include "mp700_ur5e_description/brick_types.h"
#include "support/solids.h"

namespace mp700_ur5e_description {
namespace {

constexpr double kClearance_m = 0.02;  // a controller's tracking error and the shapes' simplification are less

bool isArm(const std::string& link) {
  return link.rfind("ur5e_", 0) == 0;
}

/// Pairs of links in touch: closer than the clearance, or, within the arm, whose parts pass each other by millimetres,
/// overlapping. Empty: none.
std::string contacts(const UrdfRobot& robot, const ArmPose& arm) {
  std::set<std::pair<std::string, std::string>> pairs = touchingLinks(robot, arm, 0.0);
  for (const auto& pair : touchingLinks(robot, arm, kClearance_m)) {
    if (!isArm(pair.first) || !isArm(pair.second)) pairs.insert(pair);
  }
  std::string text;
  for (const auto& [a, b] : pairs) text += a + " - " + b + "; ";
  return text;
}

ArmPose stowed() {
  return loadArmPose(DESCRIPTION_DIR "/config/arm_poses/stowed.yaml");
}

/// A solution within the limits [rad], or nothing: Levenberg-Marquardt from random starts.
std::optional<ArmPose> solve(const UrdfRobot& robot, const Eigen::Isometry3d& T_base_tip, std::mt19937_64& rng) {
  const KDL::Chain chain = robot.chain(kBaseFrame, kMagnetTipFrame);
  KDL::ChainIkSolverPos_LMA solver(chain, 1e-8);
  KDL::Frame goal;
  for (int row = 0; row < 3; ++row) {
    goal.p[row] = T_base_tip.translation()[row];
    for (int col = 0; col < 3; ++col) goal.M(row, col) = T_base_tip.linear()(row, col);
  }
  std::uniform_real_distribution<double> angle(-M_PI, M_PI);
  KDL::JntArray start(6), q(6);
  for (int i = 0; i < 6; ++i) start(i) = angle(rng);
  if (solver.CartToJnt(start, goal, q) < 0) return std::nullopt;
  ArmPose pose;
  for (int i = 0; i < 6; ++i) {
    pose[i] = std::remainder(q(i), 2.0 * M_PI);
    // Half a degree from a limit is at the limit.
    if (std::abs(pose[i]) > robot.urdf().getJoint(kArmJoints[static_cast<std::size_t>(i)])->limits->upper - 0.01) {
      return std::nullopt;
    }
  }
  return pose;
}

TEST(ArmWorkspace, StowedPoseTouchesNothing) {
  const UrdfRobot robot;
  EXPECT_EQ(contacts(robot, stowed()), "");
}

TEST(ArmWorkspace, CheckSeesContact) {
  const UrdfRobot robot;
  ArmPose folded = stowed();
  folded[2] = 3.1;  // forearm into upper arm
  folded[1] = -2.8;
  EXPECT_NE(contacts(robot, folded), "");
}

TEST(ArmWorkspace, StowedToolPointsDown) {
  const UrdfRobot robot;
  const Eigen::Vector3d tool_z = robot.linkPose(kMagnetTipFrame, stowed()).linear().col(2);
  EXPECT_LT((tool_z + Eigen::Vector3d::UnitZ()).norm(), 1e-6);  // digits of the file
}

// The magnet holds a brick by its top; the brick's underside is level with the rim, 5 cm below it, and 15 cm above.
TEST(ArmWorkspace, LaysBricksIntoTheContainerFromAbove) {
  const UrdfRobot robot;
  const double brick_height_m = loadBrickTypes(DESCRIPTION_DIR "/config/bricks.yaml").types.front().size_m.z();
  std::mt19937_64 rng(3);
  for (const double height_m : {-0.05, 0.0, 0.15}) {
    for (const char* place : kContainerPlaces) {
      Eigen::Isometry3d T_drop_tip = Eigen::Isometry3d::Identity();
      T_drop_tip.translation().z() = brick_height_m + height_m;
      T_drop_tip.rotate(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()));
      const Eigen::Isometry3d T_base_tip = robot.linkPose(place, ArmPose::Zero()) * T_drop_tip;
      bool is_reached = false;
      std::string failures;
      for (int attempt = 0; attempt < 200 && !is_reached; ++attempt) {
        const std::optional<ArmPose> q = solve(robot, T_base_tip, rng);
        if (!q) continue;
        // What the solver says is checked by forward kinematics; its tolerance of 1e-8 counts rotation a hundredth.
        ASSERT_LT((robot.linkPose(kMagnetTipFrame, *q).matrix() - T_base_tip.matrix()).norm(), 1e-5);
        failures = contacts(robot, *q);
        is_reached = failures.empty();
      }
      EXPECT_TRUE(is_reached) << "height " << height_m << " m, " << place << "; last: " << failures;
    }
  }
}

}  // namespace
}  // namespace mp700_ur5e_description
