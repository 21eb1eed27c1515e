// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/tag_detector.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>

#include <mp700_ur5e_description/brick_types.h>

#include "apriltag_detector.h"
#include "aruco_detector.h"
#include "detector_support.h"

namespace brick_detection {
namespace {

/// Empty: tags of this family can be decoded.
std::string familyProblem(const std::string& family) {
  if (family == "ALVAR_5X5") {
    return "family = ALVAR_5X5, must be one that is decoded here. The tags of ar_track_alvar are decoded by its own "
           "node. Its messages come in by the alvar input";
  }
  if (isAprilTagFamily(family) || isArucoFamily(family)) return "";
  std::string names;
  for (const std::string& name : mp700_ur5e_description::TagLayout::families()) {
    if (isAprilTagFamily(name) || isArucoFamily(name)) names += (names.empty() ? "" : ", ") + name;
  }
  return "family = " + family + ", must be one of: " + names;
}

}  // namespace

double TagObservation::shortestSide() const {
  double shortest_px = (corners_px[0] - corners_px[3]).norm();
  for (std::size_t i = 0; i < 3; ++i) shortest_px = std::min(shortest_px, (corners_px[i + 1] - corners_px[i]).norm());
  return shortest_px;
}

std::unique_ptr<TagDetector> makeTagDetector(const TagDetectorConfig& config) {
  std::vector<std::string> problems = interactive_mapping::problemsOf(config);
  const std::string family_problem = familyProblem(config.family);
  if (!family_problem.empty()) problems.push_back(family_problem);
  interactive_mapping::refuseIfAny("impossible tag detector:", problems);
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
