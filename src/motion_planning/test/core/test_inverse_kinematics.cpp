// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/arm_kinematics.h"

#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainiksolverpos_lma.hpp>
#include <kdl/chainjnttojacsolver.hpp>
#include <mp700_ur5e_description/robot_names.h>

#include "support/urdf_text.h"

namespace motion_planning {
namespace {

using mp700_ur5e_description::RobotModel;
using test_support::messageOf;
using testing::HasSubstr;

// Largest residual that ArmKinematics promises, per part.
constexpr double kResidual = ArmKinematics::kIkPositionTolerance_m;
constexpr double kSureSingularValue = 0.02;  // of J: above it no branch is missed, calibrated or not
static_assert(ArmKinematics::kIkPositionTolerance_m == ArmKinematics::kIkRotationTolerance_rad);

const ArmKinematics& shipped() {
  static const ArmKinematics kArm(RobotModel::load(kUrdfFile));
  return kArm;
}

ArmKinematics parse(const std::string& urdf) {
  return ArmKinematics(RobotModel::parse(urdf, "test"));
}

/// Calibrated URDFs: millimetres and tenths of a degree.
ArmKinematics calibratedArm(unsigned seed) {
  return parse(calibrated(readFile(kUrdfFile), 0.002, 0.005, seed));
}

ArmVector randomJoints(std::mt19937_64& rng, double range_rad = M_PI) {
  std::uniform_real_distribution<double> angle(-range_rad, range_rad);
  return ArmVector::NullaryExpr([&](Eigen::Index) { return angle(rng); });
}

Eigen::Isometry3d toEigen(const KDL::Frame& frame) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  for (int row = 0; row < 3; ++row) {
    for (int col = 0; col < 4; ++col) T(row, col) = frame(row, col);
  }
  return T;
}

KDL::Frame toKdl(const Eigen::Isometry3d& T) {
  KDL::Frame frame;
  for (int row = 0; row < 3; ++row) {
    frame.p[row] = T.translation()[row];
    for (int col = 0; col < 3; ++col) frame.M(row, col) = T.linear()(row, col);
  }
  return frame;
}

KDL::Chain kdlChain(const ArmKinematics& arm) {
  return arm.robot().chain(mp700_ur5e_description::kBaseFrame, mp700_ur5e_description::kMagnetTipFrame);
}

void expectSolves(const ArmKinematics& arm, const Eigen::Isometry3d& goal, const ArmVector& q) {
  ASSERT_TRUE(q.allFinite());
  const Eigen::Isometry3d reached = arm.tipPose(q);
  // 1.001: both sides round.
  EXPECT_LE((reached.translation() - goal.translation()).norm(), 1.001 * kResidual) << q.transpose();
  EXPECT_LE((reached.linear() - goal.linear()).norm() / std::sqrt(2.0), 1.001 * kResidual) << q.transpose();
  EXPECT_TRUE(arm.isWithinLimits(q)) << q.transpose();
}

/// Largest difference of a joint, turns aside.
double distanceModTurns(const ArmVector& a, const ArmVector& b) {
  return (a - b).unaryExpr([](double d) { return std::abs(std::remainder(d, 2.0 * M_PI)); }).maxCoeff();
}

double distanceToNearest(const std::vector<ArmVector>& solutions, const ArmVector& q) {
  double distance = std::numeric_limits<double>::infinity();
  for (const ArmVector& solution : solutions) distance = std::min(distance, distanceModTurns(solution, q));
  return distance;
}

double smallestSingularValue(const ArmKinematics& arm, const ArmVector& q) {
  return arm.jacobian(q).jacobiSvd().singularValues()[5];
}

/// A joint in the middle of nowhere special.
ArmVector typicalJoints() {
  ArmVector q;
  q << 0.3, -1.4, 1.7, -1.9, -1.5, 0.4;
  return q;
}

TEST(ArmKinematics, TipPoseIsThatOfKdl) {
  for (const unsigned seed : {0u, 1u, 2u}) {
    const ArmKinematics arm = seed == 0 ? parse(readFile(kUrdfFile)) : calibratedArm(seed);
    const KDL::Chain chain = kdlChain(arm);
    KDL::ChainFkSolverPos_recursive solver(chain);
    std::mt19937_64 rng(seed);
    for (int i = 0; i < 1000; ++i) {
      const ArmVector q = randomJoints(rng, 2.0 * M_PI);
      KDL::JntArray joints(6);
      joints.data = q;
      KDL::Frame frame;
      ASSERT_GE(solver.JntToCart(joints, frame), 0);
      // Rounding of some thirty products of numbers about one.
      ASSERT_LT((arm.tipPose(q).matrix() - toEigen(frame).matrix()).cwiseAbs().maxCoeff(), 1e-13) << q.transpose();
    }
  }
}

TEST(ArmKinematics, ReachesThePublishedPoints) {
  // Universal Robots' tool at two postures [m], from ur5e_base_link, to 0.1 mm; the magnet is 0.1 m longer.
  const auto& robot = shipped().robot();
  const Eigen::Isometry3d T_base_armbase = robot.poseInBody(mp700_ur5e_description::kArmBaseFrame);
  const auto toolPoint = [&](const ArmVector& q) -> Eigen::Vector3d {
    return (T_base_armbase.inverse() * shipped().tipPose(q)) * Eigen::Vector3d(0.0, 0.0, -0.1);
  };
  ArmVector up = ArmVector::Zero();
  up[1] = up[3] = -M_PI_2;
  EXPECT_LT((toolPoint(ArmVector::Zero()) - Eigen::Vector3d(0.8172, 0.2329, 0.0628)).norm(), 1e-4);
  EXPECT_LT((toolPoint(up) - Eigen::Vector3d(0.0, 0.2329, 1.0794)).norm(), 1e-4);
}

TEST(ArmKinematics, JacobianIsTheDerivativeOfTheTipPose) {
  for (const unsigned seed : {0u, 7u}) {
    const ArmKinematics arm = seed == 0 ? parse(readFile(kUrdfFile)) : calibratedArm(seed);
    std::mt19937_64 rng(11);
    constexpr double kStep_rad = 1e-5;  // central: error of the order of its square, 1e-10
    for (int i = 0; i < 300; ++i) {
      const ArmVector q = randomJoints(rng);
      const ArmJacobian J = arm.jacobian(q);
      const Eigen::Matrix3d R = arm.tipPose(q).linear();
      for (int joint = 0; joint < 6; ++joint) {
        ArmVector ahead = q, behind = q;
        ahead[joint] += kStep_rad;
        behind[joint] -= kStep_rad;
        const Eigen::Isometry3d T_ahead = arm.tipPose(ahead), T_behind = arm.tipPose(behind);
        const Eigen::Vector3d velocity = (T_ahead.translation() - T_behind.translation()) / (2.0 * kStep_rad);
        // dR/dq R^T is the cross product with the axis of rotation.
        const Eigen::Matrix3d spin = (T_ahead.linear() - T_behind.linear()) / (2.0 * kStep_rad) * R.transpose();
        ASSERT_LT((J.col(joint).head<3>() - velocity).norm(), 1e-9) << q.transpose();
        ASSERT_LT((J.col(joint).tail<3>() - Eigen::Vector3d(spin(2, 1), spin(0, 2), spin(1, 0))).norm(), 1e-9);
      }
    }
  }
}

TEST(ArmKinematics, JacobianIsThatOfKdl) {
  const KDL::Chain chain = kdlChain(shipped());
  KDL::ChainJntToJacSolver solver(chain);
  std::mt19937_64 rng(3);
  for (int i = 0; i < 300; ++i) {
    const ArmVector q = randomJoints(rng);
    KDL::JntArray joints(6);
    joints.data = q;
    KDL::Jacobian expected(6);
    ASSERT_GE(solver.JntToJac(joints, expected), 0);
    ASSERT_LT((shipped().jacobian(q) - expected.data).cwiseAbs().maxCoeff(), 1e-13);
  }
}

TEST(ArmKinematics, ManipulabilityIsYoshikawasMeasure) {
  std::mt19937_64 rng(5);
  for (int i = 0; i < 300; ++i) {
    const ArmVector q = randomJoints(rng);
    const ArmJacobian J = shipped().jacobian(q);
    // The root halves the digits of a determinant near zero.
    EXPECT_NEAR(shipped().manipulability(q), std::sqrt(std::max(0.0, (J * J.transpose()).determinant())), 1e-8);
  }
}

// |det J| of this structure is upper arm x forearm x |sin elbow| x |sin wrist 2| x distance of the wrist's centre from the
// pan axis in the arm's plane.
TEST(ArmKinematics, ManipulabilityVanishesAtTheSingularities) {
  // Angles in the URDF have ten digits.
  constexpr double kZero = 1e-9;
  ArmVector q = typicalJoints();
  EXPECT_GT(shipped().manipulability(q), 0.02);
  q[2] = 0.0;
  EXPECT_LT(shipped().manipulability(q), kZero) << "elbow straight";
  q = typicalJoints();
  q[4] = 0.0;
  EXPECT_LT(shipped().manipulability(q), kZero) << "wrist aligned";
  q[4] = M_PI;
  EXPECT_LT(shipped().manipulability(q), kZero) << "wrist aligned the other way";

  // Shoulder: where axes 5 and 6 cross lies above the pan axis, seen along axis 2. Found by bisection over the lift.
  q = typicalJoints();
  const auto overhang_m = [&](double lift_rad) {
    q[1] = lift_rad;
    const Eigen::Isometry3d T_wrist3 = shipped().robot().framePose("ur5e_wrist_3_link", shipped().robotPositions(q));
    const Eigen::Isometry3d T_wrist2 = shipped().robot().framePose("ur5e_wrist_2_link", shipped().robotPositions(q));
    const Eigen::Isometry3d T_shoulder =
        shipped().robot().framePose("ur5e_upper_arm_link", shipped().robotPositions(q));
    // On axis 5, where axis 6 crosses it: the origin of wrist_3 brought back along axis 6.
    const Eigen::Vector3d axis_6 = T_wrist3.linear().col(2);
    const Eigen::Vector3d centre =
        T_wrist3.translation() - axis_6 * axis_6.dot(T_wrist3.translation() - T_wrist2.translation());
    const Eigen::Vector3d axis_2 = T_shoulder.linear().col(2);
    return Eigen::Vector3d::UnitZ().cross(axis_2).dot(centre - T_shoulder.translation());
  };
  double low = -2.6, high = 0.0;
  ASSERT_LT(overhang_m(low) * overhang_m(high), 0.0);
  const bool is_low_negative = overhang_m(low) < 0.0;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    ((overhang_m(middle) < 0.0) == is_low_negative ? low : high) = middle;
  }
  q[1] = low;
  EXPECT_LT(shipped().manipulability(q), kZero) << "wrist over the pan axis, lift " << low;
}

