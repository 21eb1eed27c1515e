// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection_ros/strategy_params.h"

#include <stdexcept>

#include <interactive_mapping_common_ros/params.h>

#include "nbv_selection/config_fields.h"

namespace nbv_selection_ros {
namespace {

constexpr auto kVisitStrategy = [](auto& params, auto&& visit) {
  visit("plugin", params.plugin);
  visit("removed_factor", params.removed_factor);
  visit("manipulability/approach", params.approach);
  nbv_selection::visitSelectorFields(params.selector, visit);
};

constexpr auto kVisitGpis = [](auto& params, auto&& visit) {
  kVisitStrategy(params, visit);
  nbv_selection::visitGpisFields(params.scene, visit);
};

constexpr auto kVisitOctomap = [](auto& params, auto&& visit) {
  kVisitStrategy(params, visit);
  nbv_selection::visitOctomapFields(params.scene, visit);
};

void append(const std::string& section, const std::vector<std::string>& more, std::vector<std::string>* problems) {
  for (const std::string& problem : more) problems->push_back(section + problem);
}

}  // namespace

std::vector<std::string> StrategyParams::validate() const {
  std::vector<std::string> problems = selector.validate();
  if (approach != "sector" && approach != "from_arm_base") {
    problems.push_back("manipulability/approach = '" + approach + "', must be sector or from_arm_base");
  }
  // An impossible utility is reported above; whether there is such a factor can be told all the same.
  const bool is_utility_possible = selector.utility.validate().empty();
  try {
    (is_utility_possible ? selector.utility : nbv_selection::UtilityConfig()).without(removed_factor);
  } catch (const std::invalid_argument& error) {
    problems.push_back("removed_factor = '" + removed_factor + "': " + error.what());
  }
  return problems;
}

nbv_selection::ViewSelectorConfig StrategyParams::effective() const {
  nbv_selection::ViewSelectorConfig config = selector;
  config.utility = selector.utility.without(removed_factor);
  config.manipulability.weight = approach == "from_arm_base" ? nbv_selection::ApproachWeight::kFromArmBase
                                                             : nbv_selection::ApproachWeight::kSector;
  return config;
}

std::vector<std::string> GpisStrategyParams::validate() const {
  std::vector<std::string> problems = StrategyParams::validate();
  append("occupancy/", scene.validate(), &problems);
  return problems;
}

std::vector<std::string> OctomapStrategyParams::validate() const {
  std::vector<std::string> problems = StrategyParams::validate();
  append("octomap/", scene.validate(), &problems);
  return problems;
}

std::string toYaml(const GpisStrategyParams& params) {
  return interactive_mapping_ros::paramsToYaml(params, kVisitGpis);
}

std::string toYaml(const OctomapStrategyParams& params) {
  return interactive_mapping_ros::paramsToYaml(params, kVisitOctomap);
}

GpisStrategyParams loadGpisStrategyParams(const ros::NodeHandle& private_nh) {
  return interactive_mapping_ros::loadParams<GpisStrategyParams>(private_nh, kVisitGpis);
}

OctomapStrategyParams loadOctomapStrategyParams(const ros::NodeHandle& private_nh) {
  return interactive_mapping_ros::loadParams<OctomapStrategyParams>(private_nh, kVisitOctomap);
}

}  // namespace nbv_selection_ros
