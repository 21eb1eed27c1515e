// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/tag_detector.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <tuple>

#include <mp700_ur5e_description/brick_types.h>

#include <interactive_mapping_common/config/range_check.h>
#include "apriltag_detector.h"
#include "aruco_detector.h"
#include "detector_support.h"

namespace brick_detection {
namespace {

template <typename Value>
std::string sentence(const std::string& key, const Value& value, const std::string& rule) {
  std::ostringstream text;
  text << key << " = " << value << ", must be " << rule;
  return text.str();
}

}  // namespace

double TagObservation::shortestSide() const {
  double shortest_px = (corners_px[0] - corners_px[3]).norm();
  for (std::size_t i = 0; i < 3; ++i) shortest_px = std::min(shortest_px, (corners_px[i + 1] - corners_px[i]).norm());
  return shortest_px;
}

std::vector<std::string> TagDetectorConfig::validate() const {
  std::vector<std::string> problems;
  if (family == "ALVAR_5X5") {
    problems.push_back(
        sentence("family", family,
                 "one that is decoded here: the tags of ar_track_alvar are decoded by its own node, whose "
                 "messages come in by the alvar input"));
  } else if (!isAprilTagFamily(family) && !isArucoFamily(family)) {
    std::string names;
    for (const std::string& name : mp700_ur5e_description::TagLayout::families()) {
      if (isAprilTagFamily(name) || isArucoFamily(name)) names += (names.empty() ? "" : ", ") + name;
    }
    problems.push_back(sentence("family", family, "one of: " + names));
  }
  if (threads < 1 || threads > 64) problems.push_back(sentence("threads", threads, "in [1, 64]"));
  const std::array<double, 5> factors = {1.0, 1.5, 2.0, 3.0, 4.0};  // what libapriltag knows
  if (std::find(factors.begin(), factors.end(), decimate) == factors.end()) {
    problems.push_back(sentence("decimate", decimate, "1, 1.5, 2, 3 or 4"));
  }
  if (!(blur_sigma_px >= 0.0 && blur_sigma_px <= 10.0)) {
    problems.push_back(sentence("blur_sigma_px", blur_sigma_px, "in [0, 10] px"));
  }
  if (!(sharpening >= 0.0 && sharpening <= 10.0)) {
    problems.push_back(sentence("sharpening", sharpening, "in [0, 10]"));
  }
  if (max_hamming < 0 || max_hamming > 2) problems.push_back(sentence("max_hamming", max_hamming, "in [0, 2]"));
  return problems;
}

std::unique_ptr<TagDetector> makeTagDetector(const TagDetectorConfig& config) {
  interactive_mapping::throwIfAny(config.validate());
  return isAprilTagFamily(config.family) ? makeAprilTagDetector(config) : makeArucoDetector(config);
}

void requireGrey(const cv::Mat& grey) {
  if (grey.empty()) throw std::invalid_argument("grey: size = 0, must be an image");
  if (grey.type() != CV_8UC1 || grey.dims != 2) {
    throw std::invalid_argument("grey: type = " + cv::typeToString(grey.type()) + ", must be CV_8UC1");
  }
}

void sortById(std::vector<TagObservation>* tags) {
  std::sort(tags->begin(), tags->end(), [](const TagObservation& a, const TagObservation& b) {
    const auto key = [](const TagObservation& tag) {
      return std::make_tuple(tag.id, tag.corners_px[0].x(), tag.corners_px[0].y());
    };
    return key(a) < key(b);
  });
}

}  // namespace brick_detection
