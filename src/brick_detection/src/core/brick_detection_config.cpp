// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/brick_detection_config.h"

namespace brick_detection {

std::vector<std::string> BrickDetectionConfig::validate() const {
  std::vector<std::string> problems;
  const auto append = [&problems](const char* section, const std::vector<std::string>& more) {
    for (const std::string& problem : more) problems.push_back(std::string(section) + "/" + problem);
  };
  append("detector", detector.validate());
  append("pose", pose.validate());
  append("alvar", alvar.validate());
  append("tracker", tracker.validate());
  append("access", access.validate());
  return problems;
}

}  // namespace brick_detection
