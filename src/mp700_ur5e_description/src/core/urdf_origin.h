// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <tinyxml2.h>
#include <Eigen/Core>

namespace mp700_ur5e_description {

/// Nanometres and nanoradians, a thousandth of what any calibration is known to.
std::string toDigits(const Eigen::VectorXd& values, const char* separator);

/// The <robot>. Throws std::invalid_argument if the text is no XML or has none.
tinyxml2::XMLElement* parseUrdf(const std::string& urdf, tinyxml2::XMLDocument* document);
/// Roll, pitch, yaw as in a URDF. A joint without an origin gets one.
void setOrigin(tinyxml2::XMLElement* joint, const Eigen::Vector3d& xyz_m, const Eigen::Vector3d& rpy_rad);
std::string toText(const tinyxml2::XMLDocument& document);

}  // namespace mp700_ur5e_description
