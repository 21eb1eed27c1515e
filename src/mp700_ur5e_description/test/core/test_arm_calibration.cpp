// SPDX-License-Identifier: BSD-3-Clause
// The arm's own kinematics: ur_calibration's file, what it makes of the URDF, and how far the tip is off without it.
#include "mp700_ur5e_description/arm_calibration.h"

#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include <gtest/gtest.h>

#include "support/shipped_file.h"
#include "support/urdf_robot.h"

namespace mp700_ur5e_description {
namespace {

using test::refusalBy;

std::string textOf(const std::string& path) {
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

const char* const kLinks[] = {"shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"};

/// A file of ur_calibration for an arm whose joints are where the shipped URDF has them, moved by `off` (x, y, z [m],
/// roll, pitch, yaw [rad]) each.
std::string fileMovedBy(const Eigen::Matrix<double, 6, 1>& off) {
  const UrdfRobot shipped;
  std::ostringstream text;
  text.precision(12);
  text << "kinematics:\n";
  for (int i = 0; i < 6; ++i) {
    const urdf::Pose pose = shipped.urdf().getJoint(kArmJoints[i])->parent_to_joint_origin_transform;
    double roll, pitch, yaw;
    pose.rotation.getRPY(roll, pitch, yaw);
    text << "  " << kLinks[i] << ": {x: " << pose.position.x + off[0] << ", y: " << pose.position.y + off[1]
         << ", z: " << pose.position.z + off[2] << ", roll: " << roll + off[3] << ", pitch: " << pitch + off[4]
         << ", yaw: " << yaw + off[5] << "}\n";
  }
  text << "  hash: calib_1\n";
  return text.str();
}

Eigen::Matrix<double, 6, 1> moved(double x_m, double yaw_rad) {
  Eigen::Matrix<double, 6, 1> off = Eigen::Matrix<double, 6, 1>::Zero();
  off[0] = x_m;
  off[5] = yaw_rad;
  return off;
}

TEST(ArmCalibration, GoesIntoTheJointsOfTheArmAndNowhereElse) {
  const ArmCalibration calibration = parseArmCalibration(fileMovedBy(moved(0.001, 0.002)), "test");
  const urdf::ModelInterfaceSharedPtr changed = urdf::parseURDF(calibratedUrdf(textOf(kUrdfFile), calibration));
  ASSERT_TRUE(changed);
  const UrdfRobot shipped;
  ASSERT_EQ(changed->joints_.size(), shipped.urdf().joints_.size());
  for (const auto& [name, joint] : shipped.urdf().joints_) {
    const Eigen::Isometry3d T = toEigen(joint->parent_to_joint_origin_transform);
    const Eigen::Isometry3d T_changed = toEigen(changed->getJoint(name)->parent_to_joint_origin_transform);
    const bool is_arm = std::find(kArmJoints.begin(), kArmJoints.end(), name) != kArmJoints.end();
    const Eigen::Vector3d expected_m = T.translation() + (is_arm ? 0.001 : 0.0) * Eigen::Vector3d::UnitX();
    EXPECT_LT((T_changed.translation() - expected_m).norm(), 1e-9) << name;
    EXPECT_NEAR(Eigen::AngleAxisd(T.linear().transpose() * T_changed.linear()).angle(), is_arm ? 0.002 : 0.0, 1e-7)
        << name;
  }
}

TEST(ArmCalibration, DifferenceIsThatOfTheTip) {
  const std::string urdf = textOf(kUrdfFile);
  const ArmDifference none = differenceOf(urdf, parseArmCalibration(fileMovedBy(moved(0.0, 0.0)), "test"));
  EXPECT_LT(none.worst_m, 1e-7);
  EXPECT_LT(none.worst_rad, 1e-6);
  // Once written it is gone.
  const ArmCalibration calibration = parseArmCalibration(fileMovedBy(moved(0.0005, 0.001)), "test");
  const ArmDifference off = differenceOf(urdf, calibration);
  EXPECT_GT(off.worst_m, off.mean_m);
  EXPECT_LE(off.worst_m, 6 * 0.0005 + 6 * 0.001 * 1.3);  // each joint's, at the arm's length at most
  EXPECT_GT(off.worst_m, 0.002);
  EXPECT_LE(off.worst_rad, 6 * 0.001 + 1e-6);
  EXPECT_GT(off.worst_rad, 0.002);
  EXPECT_LT(differenceOf(calibratedUrdf(urdf, calibration), calibration).worst_m, 1e-7);
  // One joint alone, about the base's vertical axis: an angle, and the tip's distance from the axis times it.
  ArmCalibration shoulder = parseArmCalibration(fileMovedBy(moved(0.0, 0.0)), "test");
  shoulder.origins[0].rpy_rad.z() += 0.01;
  const ArmDifference turned = differenceOf(urdf, shoulder);
  EXPECT_NEAR(turned.worst_rad, 0.01, 1e-6);
  EXPECT_LT(turned.worst_m, 0.01 * 1.2);
  EXPECT_GT(turned.worst_m, 0.01 * 0.9) << "stretched out";
}

TEST(ArmCalibration, EverythingWrongWithAFileIsListed) {
  const std::string file = fileMovedBy(moved(0.0, 0.0));
  const auto changed = [&file](const std::string& from, const std::string& to) {
    std::string text = file;
    EXPECT_NE(text.find(from), std::string::npos) << from;
    return text.replace(text.find(from), from.size(), to);
  };
  EXPECT_NE(refusalBy([&] {
              parseArmCalibration(changed("  forearm:", "  underarm:"), "test");
            }).find("test: kinematics/forearm = (missing)"),
            std::string::npos);
  EXPECT_NE(refusalBy([&] {
              parseArmCalibration(changed("{x: 0,", "{x: 162.5,"), "test");
            }).find("test: kinematics/shoulder/x = 162.5, must be a number in [-2, 2] m"),
            std::string::npos);
  EXPECT_NE(refusalBy([&] { parseArmCalibration(changed("  hash: calib_1\n", ""), "test"); }).find("hash"),
            std::string::npos);
  const ArmCalibration calibration = parseArmCalibration(file, "test");
  EXPECT_NE(refusalBy([&] { calibratedUrdf("<robot name=\"r\"/>", calibration); }).find("shoulder_pan_joint"),
            std::string::npos);
}

TEST(ArmCalibration, ProgramPrintsTheUrdfOrTheDifference) {
  namespace fs = std::filesystem;
  std::string folder = (fs::temp_directory_path() / "arm_calibration_XXXXXX").string();
  ASSERT_NE(::mkdtemp(folder.data()), nullptr);
  std::ofstream(folder + "/arm.yaml") << fileMovedBy(moved(0.0005, 0.001));
  const auto run = [&](const std::string& arguments) {
    const std::string command =
        std::string(CALIBRATED_URDF) + " " + arguments + " > " + folder + "/out 2> " + folder + "/err";
    return WEXITSTATUS(std::system(command.c_str()));
  };
  EXPECT_EQ(run(kUrdfFile + " --arm " + folder + "/arm.yaml"), 0);
  const std::string urdf = textOf(folder + "/out");
  EXPECT_EQ(urdf, calibratedUrdf(textOf(kUrdfFile), loadArmCalibration(folder + "/arm.yaml")));
  std::ofstream(folder + "/calibrated.urdf") << urdf;
  EXPECT_EQ(run(kUrdfFile + " --compare " + folder + "/arm.yaml"), 0);
  EXPECT_EQ(textOf(folder + "/out").find("mean_mm: "), 0U);
  EXPECT_EQ(run(folder + "/calibrated.urdf --compare " + folder + "/arm.yaml"), 0);
  EXPECT_EQ(textOf(folder + "/out"), "mean_mm: 0.000\nworst_mm: 0.000\nworst_deg: 0.0000\n");
  EXPECT_EQ(run(kUrdfFile + " --arm " + folder + "/none.yaml"), 1);
  EXPECT_NE(textOf(folder + "/err").find("none.yaml"), std::string::npos);
  EXPECT_EQ(run(kUrdfFile + " --arms " + folder + "/arm.yaml"), 2);
  fs::remove_all(folder);
}

}  // namespace
}  // namespace mp700_ur5e_description