TEST(ArmKinematics, ManipulabilityDoesNotDependOnPanAndWrist3) {
  std::mt19937_64 rng(6);
  for (int i = 0; i < 100; ++i) {
    ArmVector q = randomJoints(rng);
    const double expected = shipped().manipulability(q);
    q[0] += 1.3;
    q[5] -= 2.1;
    EXPECT_NEAR(shipped().manipulability(q), expected, 1e-12);
  }
}

/// Everything inverse() promises of its answers at the pose that `q` reaches. Returns whether `q` is among them.
bool finds(const ArmKinematics& arm, const ArmVector& q) {
  const Eigen::Isometry3d goal = arm.tipPose(q);
  const std::vector<ArmVector> solutions = arm.inverse(goal, q);
  EXPECT_LE(solutions.size(), static_cast<std::size_t>(ArmKinematics::kMaxBranches));
  for (const ArmVector& solution : solutions) expectSolves(arm, goal, solution);
  // A residual moves the joints by at most itself over the smallest singular value; next to singularities two branches
  // meet, and count as one within 1e-3.
  const double singular = smallestSingularValue(arm, q);
  const double allowed_rad =
      singular > 0.01 ? 2.0 * std::sqrt(2.0) * kResidual / singular : 2e-3 + 1e-7 / (singular + 1e-6);
  return distanceToNearest(solutions, q) <= allowed_rad;
}

