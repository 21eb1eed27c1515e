// SPDX-License-Identifier: BSD-3-Clause
// From what was measured (base to optical frame) to what the URDF holds (mast to housing), and into a file.
#include "brick_detection/calibration_file.h"

#include <filesystem>
#include <fstream>
#include <random>

#include <Eigen/Cholesky>
#include <gmock/gmock.h>
#include <interactive_mapping_common/files/atomic_file.h>

namespace brick_detection {
namespace {

namespace fs = std::filesystem;
using mp700_ur5e_description::CameraCalibration;
using ::testing::HasSubstr;

Eigen::Isometry3d pose(const Eigen::Vector3d& t, const Eigen::Vector3d& axis, double angle_rad) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = t;
  T.rotate(Eigen::AngleAxisd(angle_rad, axis.normalized()));
  return T;
}

CalibratedEdge edge() {
  CalibratedEdge result;
  result.T_base_parent = pose({0.02, 0.24, 0.358}, {0.1, 0.2, 1.0}, 0.8);
  result.T_child_camera = pose({0.01, 0.05, -0.02}, {1.0, -1.0, 1.0}, 2.1);
  return result;
}

HandEyeResult result() {
  HandEyeResult measured;
  measured.T_base_camera = pose({0.05, 0.24, 1.6}, {-1.9, 0.4, -0.3}, 1.9);
  Matrix6d root;
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal(0.0, 0.001);
  for (Eigen::Index i = 0; i < root.size(); ++i) root.data()[i] = normal(random);
  root.bottomRows<3>() *= 30.0;  // so that the turn's share in the place is seen
  measured.covariance = root * root.transpose();
  measured.residuals.resize(12);
  measured.num_used = 10;
  measured.rms_m = 0.001;
  measured.rms_rad = 0.002;
  measured.leave_one_out_rms_m = 0.003;
  measured.leave_one_out_rms_rad = 0.004;
  return measured;
}

TEST(CalibrationFile, EdgeLeadsToWhereTheCameraWasMeasured) {
  const CameraCalibration calibration = toCameraCalibration(result(), edge(), "today");
  const Eigen::Isometry3d T_base_camera = edge().T_base_parent * calibration.T_parent_child * edge().T_child_camera;
  EXPECT_LT((T_base_camera.matrix() - result().T_base_camera.matrix()).norm(), 1e-12);
  EXPECT_EQ(calibration.samples, 10);
  EXPECT_EQ(calibration.outliers, 2);
  EXPECT_EQ(calibration.date, "today");
  EXPECT_EQ(calibration.rms_m, 0.001);
  EXPECT_EQ(calibration.rms_rad, 0.002);
  EXPECT_EQ(calibration.leave_one_out_rms_m, 0.003);
  EXPECT_EQ(calibration.leave_one_out_rms_rad, 0.004);
}

TEST(CalibrationFile, DeviationsAreThoseOfTheEdge) {
  const CameraCalibration calibration = toCameraCalibration(result(), edge(), "today");
  const Matrix6d root = result().covariance.llt().matrixL();
  // To first order the edge's change is linear in the camera's: columns of the root, made small, by differences.
  constexpr double kSmall = 1e-5;
  Eigen::Matrix<double, 6, 6> changes;
  for (int i = 0; i < 6; ++i) {
    HandEyeResult moved = result();
    const Eigen::Matrix<double, 6, 1> d = kSmall * root.col(i);
    moved.T_base_camera.translation() += d.head<3>();
    moved.T_base_camera.linear() =
        Eigen::AngleAxisd(d.tail<3>().norm(), d.tail<3>().normalized()) * moved.T_base_camera.linear();
    const Eigen::Isometry3d T = toCameraCalibration(moved, edge(), "").T_parent_child;
    const Eigen::AngleAxisd turn(Eigen::Matrix3d(T.linear() * calibration.T_parent_child.linear().transpose()));
    changes.col(i) << (T.translation() - calibration.T_parent_child.translation()) / kSmall,
        turn.angle() * turn.axis() / kSmall;
  }
  const Eigen::Matrix<double, 6, 1> expected = (changes * changes.transpose()).diagonal().cwiseSqrt();
  for (int i = 0; i < 3; ++i) {
    // Second order of a turn by 1e-6, and its rounding.
    EXPECT_NEAR(calibration.std_m[i], expected[i], 1e-4 * expected[i]) << i;
    EXPECT_NEAR(calibration.std_rad[i], expected[3 + i], 1e-4 * expected[3 + i]) << i;
  }
}

TEST(CalibrationFile, WithoutAnAnswerThereIsNone) {
  HandEyeResult failed = result();
  failed.failure = HandEyeFailure::kTooFewSamples;
  failed.reason = "too few samples";
  EXPECT_THROW(toCameraCalibration(failed, edge(), ""), std::invalid_argument);
}

TEST(CalibrationFile, IsReadBackAndReplacedWhole) {
  std::string name = (fs::temp_directory_path() / "calibration_XXXXXX").string();
  ASSERT_NE(::mkdtemp(name.data()), nullptr);
  const fs::path folder(name);
  const std::string path = folder / "camera_calibration.yaml";
  std::ofstream(path) << "older and longer than what comes: " << std::string(5000, 'x');
  const CameraCalibration written = toCameraCalibration(result(), edge(), "today");
  saveCameraCalibration(path, written);
  const CameraCalibration read = mp700_ur5e_description::loadCameraCalibration(path);
  EXPECT_LT((read.T_parent_child.matrix() - written.T_parent_child.matrix()).norm(), 1e-9);  // the file's ten digits
  EXPECT_EQ(read.date, "today");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), 1) << "nothing else is left there";
  fs::remove_all(folder);
  try {
    saveCameraCalibration(path, written);
    FAIL() << "saved into a folder that is not there";
  } catch (const interactive_mapping::FileError& error) {
    EXPECT_THAT(error.what(), HasSubstr(folder.string()));
  }
}

}  // namespace
}  // namespace brick_detection
