// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <Eigen/Geometry>

namespace mp700_ur5e_description {

/// Where a fixed part of this very robot is, as measured: one edge of the tree of frames. It replaces a fixed joint's
/// origin in the URDF. So tf, planners and self filters all get it from one source, and no second publisher of the edge
/// is needed.
struct CameraCalibration {
  std::string parent_frame{"camera_mast"};
  std::string child_frame{"camera_link"};
  Eigen::Isometry3d T_parent_child{Eigen::Isometry3d::Identity()};
  // How it was found; for people, and for what wants to know how good it is.
  Eigen::Vector3d std_m{Eigen::Vector3d::Zero()};    ///< of the translation, along the parent's axes
  Eigen::Vector3d std_rad{Eigen::Vector3d::Zero()};  ///< of the rotation, about the parent's axes
  std::string date;                                  ///< when, in words or as ISO 8601
  int samples{0};                                    ///< used
  int outliers{0};                                   ///< left out
  double rms_m{0.0};
  double rms_rad{0.0};
  double leave_one_out_rms_m{0.0};
  double leave_one_out_rms_rad{0.0};
};

/// The file. parseCameraCalibration() of it gives the same to the 9th digit.
std::string toYaml(const CameraCalibration& calibration);

/// Throw std::invalid_argument listing everything wrong with the file, a line each. Wrong are unknown, missing and
/// impossible keys, a quaternion that is not of length one, and angles of another rotation than the quaternion's.
CameraCalibration parseCameraCalibration(const std::string& text, const std::string& name);
CameraCalibration loadCameraCalibration(const std::string& path);

/// Roll, pitch, yaw [rad] as in a URDF's origin: R = Rz(yaw) Ry(pitch) Rx(roll).
Eigen::Vector3d toRpy(const Eigen::Matrix3d& R);

/// The URDF with the origin of the joint between both frames replaced. Throws std::invalid_argument if the text is no
/// URDF, if no joint joins the frames, or if that joint moves.
std::string calibratedUrdf(const std::string& urdf, const CameraCalibration& calibration);

}  // namespace mp700_ur5e_description