ArmVector elbowWithinLimits(ArmVector q) {
  q[2] = std::clamp(q[2], -M_PI, M_PI);
  return q;
}

TEST(ArmKinematics, InverseFindsTheJointsOf10000Poses) {
  std::mt19937_64 rng(1);
  for (int i = 0; i < 10000; ++i) {
    const ArmVector q = elbowWithinLimits(randomJoints(rng, 2.0 * M_PI));
    ASSERT_TRUE(finds(shipped(), q)) << q.transpose();
  }
}

// Next to singularities, a calibrated arm's branches meet in other places than the closed form's and some are missed.
TEST(ArmKinematics, InverseFindsTheJointsOfCalibratedArms) {
  int missed = 0;
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const ArmKinematics arm = calibratedArm(seed);
    std::mt19937_64 rng(seed);
    for (int i = 0; i < 1000; ++i) {
      const ArmVector q = randomJoints(rng);
      const bool is_found = finds(arm, q);
      if (!is_found) ++missed;
      ASSERT_TRUE(is_found || smallestSingularValue(arm, q) < kSureSingularValue)
          << "calibration " << seed << ", pose " << i << ": " << q.transpose();
    }
  }
  EXPECT_LE(missed, 60) << "of 10000";  // 42 when this was written
}

// Independent of the closed form: Newton from many starts knows no branches.
TEST(ArmKinematics, InverseFindsWhateverKdlFinds) {
  for (const unsigned seed : {0u, 3u}) {
    const ArmKinematics arm = seed == 0 ? parse(readFile(kUrdfFile)) : calibratedArm(seed);
    const KDL::Chain chain = kdlChain(arm);
    KDL::ChainIkSolverPos_LMA solver(chain, 1e-9, 200);
    std::mt19937_64 rng(8);
    std::size_t compared = 0;
    for (int i = 0; i < 20; ++i) {
      const Eigen::Isometry3d goal = arm.tipPose(randomJoints(rng));
      const std::vector<ArmVector> solutions = arm.inverse(goal, ArmVector::Zero());
      std::vector<ArmVector> found;
      for (int attempt = 0; attempt < 60; ++attempt) {
        KDL::JntArray start(6), end(6);
        start.data = randomJoints(rng);
        if (solver.CartToJnt(start, toKdl(goal), end) < 0) continue;
        const ArmVector q = end.data;
        // Its tolerance counts rotations a hundredth.
        if ((arm.tipPose(q).matrix() - goal.matrix()).norm() > 1e-6) continue;
        if (distanceToNearest(found, q) > 1e-3) found.push_back(q);
      }
      for (const ArmVector& q : found) {
        if (smallestSingularValue(arm, q) < kSureSingularValue) continue;
        EXPECT_LT(distanceToNearest(solutions, q), 1e-3) << "pose " << i << ": " << q.transpose();
        ++compared;
      }
      EXPECT_GE(solutions.size(), found.size());
    }
    EXPECT_GT(compared, 60u);
  }
}

