// SPDX-License-Identifier: BSD-3-Clause
#include "octomap_baseline/octomap_config.h"

namespace octomap_baseline {

std::vector<std::string> OctomapConfig::validate() const {
  return interactive_mapping::problemsOf(*this);
}

void requireValid(const OctomapConfig& config) {
  interactive_mapping::requireValid("impossible OctoMap configuration:", config);
}

OctomapConfig parseOctomapConfig(const std::string& yaml_text, const std::string& origin) {
  return interactive_mapping::parse<OctomapConfig>(yaml_text, origin);
}

std::string toYaml(const OctomapConfig& config) {
  return interactive_mapping::toYaml(config);
}

}  // namespace octomap_baseline
