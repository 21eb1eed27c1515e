// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <Eigen/Core>

namespace mp700_ur5e_description {

/// Joint angles [rad] in the order of kArmJoints.
using ArmPose = Eigen::Matrix<double, 6, 1>;

/// A file of config/arm_poses: an angle per joint, by name. Throws std::invalid_argument listing everything wrong with
/// the file, a line each.
ArmPose loadArmPose(const std::string& path);
ArmPose parseArmPose(const std::string& text, const std::string& name);

}  // namespace mp700_ur5e_description