TEST(ArmKinematics, AllEightBranchesAreFound) {
  for (const unsigned seed : {0u, 4u}) {
    const ArmKinematics arm = seed == 0 ? parse(readFile(kUrdfFile)) : calibratedArm(seed);
    const std::vector<ArmVector> solutions = arm.inverse(arm.tipPose(typicalJoints()), typicalJoints());
    ASSERT_EQ(solutions.size(), 8u);
    for (std::size_t i = 0; i < solutions.size(); ++i) {
      for (std::size_t k = 0; k < i; ++k) EXPECT_GT(distanceModTurns(solutions[i], solutions[k]), 0.1);
    }
  }
}

TEST(ArmKinematics, NearestSolutionComesFirstAndByTheNearestTurn) {
  std::mt19937_64 rng(2);
  for (int i = 0; i < 500; ++i) {
    ArmVector near_rad = elbowWithinLimits(randomJoints(rng, 2.0 * M_PI));
    const Eigen::Isometry3d goal = shipped().tipPose(randomJoints(rng));
    double last = 0.0;
    for (const ArmVector& solution : shipped().inverse(goal, near_rad)) {
      EXPECT_GE((solution - near_rad).norm(), last);
      last = (solution - near_rad).norm();
      for (int joint = 0; joint < 6; ++joint) {
        for (const double turn_rad : {-2.0 * M_PI, 2.0 * M_PI}) {
          ArmVector other = solution;
          other[joint] += turn_rad;
          if (!shipped().isWithinLimits(other)) continue;
          EXPECT_GE(std::abs(other[joint] - near_rad[joint]), std::abs(solution[joint] - near_rad[joint]) - 1e-9);
        }
      }
    }
  }
}

