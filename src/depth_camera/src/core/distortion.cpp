// SPDX-License-Identifier: BSD-3-Clause
#include "depth_camera/distortion.h"

#include <map>
#include <vector>

namespace depth_camera {

std::optional<Distortion> distortionNamed(const std::string& model) {
  static const std::map<std::string, Distortion> kModels = {
      {"", Distortion::kNone},
      {"plumb_bob", Distortion::kPlumbBob},
      {"rational_polynomial", Distortion::kRationalPolynomial},
      {"equidistant", Distortion::kEquidistant},
      {"fisheye", Distortion::kEquidistant},  // OpenCV's word for the same
  };
  const auto found = kModels.find(model);
  return found == kModels.end() ? std::nullopt : std::make_optional(found->second);
}

std::string countsOtherThan(std::size_t count, Distortion distortion) {
  static const std::map<Distortion, std::vector<std::size_t>> kCounts = {{Distortion::kNone, {0}},
                                                                         {Distortion::kPlumbBob, {4, 5}},
                                                                         {Distortion::kRationalPolynomial, {8, 12, 14}},
                                                                         {Distortion::kEquidistant, {4}}};
  std::string text;
  for (const std::size_t allowed : kCounts.at(distortion)) {
    if (allowed == count) return "";
    text += (text.empty() ? "" : " or ") + std::to_string(allowed);
  }
  return text;
}

}  // namespace depth_camera
