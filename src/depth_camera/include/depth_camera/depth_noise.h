// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace depth_camera {

/// Axial noise of a depth camera: sigma_z(z) = a + b z + c z^2 [m], z in metres.
struct DepthNoiseModel {
  double a_m{0.0005};
  double b{0.0};
  double c_per_m{0.0017};

  double sigma(double z_m) const { return a_m + (b + c_per_m * z_m) * z_m; }

  /// Presets: generic, kinect_v1, kinect_v2, azure_kinect, realsense_d415, realsense_d435. Throws
  /// std::invalid_argument naming the known ones.
  static DepthNoiseModel preset(const std::string& name);
  static std::vector<std::string> presetNames();
};

}  // namespace depth_camera