TEST(ArmKinematics, SameWindingAsTheSeed) {
  ArmVector q = typicalJoints();
  q[0] -= 2.0 * M_PI;
  q[5] -= 2.0 * M_PI;
  const std::vector<ArmVector> solutions = shipped().inverse(shipped().tipPose(q), q);
  ASSERT_FALSE(solutions.empty());
  EXPECT_LT((solutions.front() - q).norm(), 1e-6);
}

TEST(ArmKinematics, LimitsAreKept) {
  std::string urdf = readFile(kUrdfFile);
  for (const std::string joint : mp700_ur5e_description::kArmJoints) urdf = withLimits(urdf, joint, -2.0, 1.0);
  urdf = withLimits(urdf, "wrist_3_joint", 5.0, 6.0);
  const ArmKinematics arm = parse(urdf);
  std::mt19937_64 rng(4);
  std::uniform_real_distribution<double> angle(-2.0, 1.0), last_angle(5.0, 6.0);
  std::size_t branches = 0;
  for (int i = 0; i < 1000; ++i) {
    ArmVector q = ArmVector::NullaryExpr([&](Eigen::Index) { return angle(rng); });
    q[5] = last_angle(rng);
    // The seed is anywhere, also beyond the limits.
    const std::vector<ArmVector> solutions = arm.inverse(arm.tipPose(q), randomJoints(rng, 6.0));
    ASSERT_LT(distanceToNearest(solutions, q), 1e-2) << q.transpose();
    for (const ArmVector& solution : solutions) EXPECT_TRUE(arm.isWithinLimits(solution, 0.0)) << solution.transpose();
    branches += solutions.size();
  }
  EXPECT_LT(branches, 3000u) << "of at most 8000: limits leave out most";
}

TEST(ArmKinematics, JointsOnTheirLimitsAreFound) {
  std::string urdf = readFile(kUrdfFile);
  for (const std::string joint : mp700_ur5e_description::kArmJoints) urdf = withLimits(urdf, joint, -2.0, 1.0);
  const ArmKinematics arm = parse(urdf);
  for (int corner = 0; corner < 64; ++corner) {
    ArmVector q;
    for (int joint = 0; joint < 6; ++joint) q[joint] = (corner >> joint & 1) != 0 ? 1.0 : -2.0;
    EXPECT_TRUE(finds(arm, q)) << q.transpose();
  }
}

TEST(ArmKinematics, ContinuousJointsAreNearestToTheSeed) {
  std::string urdf = readFile(kUrdfFile);
  const std::string head = "<joint name=\"wrist_3_joint\" type=\"";
  urdf.replace(urdf.find(head) + head.size(), std::string("revolute").size(), "continuous");
  const ArmKinematics arm = parse(urdf);
  ArmVector q = typicalJoints();
  q[5] = 40.0;
  const std::vector<ArmVector> solutions = arm.inverse(arm.tipPose(q), q);
  ASSERT_FALSE(solutions.empty());
  EXPECT_NEAR(solutions.front()[5], 40.0, 1e-6);
}

// The tool's direction along axis 4: wrist_1 and wrist_3 turn about the same line.
TEST(ArmKinematics, AlignedWristTakesWrist3FromTheSeed) {
  for (const double wrist_2_rad : {0.0, M_PI, -M_PI}) {
    ArmVector q = typicalJoints();
    q[4] = wrist_2_rad;
    const Eigen::Isometry3d goal = shipped().tipPose(q);
    for (const double wrist_3_rad : {-2.0, 0.4, 3.0}) {
      ArmVector near_rad = q;
      near_rad[5] = wrist_3_rad;
      const std::vector<ArmVector> solutions = shipped().inverse(goal, near_rad);
      ASSERT_FALSE(solutions.empty());
      std::size_t taken = 0;
      for (const ArmVector& solution : solutions) {
        expectSolves(shipped(), goal, solution);
        // Those with the shoulder as it is; the other shoulder's wrist is not aligned.
        if (std::abs(std::sin(solution[4])) > 1e-3) continue;
        EXPECT_NEAR(solution[5], wrist_3_rad, 1e-3) << solution.transpose();
        ++taken;
      }
      EXPECT_EQ(taken, 2u) << "elbow up and down, each once";
    }
  }
}

