// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/types.h"

#include <limits>
#include <sstream>
#include <stdexcept>

namespace gpis_mapping {
namespace {

// A focal length of 1/20 of the image is a field of view of 169 degrees: no rectified image has more. Far beyond 1e5 px
// (5 degrees over 8192 px) a pixel is finer than light allows.
constexpr double kMinFocalShare = 0.05;
constexpr double kMaxFocal_px = 1e6;
// A cut-out of a larger image may have its principal point outside, but not arbitrarily far.
constexpr double kMaxCenterSizes = 10.0;

void checkRange(const char* name, double value, double low, double high, std::vector<std::string>* problems) {
  if (value >= low && value <= high) return;  // false for NaN
  std::ostringstream text;
  text << "camera " << name << " = " << value << " px, must be in [" << low << ", " << high << "] px";
  problems->push_back(text.str());
}

}  // namespace

std::vector<std::string> CameraModel::validate() const {
  std::vector<std::string> problems;
  for (const auto& [name, size] : {std::make_pair("width", width), std::make_pair("height", height)}) {
    if (size >= 16 && size <= 8192) continue;
    problems.push_back(std::string("camera ") + name + " = " + std::to_string(size) + " px, must be in [16, 8192] px");
  }
  if (!problems.empty()) return problems;  // the other ranges depend on the size
  checkRange("fx", fx, kMinFocalShare * width, kMaxFocal_px, &problems);
  checkRange("fy", fy, kMinFocalShare * height, kMaxFocal_px, &problems);
  checkRange("cx", cx, -kMaxCenterSizes * width, (1.0 + kMaxCenterSizes) * width, &problems);
  checkRange("cy", cy, -kMaxCenterSizes * height, (1.0 + kMaxCenterSizes) * height, &problems);
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

bool holdsMeasurement(const DepthImage& image) {
  return std::any_of(image.depth_m.begin(), image.depth_m.end(), [](float z) { return z > 0.0f; });
}

std::string nothingMeasured(const DepthImage& image) {
  return "none of " + std::to_string(image.depth_m.size()) + " pixels holds a depth or +Inf: is the lens covered?";
}

}  // namespace gpis_mapping
