// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/calibration_file.h"

#include <stdexcept>

#include <interactive_mapping_common/files/atomic_file.h>

namespace brick_detection {

mp700_ur5e_description::CameraCalibration toCameraCalibration(const HandEyeResult& result, const CalibratedEdge& edge,
                                                              const std::string& date) {
  if (!result.isGood()) throw std::invalid_argument("no calibration: " + result.reason);
  mp700_ur5e_description::CameraCalibration calibration;
  calibration.parent_frame = edge.parent_frame;
  calibration.child_frame = edge.child_frame;
  const Eigen::Isometry3d T_camera_child = edge.T_child_camera.inverse();
  calibration.T_parent_child = edge.T_base_parent.inverse() * result.T_base_camera * T_camera_child;

  // The child's origin lies at R_base_camera p from the camera's: it moves by dt + dr x (R_base_camera p).
  const Eigen::Vector3d arm = result.T_base_camera.linear() * T_camera_child.translation();
  Matrix6d change = Matrix6d::Identity();
  change.topRightCorner<3, 3>() << 0.0, arm.z(), -arm.y(), -arm.z(), 0.0, arm.x(), arm.y(), -arm.x(), 0.0;
  const Eigen::Matrix3d R_parent_base = edge.T_base_parent.linear().transpose();
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = R_parent_base;
  turn.bottomRightCorner<3, 3>() = R_parent_base;
  const Matrix6d covariance = turn * change * result.covariance * change.transpose() * turn.transpose();
  calibration.std_m = covariance.diagonal().head<3>().cwiseSqrt();
  calibration.std_rad = covariance.diagonal().tail<3>().cwiseSqrt();

  calibration.date = date;
  calibration.samples = result.num_used;
  calibration.outliers = static_cast<int>(result.residuals.size()) - result.num_used;
  calibration.rms_m = result.rms_m;
  calibration.rms_rad = result.rms_rad;
  calibration.leave_one_out_rms_m = result.leave_one_out_rms_m;
  calibration.leave_one_out_rms_rad = result.leave_one_out_rms_rad;
  return calibration;
}

void saveCameraCalibration(const std::string& path, const mp700_ur5e_description::CameraCalibration& calibration) {
  interactive_mapping::AtomicFile file(path);
  file.write(toYaml(calibration));
  file.commit();
}

}  // namespace brick_detection