// Where the arm is all but stretched, it is too short for most angles of wrist_3 on the line that solves.
TEST(ArmKinematics, AlignedWristOfAStretchedArmIsSolvedFromAnySeed) {
  std::mt19937_64 rng(13);
  for (const double bend_rad : {0.0, 1e-9, 1e-3, 0.1, 0.3}) {
    for (int i = 0; i < 100; ++i) {
      ArmVector q = randomJoints(rng);
      q[2] = bend_rad;
      q[4] = i % 2 == 0 ? 0.0 : M_PI;
      const ArmVector near_rad = randomJoints(rng);
      const Eigen::Isometry3d goal = shipped().tipPose(q);
      const std::vector<ArmVector> solutions = shipped().inverse(goal, near_rad);
      ASSERT_FALSE(solutions.empty()) << "elbow " << bend_rad << ": " << q.transpose();
      double least_rad = M_PI;
      for (const ArmVector& solution : solutions) {
        expectSolves(shipped(), goal, solution);
        if (std::abs(std::sin(solution[4])) > 1e-3) continue;
        least_rad = std::min(least_rad, std::abs(std::remainder(solution[5] - near_rad[5], 2.0 * M_PI)));
      }
      // The nearest possible is no farther than the posture the pose was made from. Stretched and aligned, the polish slides
      // along the line by up to the root of its residual over the smallest singular value.
      EXPECT_LE(least_rad, std::abs(std::remainder(q[5] - near_rad[5], 2.0 * M_PI)) + 0.03);
    }
  }
}

TEST(ArmKinematics, NextToSingularitiesInverseStillSolves) {
  for (const unsigned seed : {0u, 1u, 2u, 3u}) {
    const ArmKinematics arm = seed == 0 ? parse(readFile(kUrdfFile)) : calibratedArm(seed);
    std::mt19937_64 rng(9);
    int unsolved = 0;
    for (const double away_rad : {0.0, 1e-12, 1e-9, 1e-7, 5e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2}) {
      for (int i = 0; i < 50; ++i) {
        ArmVector straight = randomJoints(rng), aligned = straight, folded = straight, both = straight;
        straight[2] = both[2] = away_rad;
        aligned[4] = both[4] = i % 2 == 0 ? away_rad : M_PI - away_rad;
        folded[2] = M_PI - away_rad;
        for (const ArmVector& q : {straight, aligned, folded, both}) {
          const Eigen::Isometry3d goal = arm.tipPose(q);
          const std::vector<ArmVector> solutions = arm.inverse(goal, q);
          if (solutions.empty()) ++unsolved;
          if (seed == 0) {
            ASSERT_FALSE(solutions.empty()) << away_rad << " rad away: " << q.transpose();
          }
          for (const ArmVector& solution : solutions) expectSolves(arm, goal, solution);
        }
      }
    }
    EXPECT_LE(unsolved, 40) << "of 2000, calibration " << seed;
  }
}

TEST(ArmKinematics, OutOfReachIsEmpty) {
  const ArmVector near_rad = typicalJoints();
  Eigen::Isometry3d goal = shipped().tipPose(near_rad);
  for (const double distance_m : {1.5, 1e3, 1e9, 1e300}) {
    goal.translation() = Eigen::Vector3d(distance_m, 0.0, 0.5);
    EXPECT_TRUE(shipped().inverse(goal, near_rad).empty()) << distance_m;
  }
  // Beside the pan axis, tool down: nearer to it than axis 4 is, there is no place for the wrist.
  ArmVector down;
  down << 0.0, -1.2, 1.9, -M_PI_2 - 0.7, -M_PI_2, 0.0;
  goal = shipped().tipPose(down);
  goal.translation() = shipped().robot().poseInBody(mp700_ur5e_description::kArmBaseFrame).translation();
  goal.translation().z() += 0.5;
  EXPECT_TRUE(shipped().inverse(goal, near_rad).empty());
}

