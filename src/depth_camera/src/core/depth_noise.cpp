// SPDX-License-Identifier: BSD-3-Clause
#include "depth_camera/depth_noise.h"

#include <map>
#include <stdexcept>

namespace depth_camera {
namespace {

const std::map<std::string, DepthNoiseModel>& noisePresets() {
  // Sources: Nguyen et al. 2012 (Kinect v1), Fankhauser et al. 2015 (v2), Toelgyessy et al. 2021 (Azure, upper bound),
  // Intel's z^2 sigma_d / (f B) with 0.08 px of disparity noise at 848 px (D415, D435).
  static const std::map<std::string, DepthNoiseModel> kPresets = {
      {"generic", {0.0005, 0.0, 0.0017}},        {"kinect_v1", {0.001504, -0.00152, 0.0019}},
      {"kinect_v2", {0.0015, -0.0005, 0.0003}},  {"azure_kinect", {0.001, 0.0, 0.0013}},
      {"realsense_d415", {0.0005, 0.0, 0.0022}}, {"realsense_d435", {0.0005, 0.0, 0.0038}},
  };
  return kPresets;
}

}  // namespace

DepthNoiseModel DepthNoiseModel::preset(const std::string& name) {
  const auto found = noisePresets().find(name);
  if (found != noisePresets().end()) return found->second;
  std::string known;
  for (const std::string& word : presetNames()) known += (known.empty() ? "" : ", ") + word;
  throw std::invalid_argument("depth noise preset '" + name + "' is unknown, must be one of " + known);
}

std::vector<std::string> DepthNoiseModel::presetNames() {
  std::vector<std::string> names;
  for (const auto& entry : noisePresets()) names.push_back(entry.first);
  return names;
}

}  // namespace depth_camera
