// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/types.h"

#include <limits>
#include <sstream>
#include <stdexcept>

namespace gpis_mapping {
namespace {

void checkPositive(const char* name, double value, std::vector<std::string>* problems) {
  if (std::isfinite(value) && value > 0.0) return;
  std::ostringstream text;
  text << "camera " << name << " = " << value << " px, must be > 0 px";
  problems->push_back(text.str());
}

}  // namespace

std::vector<std::string> CameraModel::validate() const {
  std::vector<std::string> problems;
  for (const auto& [name, size] : {std::make_pair("width", width), std::make_pair("height", height)}) {
    if (size >= 16 && size <= 8192) continue;
    problems.push_back(std::string("camera ") + name + " = " + std::to_string(size) + " px, must be in [16, 8192] px");
  }
  checkPositive("fx", fx, &problems);
  checkPositive("fy", fy, &problems);
  if (!std::isfinite(cx) || !std::isfinite(cy)) problems.push_back("camera principal point (cx, cy) must be finite");
  return problems;
}

DepthImage depthImageFromU16(const std::uint16_t* raw, int width, int height, double units_per_metre) {
  if (!(units_per_metre > 0.0) || !std::isfinite(units_per_metre)) {
    throw std::invalid_argument("depth units per metre = " + std::to_string(units_per_metre) + ", must be > 0");
  }
  DepthImage image{width, height, std::vector<float>(static_cast<std::size_t>(width) * height)};
  const float scale = static_cast<float>(1.0 / units_per_metre);
  for (std::size_t i = 0; i < image.depth_m.size(); ++i) {
    image.depth_m[i] = raw[i] == std::numeric_limits<std::uint16_t>::max() ? 0.0f : scale * raw[i];
  }
  return image;
}

const char* toString(SpaceState state) {
  switch (state) {
    case SpaceState::kFree:
      return "free";
    case SpaceState::kOccupied:
      return "occupied";
    case SpaceState::kUnknown:
      break;
  }
  return "unknown";
}

}  // namespace gpis_mapping