// Stretched along a line the arm ends somewhere; solutions end there and nowhere else.
TEST(ArmKinematics, BorderOfReachIsSharp) {
  ArmVector q = typicalJoints();
  q[2] = 0.0;
  const Eigen::Isometry3d goal = shipped().tipPose(q);
  // Along the straight arm, from shoulder to wrist.
  const auto& robot = shipped().robot();
  const Eigen::Vector3d along = (robot.framePose("ur5e_wrist_1_link", shipped().robotPositions(q)).translation() -
                                 robot.framePose("ur5e_upper_arm_link", shipped().robotPositions(q)).translation());
  const Eigen::Vector3d axis_2 = robot.framePose("ur5e_upper_arm_link", shipped().robotPositions(q)).linear().col(2);
  const Eigen::Vector3d direction = (along - axis_2 * axis_2.dot(along)).normalized();
  for (const double beyond_m : {-1e-2, -1e-4, -1e-5, -1e-7, 0.0, 1e-7}) {
    Eigen::Isometry3d moved = goal;
    moved.translation() += beyond_m * direction;
    const std::vector<ArmVector> solutions = shipped().inverse(moved, q);
    ASSERT_FALSE(solutions.empty()) << beyond_m;
    EXPECT_LT(distanceToNearest(solutions, q), 0.5);
    for (const ArmVector& solution : solutions) expectSolves(shipped(), moved, solution);
  }
  for (const double beyond_m : {1e-5, 1e-3}) {
    Eigen::Isometry3d moved = goal;
    moved.translation() += beyond_m * direction;
    for (const ArmVector& solution : shipped().inverse(moved, q)) {
      expectSolves(shipped(), moved, solution);
      EXPECT_GT(std::abs(std::remainder(solution[0] - q[0], 2.0 * M_PI)), 0.5) << "this shoulder does not reach";
    }
  }
}

TEST(ArmKinematics, BadGoalIsEmpty) {
  const ArmVector near_rad = typicalJoints();
  const Eigen::Isometry3d good = shipped().tipPose(near_rad);
  ASSERT_FALSE(shipped().inverse(good, near_rad).empty());
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    for (int row = 0; row < 3; ++row) {
      for (int col = 0; col < 4; ++col) {
        Eigen::Isometry3d goal = good;
        goal(row, col) = bad;
        EXPECT_TRUE(shipped().inverse(goal, near_rad).empty()) << row << ' ' << col;
      }
    }
  }
  Eigen::Isometry3d scaled = good, mirrored = good, nothing = good;
  scaled.linear() *= 1.0 + 1e-5;
  mirrored.linear().col(0) *= -1.0;
  nothing.linear().setZero();
  for (const Eigen::Isometry3d& goal : {scaled, mirrored, nothing}) {
    EXPECT_TRUE(shipped().inverse(goal, near_rad).empty());
  }
  // A pose that has been a message of floats is rigid enough.
  Eigen::Isometry3d rounded = good;
  rounded.matrix() = good.matrix().cast<float>().cast<double>();
  EXPECT_EQ(shipped().inverse(rounded, near_rad).size(), shipped().inverse(good, near_rad).size());
}

TEST(ArmKinematics, BadSeedIsAnError) {
  ArmVector bad = typicalJoints();
  bad[3] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(shipped().inverse(shipped().tipPose(typicalJoints()), bad), std::invalid_argument);
  EXPECT_FALSE(shipped().isWithinLimits(bad));
}

TEST(ArmKinematics, ThreadsGetTheSameAnswers) {
  std::mt19937_64 rng(10);
  std::vector<ArmVector> postures;
  for (int i = 0; i < 300; ++i) postures.push_back(randomJoints(rng));
  const auto solveAll = [&] {
    std::vector<ArmVector> result;
    for (const ArmVector& q : postures) {
      for (const ArmVector& solution : shipped().inverse(shipped().tipPose(q), ArmVector::Zero()))
        result.push_back(solution);
    }
    return result;
  };
  const std::vector<ArmVector> expected = solveAll();
  std::vector<std::vector<ArmVector>> results(4);
  std::vector<std::thread> threads;
  for (auto& result : results) threads.emplace_back([&] { result = solveAll(); });
  for (std::thread& thread : threads) thread.join();
  for (const auto& result : results) EXPECT_EQ(result, expected);
}

std::string refusalOf(const std::string& urdf) {
  return messageOf<std::invalid_argument>([&] { parse(urdf); });
}

/// Not the structure of a UR: an axis of the wrist is slanted, as in older arms of Kinova.
ArmKinematics slantedWrist() {
  std::string urdf = readFile(kUrdfFile);
  JointAttribute(&urdf, "wrist_2_joint", "origin", "rpy").set("1.2 0 0");
  return parse(urdf);
}

