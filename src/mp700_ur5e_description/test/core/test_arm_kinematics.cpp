// SPDX-License-Identifier: BSD-3-Clause
// The arm of the URDF against what Universal Robots publishes of it.
#include <cmath>
#include <random>

#include <gtest/gtest.h>
#include <kdl/chainfksolverpos_recursive.hpp>

#include "support/urdf_robot.h"

namespace mp700_ur5e_description {
namespace {

struct DhRow {
  double a_m, d_m, alpha_rad;
};
// The article's Denavit-Hartenberg parameters of the UR5e.
constexpr DhRow kDhTable[] = {{0.0, 0.1625, M_PI_2}, {-0.425, 0.0, 0.0},     {-0.3922, 0.0, 0.0},
                              {0.0, 0.1333, M_PI_2}, {0.0, 0.0997, -M_PI_2}, {0.0, 0.0996, 0.0}};

/// Oracle: Rz(q) Tz(d) Tx(a) Rx(alpha) per joint; the controller's base is turned by pi about z.
Eigen::Isometry3d toolByDh(const ArmPose& q_rad) {
  Eigen::Isometry3d T(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitZ()));
  for (int i = 0; i < 6; ++i) {
    T = T * Eigen::AngleAxisd(q_rad[i], Eigen::Vector3d::UnitZ()) *
        Eigen::Translation3d(kDhTable[i].a_m, 0.0, kDhTable[i].d_m) *
        Eigen::AngleAxisd(kDhTable[i].alpha_rad, Eigen::Vector3d::UnitX());
  }
  return T;
}

class ArmKinematics : public testing::Test {
 protected:
  ArmKinematics() : chain_(robot_.chain(kArmBaseFrame, kToolFrame)), solver_(chain_) {}

  Eigen::Isometry3d toolByUrdf(const ArmPose& q_rad) {
    KDL::JntArray q(6);
    q.data = q_rad;
    KDL::Frame frame;
    EXPECT_EQ(solver_.JntToCart(q, frame), 0);
    return toEigen(frame);
  }

  UrdfRobot robot_;
  KDL::Chain chain_;
  KDL::ChainFkSolverPos_recursive solver_;
};

TEST_F(ArmKinematics, AgreesWithDhTable) {
  std::mt19937_64 rng(1);
  std::uniform_real_distribution<double> angle(-2.0 * M_PI, 2.0 * M_PI);
  for (int i = 0; i < 1000; ++i) {
    const ArmPose q = ArmPose::NullaryExpr([&](Eigen::Index) { return angle(rng); });
    // The published angles have ten digits; on a lever of 1 m that is less than 1e-8.
    ASSERT_LT((toolByUrdf(q).matrix() - toolByDh(q).matrix()).cwiseAbs().maxCoeff(), 1e-6) << q.transpose();
  }
}

TEST_F(ArmKinematics, ReachesPublishedPoints) {
  ArmPose up = ArmPose::Zero();
  up[1] = up[3] = -M_PI_2;
  // Given to 0.1 mm.
  EXPECT_LT((toolByUrdf(ArmPose::Zero()).translation() - Eigen::Vector3d(0.8172, 0.2329, 0.0628)).norm(), 1e-4);
  EXPECT_LT((toolByUrdf(up).translation() - Eigen::Vector3d(0.0, 0.2329, 1.0794)).norm(), 1e-4);
}

TEST_F(ArmKinematics, JointsComeInTheControllersOrder) {
  std::vector<std::string> names;
  for (const KDL::Segment& segment : chain_.segments) {
    if (segment.getJoint().getType() != KDL::Joint::None) names.push_back(segment.getJoint().getName());
  }
  EXPECT_EQ(names, std::vector<std::string>(kArmJoints.begin(), kArmJoints.end()));
}

TEST_F(ArmKinematics, HasPublishedLimits) {
  for (const std::string name : kArmJoints) {
    const urdf::JointConstSharedPtr joint = robot_.urdf().getJoint(name);
    ASSERT_TRUE(joint) << name;
    ASSERT_TRUE(joint->limits) << name;
    const double range_rad = name == "elbow_joint" ? M_PI : 2.0 * M_PI;
    const double effort_Nm = name.rfind("wrist", 0) == 0 ? 28.0 : 150.0;
    EXPECT_DOUBLE_EQ(joint->limits->lower, -range_rad) << name;
    EXPECT_DOUBLE_EQ(joint->limits->upper, range_rad) << name;
    EXPECT_DOUBLE_EQ(joint->limits->velocity, M_PI) << name;
    EXPECT_DOUBLE_EQ(joint->limits->effort, effort_Nm) << name;
    EXPECT_EQ(joint->type, urdf::Joint::REVOLUTE) << name;
  }
}

TEST_F(ArmKinematics, HasPublishedMasses) {
  const std::map<std::string, double> published_kg = {
      {"base_link_inertia", 4.0}, {"shoulder_link", 3.761}, {"upper_arm_link", 8.058}, {"forearm_link", 2.846},
      {"wrist_1_link", 1.37},     {"wrist_2_link", 1.3},    {"wrist_3_link", 0.365}};
  for (const auto& [name, mass_kg] : published_kg) {
    const urdf::LinkConstSharedPtr link = robot_.urdf().getLink("ur5e_" + name);
    ASSERT_TRUE(link && link->inertial) << name;
    EXPECT_DOUBLE_EQ(link->inertial->mass, mass_kg) << name;
  }
}

TEST_F(ArmKinematics, ControllerFrameIsTurnedByPi) {
  const Eigen::Isometry3d T_arm_controller =
      robot_.linkPose(kArmBaseFrame, ArmPose::Zero()).inverse() * robot_.linkPose(kArmControllerFrame, ArmPose::Zero());
  // Rounding of pi in the file.
  EXPECT_LT((T_arm_controller.linear() - Eigen::Vector3d(-1, -1, 1).asDiagonal().toDenseMatrix()).norm(), 1e-12);
  EXPECT_LT(T_arm_controller.translation().norm(), 1e-12);
}

}  // namespace
}  // namespace mp700_ur5e_description
