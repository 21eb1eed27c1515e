// SPDX-License-Identifier: BSD-3-Clause
#include "mp700_ur5e_description/robot_model.h"

#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <kdl/treefksolverpos_recursive.hpp>
#include <kdl_parser/kdl_parser.hpp>
#include <urdf_parser/urdf_parser.h>

#include "mp700_ur5e_description/robot_names.h"

namespace mp700_ur5e_description {
namespace {

const std::string kUrdf = DESCRIPTION_DIR "/urdf/mp700_ur5e.urdf";

std::string shippedText() {
  std::ifstream file(kUrdf);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

std::string replaced(std::string text, const std::string& what, const std::string& with) {
  const std::size_t at = text.find(what);
  if (at == std::string::npos) throw std::logic_error("the URDF has no " + what);
  return text.replace(at, what.size(), with);
}

/// Replaces the first `what` after `where`.
std::string replacedAfter(std::string text, const std::string& where, const std::string& what,
                          const std::string& with) {
  const std::size_t from = text.find(where);
  const std::size_t at = from == std::string::npos ? from : text.find(what, from);
  if (at == std::string::npos) throw std::logic_error("the URDF has no " + what + " after " + where);
  return text.replace(at, what.size(), with);
}

std::string refusalOf(const std::string& urdf) {
  try {
    RobotModel::parse(urdf, "test.urdf");
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

/// A two-link robot; `joint` is what stands between the links.
std::string tinyUrdf(const std::string& joint, const std::string& collision = "") {
  return "<robot name='tiny'><link name='a'>" + collision + "</link><link name='b'/>" + joint + "</robot>";
}

constexpr const char* kTinyJoint =
    "<joint name='j' type='revolute'><parent link='a'/><child link='b'/><origin xyz='1 2 3' rpy='0.1 0.2 0.3'/>"
    "<axis xyz='0 2 0'/><limit lower='-1' upper='2' velocity='3' effort='4'/></joint>";

/// Poses of all links, by KDL's own solver.
class KdlTree {
 public:
  KdlTree() {
    if (!kdl_parser::treeFromFile(kUrdf, tree_)) throw std::runtime_error("cannot read " + kUrdf);
  }

  std::vector<std::string> links() const {
    std::vector<std::string> names;
    for (const auto& [name, element] : tree_.getSegments()) names.push_back(name);
    return names;
  }

  Eigen::Isometry3d pose(const std::string& link, const std::map<std::string, double>& joints) const {
    KDL::JntArray q(tree_.getNrOfJoints());
    for (const auto& [name, element] : tree_.getSegments()) {
      const auto found = joints.find(element.segment.getJoint().getName());
      if (found != joints.end()) q(element.q_nr) = found->second;
    }
    KDL::TreeFkSolverPos_recursive solver(tree_);
    KDL::Frame frame;
    if (solver.JntToCart(q, frame, link) < 0) throw std::runtime_error("no link " + link);
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    for (int row = 0; row < 3; ++row) {
      for (int col = 0; col < 4; ++col) T(row, col) = frame(row, col);
    }
    return T;
  }

 private:
  KDL::Tree tree_;
};

TEST(RobotModel, EveryLinkIsWhereKdlPutsIt) {
  const auto robot = RobotModel::load(kUrdf);
  const KdlTree tree;
  std::mt19937_64 rng(1);
  std::uniform_real_distribution<double> angle(-3.0, 3.0);
  for (int i = 0; i < 20; ++i) {
    Eigen::VectorXd positions(static_cast<Eigen::Index>(robot->joints().size()));
    std::map<std::string, double> by_name;
    for (std::size_t joint = 0; joint < robot->joints().size(); ++joint) {
      positions[static_cast<Eigen::Index>(joint)] = angle(rng);
      by_name[robot->joints()[joint].name] = positions[static_cast<Eigen::Index>(joint)];
    }
    std::vector<Eigen::Isometry3d> bodies;
    robot->bodyPoses(positions, &bodies);
    ASSERT_EQ(bodies.size(), robot->numBodies());
    for (const std::string& link : tree.links()) {
      ASSERT_TRUE(robot->hasFrame(link)) << link;
      const Eigen::Isometry3d pose = bodies[robot->bodyOf(link)] * robot->poseInBody(link);
      // Rounding of some thirty products of numbers about one.
      EXPECT_LT((pose.matrix() - tree.pose(link, by_name).matrix()).cwiseAbs().maxCoeff(), 1e-12) << link;
      EXPECT_EQ(robot->framePose(link, positions).matrix(), pose.matrix()) << link;
    }
  }
}

TEST(RobotModel, BodiesAreWhatMovesTogether) {
  const auto robot = RobotModel::load(kUrdf);
  EXPECT_EQ(robot->rootFrame(), kBaseFrame);
  ASSERT_EQ(robot->joints().size(), 8u) << "six of the arm, two wheels";
  ASSERT_EQ(robot->numBodies(), 9u);
  for (const char* fixed : {kBaseFrame, "chassis_link", kArmBaseFrame, kContainerLink, "camera_mast", kDepthFrame}) {
    EXPECT_EQ(robot->bodyOf(fixed), 0u) << fixed;
  }
  const std::size_t hand = robot->bodyOf("ur5e_wrist_3_link");
  for (const char* carried : {kToolFrame, kMagnetLink, kMagnetTipFrame}) EXPECT_EQ(robot->bodyOf(carried), hand);
  EXPECT_EQ(robot->parentBody(0), 0u);
  std::size_t body = hand;
  for (int i = 5; i >= 0; --i) {
    EXPECT_EQ(body, robot->jointIndex(kArmJoints[static_cast<std::size_t>(i)]) + 1);
    body = robot->parentBody(body);
  }
  EXPECT_EQ(body, 0u);
}

TEST(RobotModel, ShapesAreTheCollisionElementsOfTheUrdf) {
  const auto robot = RobotModel::load(kUrdf);
  const auto urdf = urdf::parseURDFFile(kUrdf);
  std::map<std::string, std::size_t> expected, found;
  std::size_t count = 0;
  for (const auto& [name, link] : urdf->links_) {
    if (!link->collision_array.empty()) expected[name] = link->collision_array.size();
    count += link->collision_array.size();
  }
  ASSERT_GT(count, 30u);
  ASSERT_EQ(robot->shapes().size(), count);
  for (const BodyShape& shape : robot->shapes()) {
    const std::size_t nth = found[shape.link]++;
    EXPECT_EQ(shape.body, robot->bodyOf(shape.link));
    const auto& collision = *urdf->getLink(shape.link)->collision_array[nth];
    const Eigen::Vector3d in_link =
        robot->poseInBody(shape.link).inverse() * Eigen::Vector3d(shape.T_body_shape.translation());
    const auto& origin = collision.origin.position;
    EXPECT_LT((in_link - Eigen::Vector3d(origin.x, origin.y, origin.z)).norm(), 1e-12) << shape.link;
    if (collision.geometry->type == urdf::Geometry::BOX) {
      ASSERT_TRUE(std::holds_alternative<Box>(shape.shape)) << shape.link;
      EXPECT_EQ(std::get<Box>(shape.shape).size_m.x(), static_cast<const urdf::Box&>(*collision.geometry).dim.x);
    } else if (collision.geometry->type == urdf::Geometry::CYLINDER) {
      ASSERT_TRUE(std::holds_alternative<Cylinder>(shape.shape)) << shape.link;
      const auto& cylinder = static_cast<const urdf::Cylinder&>(*collision.geometry);
      EXPECT_EQ(std::get<Cylinder>(shape.shape).radius_m, cylinder.radius);
      EXPECT_EQ(std::get<Cylinder>(shape.shape).length_m, cylinder.length);
    } else {
      ASSERT_TRUE(std::holds_alternative<Sphere>(shape.shape)) << shape.link;
    }
  }
  EXPECT_EQ(found, expected);
}

TEST(RobotModel, JointsHaveTheirLimits) {
  const auto robot = RobotModel::load(kUrdf);
  const auto& elbow = robot->joints()[robot->jointIndex("elbow_joint")];
  EXPECT_DOUBLE_EQ(elbow.lower_rad, -M_PI);
  EXPECT_DOUBLE_EQ(elbow.upper_rad, M_PI);
  EXPECT_DOUBLE_EQ(elbow.velocity_rad_s, M_PI);
  const auto& wheel = robot->joints()[robot->jointIndex(kLeftWheelJoint)];
  EXPECT_EQ(wheel.lower_rad, -std::numeric_limits<double>::infinity());
  EXPECT_EQ(wheel.upper_rad, std::numeric_limits<double>::infinity());
  EXPECT_EQ(wheel.velocity_rad_s, std::numeric_limits<double>::infinity());
}

TEST(RobotModel, AxisNeedNotBeZNorOfUnitLength) {
  const auto robot = RobotModel::parse(tinyUrdf(kTinyJoint), "tiny");
  const Eigen::Isometry3d at_zero = robot->framePose("b", Eigen::VectorXd::Zero(1));
  const Eigen::Isometry3d turned = robot->framePose("b", Eigen::VectorXd::Constant(1, 0.7));
  const Eigen::Matrix3d expected = Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitY()).toRotationMatrix();
  EXPECT_LT((at_zero.linear().transpose() * turned.linear() - expected).norm(), 1e-12);
  EXPECT_LT((turned.translation() - Eigen::Vector3d(1, 2, 3)).norm(), 1e-12);
}

TEST(RobotModel, ChecksumIsOfWhatDecidesReach) {
  const std::string urdf = shippedText();
  const auto checksumOf = [](const std::string& text) { return RobotModel::parse(text, "changed")->checksum(); };
  const std::string shipped = RobotModel::load(kUrdf)->checksum();
  EXPECT_EQ(shipped.size(), 16u);
  EXPECT_EQ(shipped.find_first_not_of("0123456789abcdef"), std::string::npos) << shipped;
  EXPECT_EQ(checksumOf(urdf), shipped);

  const std::string elbow = "<joint name=\"elbow_joint\"";
  EXPECT_NE(checksumOf(replacedAfter(urdf, elbow, "-0.425 0 0", "-0.4251 0 0")), shipped) << "a joint's place";
  EXPECT_NE(checksumOf(replacedAfter(urdf, elbow, "rpy=\"0 0 0\"", "rpy=\"0 0 0.001\"")), shipped) << "its rotation";
  EXPECT_NE(checksumOf(replacedAfter(urdf, elbow, "xyz=\"0 0 1\"", "xyz=\"0 0 -1\"")), shipped) << "its axis";
  EXPECT_NE(checksumOf(replacedAfter(urdf, elbow, "3.141592653589793", "3.0")), shipped) << "its limit";
  EXPECT_NE(checksumOf(replacedAfter(urdf, "<joint name=\"magnet_tip_joint\"", "0 0 0.1", "0 0 0.11")), shipped)
      << "a fixed joint";
  EXPECT_NE(
      checksumOf(replacedAfter(urdf, "<link name=\"ur5e_forearm_link\">", "<collision><origin xyz=\"0 0 0.0115\"/>",
                               "<collision><origin xyz=\"0 0 0.0125\"/>")),
      shipped)
      << "a shape's place";
  EXPECT_NE(checksumOf(replacedAfter(urdf, "<joint name=\"camera_mast_joint\"", "0.02 0.24", "0.02 0.25")), shipped)
      << "the mast, which the arm may hit";

  // What a calibration of the camera changes, what one sees, what weighs.
  const std::string camera = "<joint name=\"camera_joint\"";
  EXPECT_EQ(checksumOf(replacedAfter(urdf, camera, "0.03 0 1.242", "0.031 0.002 1.24")), shipped);
  EXPECT_EQ(checksumOf(replacedAfter(urdf, camera, "rpy=\"0 0.78", "rpy=\"0.01 0.79")), shipped);
  EXPECT_EQ(checksumOf(replaced(urdf, "<mass value=\"8\"/>", "<mass value=\"9\"/>")), shipped);
  EXPECT_EQ(checksumOf(replaced(urdf, "0.76 0.78 0.80 1", "0.1 0.1 0.1 1")), shipped);
}

TEST(RobotModel, ChecksumSeesAShapesSize) {
  const std::string urdf = shippedText();
  const std::string mast = "<link name=\"magnet\">";
  const std::string bigger =
      replacedAfter(urdf, mast, "<collision><origin xyz=\"0 0 0.05\"/><geometry><cylinder radius=\"0.03\"",
                    "<collision><origin xyz=\"0 0 0.05\"/><geometry><cylinder radius=\"0.031\"");
  EXPECT_NE(RobotModel::parse(bigger, "changed")->checksum(), RobotModel::load(kUrdf)->checksum());
}

TEST(RobotModel, WhatIsNoRobotIsRefused) {
  EXPECT_EQ(refusalOf("no xml"), "test.urdf: is no URDF");
  EXPECT_EQ(refusalOf(""), "test.urdf: is no URDF");
  EXPECT_EQ(refusalOf("<robot name='x'/>"), "test.urdf: is no URDF");
  EXPECT_THROW(RobotModel::load("/nowhere/robot.urdf"), std::invalid_argument);
  EXPECT_EQ(refusalOf(tinyUrdf(kTinyJoint)), "");
}

TEST(RobotModel, MeshesAndSlidersAreRefused) {
  EXPECT_EQ(refusalOf(tinyUrdf(kTinyJoint, "<collision><geometry><mesh filename='a.stl'/></geometry></collision>")),
            "link a: a collision shape is a mesh; must be a box, a cylinder or a sphere (adapt_urdf makes them)");
  EXPECT_EQ(refusalOf(replaced(tinyUrdf(kTinyJoint), "revolute", "prismatic")),
            "test.urdf: joint j neither is fixed nor turns");
  EXPECT_EQ(refusalOf(replaced(tinyUrdf(kTinyJoint), "revolute", "floating")),
            "test.urdf: joint j neither is fixed nor turns");
  EXPECT_EQ(refusalOf(replaced(tinyUrdf(kTinyJoint), "0 2 0", "0 0 0")), "test.urdf: joint j has no axis");
}

TEST(RobotModel, UnknownNamesAndSizesAreRefused) {
  const auto robot = RobotModel::load(kUrdf);
  EXPECT_FALSE(robot->hasFrame("nowhere"));
  EXPECT_THROW(robot->jointIndex("nowhere"), std::invalid_argument);
  EXPECT_THROW(robot->jointIndex("arm_mount_joint"), std::invalid_argument) << "fixed";
  EXPECT_THROW(robot->bodyOf("nowhere"), std::invalid_argument);
  EXPECT_THROW(robot->poseInBody("nowhere"), std::invalid_argument);
  EXPECT_THROW(robot->framePose("nowhere", Eigen::VectorXd::Zero(8)), std::invalid_argument);
  EXPECT_THROW(robot->chain(kBaseFrame, "nowhere"), std::invalid_argument);
  std::vector<Eigen::Isometry3d> poses;
  EXPECT_THROW(robot->bodyPoses(Eigen::VectorXd::Zero(7), &poses), std::invalid_argument);
  EXPECT_THROW(robot->bodyPoses(Eigen::VectorXd::Zero(9), &poses), std::invalid_argument);
  EXPECT_NO_THROW(robot->bodyPoses(Eigen::VectorXd::Zero(8), &poses));
}

TEST(RobotModel, ChainIsFromRootToTip) {
  const auto robot = RobotModel::load(kUrdf);
  const KDL::Chain chain = robot->chain(kArmBaseFrame, kMagnetTipFrame);
  EXPECT_EQ(chain.getNrOfJoints(), 6u);
  EXPECT_EQ(chain.segments.back().getName(), kMagnetTipFrame);
}

}  // namespace
}  // namespace mp700_ur5e_description