TEST(ArmKinematics, OtherStructuresHaveNoClosedForm) {
  EXPECT_TRUE(shipped().isClosedForm());
  EXPECT_TRUE(calibratedArm(1).isClosedForm());
  EXPECT_FALSE(slantedWrist().isClosedForm());
  const std::vector<std::array<std::string, 3>> changes = {{"elbow_joint", "rpy", "0.1 0 0"},
                                                           {"elbow_joint", "rpy", "3.141592653589793 0 0"},
                                                           {"wrist_3_joint", "xyz", "0.05 0.0996 0"},
                                                           {"elbow_joint", "xyz", "0 0 0"}};
  for (const auto& [joint, key, value] : changes) {
    std::string urdf = readFile(kUrdfFile);
    JointAttribute(&urdf, joint, "origin", key).set(value);
    EXPECT_FALSE(parse(urdf).isClosedForm()) << joint << ' ' << key << ' ' << value;
  }
}

TEST(ArmKinematics, NumericalInverseSolvesReachablePoses) {
  const ArmKinematics arm = slantedWrist();
  std::mt19937_64 rng(4);
  int num_found = 0;
  constexpr int kPoses = 300;
  for (int i = 0; i < kPoses; ++i) {
    const ArmVector q = elbowWithinLimits(randomJoints(rng));
    const Eigen::Isometry3d goal = arm.tipPose(q);
    const std::vector<ArmVector> solutions = arm.inverse(goal, ArmVector::Zero());
    ASSERT_FALSE(solutions.empty()) << q.transpose();
    for (std::size_t k = 0; k < solutions.size(); ++k) {
      expectSolves(arm, goal, solutions[k]);
      if (k == 0) continue;
      EXPECT_GE(solutions[k].norm(), solutions[k - 1].norm()) << "nearest first";
    }
    // Away from singularities a branch is a point.
    if (distanceToNearest(solutions, q) < 1e-3) ++num_found;
  }
  EXPECT_GE(num_found, 0.95 * kPoses);  // 298 of 300: the search may miss branches
}

TEST(ArmKinematics, NumericalInverseStartsFromTheGivenJoints) {
  const ArmKinematics arm = slantedWrist();
  const ArmVector q = typicalJoints();
  ArmVector near_rad = q;
  near_rad.array() += 0.05;
  const std::vector<ArmVector> solutions = arm.inverse(arm.tipPose(q), near_rad);
  ASSERT_FALSE(solutions.empty());
  EXPECT_LT(distanceModTurns(solutions.front(), q), 1e-3);
  Eigen::Isometry3d too_far = arm.tipPose(q);
  too_far.translation().x() += 5.0;
  EXPECT_TRUE(arm.inverse(too_far, q).empty());
}

TEST(ArmKinematics, ArmsWithoutSixJointsAreRefused) {
  EXPECT_THROW(ArmKinematics(nullptr), std::invalid_argument);
  std::string urdf = readFile(kUrdfFile);
  ASSERT_EQ(refusalOf(urdf), "");
  const std::string head = "<joint name=\"wrist_1_joint\" type=\"";
  urdf.replace(urdf.find(head) + head.size(), std::string("revolute").size(), "fixed");
  EXPECT_THAT(refusalOf(urdf), HasSubstr("must be (shoulder_pan_joint, shoulder_lift_joint, elbow_joint"));
}

TEST(ArmKinematics, RobotPositionsPutTheArmAmongTheWheels) {
  const ArmKinematics& arm = shipped();
  const ArmVector q = typicalJoints();
  const Eigen::VectorXd positions = arm.robotPositions(q);
  ASSERT_EQ(static_cast<std::size_t>(positions.size()), arm.robot().joints().size());
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(positions[static_cast<Eigen::Index>(arm.robot().jointIndex(mp700_ur5e_description::kArmJoints[i]))],
              q[static_cast<Eigen::Index>(i)]);
  }
  EXPECT_EQ(positions.squaredNorm(), q.squaredNorm()) << "the rest at zero";
  const Eigen::Isometry3d tip = arm.robot().framePose(mp700_ur5e_description::kMagnetTipFrame, positions);
  EXPECT_LT((tip.matrix() - arm.tipPose(q).matrix()).cwiseAbs().maxCoeff(), 1e-13);
}

}  // namespace
}  // namespace motion_planning
