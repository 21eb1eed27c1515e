// SPDX-License-Identifier: BSD-3-Clause
// A measured camera pose: its file, and what it makes of the URDF.
#include "mp700_ur5e_description/camera_calibration.h"

#include <sys/wait.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include <gtest/gtest.h>

#include "support/shipped_file.h"
#include "support/urdf_robot.h"

namespace mp700_ur5e_description {
namespace {

namespace fs = std::filesystem;
using test::refusalBy;

CameraCalibration example() {
  CameraCalibration calibration;
  calibration.T_parent_child.translation() << 0.0312, -0.0041, 1.2391;
  calibration.T_parent_child.linear() =
      (Eigen::AngleAxisd(-0.11, Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(0.81, Eigen::Vector3d::UnitY()) *
       Eigen::AngleAxisd(0.02, Eigen::Vector3d::UnitX()))
          .toRotationMatrix();
  calibration.std_m << 0.0011, 0.0007, 0.0009;
  calibration.std_rad << 0.001, 0.002, 0.003;
  calibration.date = "2026-03-01T12:00:00Z";
  calibration.samples = 14;
  calibration.outliers = 1;
  calibration.rms_m = 0.0015;
  calibration.rms_rad = 0.004;
  calibration.leave_one_out_rms_m = 0.0019;
  calibration.leave_one_out_rms_rad = 0.005;
  return calibration;
}

std::string textOf(const std::string& path) {
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

std::string urdfText() {
  return textOf(kUrdfFile);
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  EXPECT_NE(text.find(from), std::string::npos) << from;
  return text.replace(text.find(from), from.size(), to);
}

class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name = (fs::temp_directory_path() / "calibration_XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
    path_ = name;
  }
  ~TemporaryFolder() { fs::remove_all(path_); }
  std::string operator/(const std::string& name) const { return (path_ / name).string(); }

 private:
  fs::path path_;
};

TEST(CameraCalibration, FileSaysWhatWasWritten) {
  const CameraCalibration written = example();
  const CameraCalibration read = parseCameraCalibration(toYaml(written), "test");
  EXPECT_EQ(read.parent_frame, "camera_mast");
  EXPECT_EQ(read.child_frame, "camera_link");
  // Ten digits after the point.
  EXPECT_LT((read.T_parent_child.matrix() - written.T_parent_child.matrix()).cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_LT((read.std_m - written.std_m).norm(), 1e-9);
  EXPECT_LT((read.std_rad - written.std_rad).norm(), 1e-9);
  EXPECT_EQ(read.date, written.date);
  EXPECT_EQ(read.samples, 14);
  EXPECT_EQ(read.outliers, 1);
  EXPECT_NEAR(read.rms_m, 0.0015, 1e-9);
  EXPECT_NEAR(read.rms_rad, 0.004, 1e-9);
  EXPECT_NEAR(read.leave_one_out_rms_m, 0.0019, 1e-9);
  EXPECT_NEAR(read.leave_one_out_rms_rad, 0.005, 1e-9);
}

TEST(CameraCalibration, AnglesAreThoseOfAUrdf) {
  for (const Eigen::Vector3d& rpy : {Eigen::Vector3d(0.1, -0.7, 2.9), Eigen::Vector3d(-3.0, 1.5, -0.2),
                                     Eigen::Vector3d(0.0, M_PI_2, 0.4), Eigen::Vector3d(0.0, -M_PI_2, -1.0)}) {
    urdf::Rotation rotation;
    rotation.setFromRPY(rpy.x(), rpy.y(), rpy.z());
    const Eigen::Matrix3d R =
        Eigen::Quaterniond(rotation.w, rotation.x, rotation.y, rotation.z).normalized().toRotationMatrix();
    EXPECT_LT((toRpy(R) - rpy).norm(), 1e-7) << toRpy(R).transpose();  // near the pole angles are known to 1e-8
  }
}

TEST(CameraCalibration, EverythingWrongWithAFileIsListed) {
  std::string text = toYaml(example());
  text = replaced(text, "samples: 14", "samples: 0");
  text = replaced(text, "rms_m: 0.0015000000", "rms_m: many");
  text = replaced(text, "outliers", "outlyers");
  text = replaced(text, "child_frame: camera_link", "child_frame: camera_mast");
  const std::string refusal = refusalBy([&text] { parseCameraCalibration(text, "test"); });
  for (const std::string part :
       {"test: samples = 0, must be an integer in [1, 100000]", "test: rms_m = many, must be a number in [0, 1] m",
        "test: outliers = (missing)", "test: outlyers is unknown",
        "test: child_frame = camera_mast, must be another frame than parent_frame"}) {
    EXPECT_NE(refusal.find(part), std::string::npos) << refusal;
  }
}

TEST(CameraCalibration, RotationsThatAreNoneOrTwoAreRefused) {
  const std::string text = toYaml(example());
  const std::size_t at = text.find("rotation_xyzw: [") + 16;
  const std::string first = text.substr(at, text.find(',', at) - at);
  EXPECT_NE(refusalBy([&] {
              parseCameraCalibration(replaced(text, first, "0.2"), "test");
            }).find("rotation_xyzw = of length "),
            std::string::npos);
  const std::size_t end = text.find(']', at);
  EXPECT_NE(refusalBy([&] {
              parseCameraCalibration(text.substr(0, at) + "0, 0, 0, 0" + text.substr(end), "test");
            }).find("rotation_xyzw = of length 0, must be of length 1"),
            std::string::npos);
  const std::size_t roll_at = text.find("rpy_rad: [") + 10;
  const std::string roll = text.substr(roll_at, text.find(',', roll_at) - roll_at);
  EXPECT_NE(refusalBy([&] {
              parseCameraCalibration(replaced(text, roll, "0.021"), "test");
            }).find("must be the rotation of rotation_xyzw"),
            std::string::npos);
  EXPECT_NE(refusalBy([] { loadCameraCalibration("/there/is/no/such.yaml"); }).find("/there/is/no/such.yaml"),
            std::string::npos);
}

TEST(CalibratedUrdf, HasTheCameraWhereItWasMeasuredAndAllElseUnmoved) {
  const CameraCalibration calibration = example();
  const urdf::ModelInterfaceSharedPtr changed = urdf::parseURDF(calibratedUrdf(urdfText(), calibration));
  ASSERT_TRUE(changed);
  const UrdfRobot shipped;
  ASSERT_EQ(changed->joints_.size(), shipped.urdf().joints_.size());
  ASSERT_EQ(changed->links_.size(), shipped.urdf().links_.size());
  for (const auto& [name, joint] : shipped.urdf().joints_) {
    const Eigen::Isometry3d expected =
        name == "camera_joint" ? calibration.T_parent_child : toEigen(joint->parent_to_joint_origin_transform);
    const Eigen::Isometry3d T = toEigen(changed->getJoint(name)->parent_to_joint_origin_transform);
    EXPECT_LT((T.matrix() - expected.matrix()).norm(), 1e-9) << name;
    EXPECT_EQ(changed->getJoint(name)->type, joint->type) << name;
  }
  for (const auto& [name, link] : shipped.urdf().links_) {
    EXPECT_EQ(changed->getLink(name)->collision_array.size(), link->collision_array.size()) << name;
    EXPECT_EQ(changed->getLink(name)->visual_array.size(), link->visual_array.size()) << name;
  }
}

TEST(CalibratedUrdf, AJointWithoutOriginGetsOne) {
  CameraCalibration calibration = example();
  calibration.parent_frame = "a";
  calibration.child_frame = "b";
  const std::string urdf = R"(<robot name="r"><link name="a"/><link name="b"/>)"
                           R"(<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint></robot>)";
  const urdf::ModelInterfaceSharedPtr changed = urdf::parseURDF(calibratedUrdf(urdf, calibration));
  ASSERT_TRUE(changed);
  EXPECT_LT(
      (toEigen(changed->getJoint("j")->parent_to_joint_origin_transform).matrix() - calibration.T_parent_child.matrix())
          .norm(),
      1e-9);
}

TEST(CalibratedUrdf, RefusesEdgesThatAreNotThere) {
  const auto refusal = [](const std::string& urdf, const std::string& parent, const std::string& child) {
    CameraCalibration calibration = example();
    calibration.parent_frame = parent;
    calibration.child_frame = child;
    return refusalBy([&] { calibratedUrdf(urdf, calibration); });
  };
  EXPECT_NE(refusal(urdfText(), "camera_mast", "webcam").find("no joint in the URDF has the child webcam"),
            std::string::npos);
  EXPECT_NE(refusal(urdfText(), "base_link", "camera_link").find("camera_link is on camera_mast"), std::string::npos);
  EXPECT_NE(refusal(urdfText(), "ur5e_base_link_inertia", "ur5e_shoulder_link").find("must be fixed"),
            std::string::npos);
  EXPECT_NE(refusal("<robot", "a", "b").find("not XML"), std::string::npos);
  EXPECT_NE(refusal("<sdf/>", "a", "b").find("<robot>"), std::string::npos);
}

TEST(CalibratedUrdf, ProgramPrintsItOrFailsWithTheReason) {
  const TemporaryFolder folder;
  std::ofstream(folder / "calibration.yaml") << toYaml(example());
  const std::string program = CALIBRATED_URDF;
  const auto run = [&](const std::string& arguments) {
    const int status =
        std::system((program + " " + arguments + " > " + (folder / "out") + " 2> " + (folder / "err")).c_str());
    return WEXITSTATUS(status);
  };
  const auto text = [&](const std::string& name) { return textOf(folder / name); };
  EXPECT_EQ(run(kUrdfFile + " " + (folder / "calibration.yaml")), 0);
  EXPECT_TRUE(text("out") == calibratedUrdf(urdfText(), parseCameraCalibration(toYaml(example()), "test")));
  EXPECT_EQ(run(kUrdfFile + " " + (folder / "missing.yaml")), 1);
  EXPECT_NE(text("err").find("missing.yaml"), std::string::npos) << text("err");
  EXPECT_EQ(run(kUrdfFile + "x " + (folder / "calibration.yaml")), 1);
  EXPECT_NE(text("err").find(kUrdfFile + "x: cannot be read"), std::string::npos) << text("err");
  EXPECT_EQ(run(kUrdfFile), 2);
}

}  // namespace
}  // namespace mp700_ur5e_description
