// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <string>

#include <Eigen/Core>

namespace mp700_ur5e_description {

/// The factory calibration of this very arm, as ur_calibration extracts it: the origins of the arm's six joints, in the
/// order of kArmJoints. The arm's driver compares only its checksum with the controller's; who computes where the tool is
/// has to have it in the URDF.
struct ArmCalibration {
  struct Origin {
    Eigen::Vector3d xyz_m{Eigen::Vector3d::Zero()};
    Eigen::Vector3d rpy_rad{Eigen::Vector3d::Zero()};  ///< as in a URDF
  };
  std::array<Origin, 6> origins;
};

/// Throw std::invalid_argument listing everything wrong with the file, a line each.
ArmCalibration parseArmCalibration(const std::string& text, const std::string& name);
ArmCalibration loadArmCalibration(const std::string& path);

/// The URDF with the origins of the arm's joints replaced. Throws std::invalid_argument if the text is no URDF or lacks
/// one of the joints.
std::string calibratedUrdf(const std::string& urdf, const ArmCalibration& calibration);

/// How far the magnet's tip is from where a calibrated URDF has it, over random postures of all joints; always the same
/// ones. The worst of each need not be of one posture.
struct ArmDifference {
  double mean_m{0.0};
  double worst_m{0.0};
  double worst_rad{0.0};
};
ArmDifference differenceOf(const std::string& urdf, const ArmCalibration& calibration);

}  // namespace mp700_ur5e_description
