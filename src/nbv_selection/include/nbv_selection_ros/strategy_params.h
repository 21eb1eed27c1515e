// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "nbv_selection/gpis_scene.h"
#include "nbv_selection/octomap_scene.h"
#include "nbv_selection/view_selector.h"

namespace nbv_selection_ros {

/// Parameters that all strategies have.
struct StrategyParams {
  std::string plugin;                  // class, for the node that loads it
  std::string removed_factor{"none"};  // the ablation of Table I: see UtilityConfig::without()
  std::string approach{"sector"};      // or from_arm_base: see ApproachWeight
  nbv_selection::ViewSelectorConfig selector;

  /// Every problem as "key = value unit, must be ...".
  std::vector<std::string> validate() const;
  /// The selector's with what the texts above change; validate() is empty.
  nbv_selection::ViewSelectorConfig effective() const;
};

struct GpisStrategyParams : StrategyParams {
  nbv_selection::GpisScene::Config scene;
  std::vector<std::string> validate() const;
};

struct OctomapStrategyParams : StrategyParams {
  OctomapStrategyParams() { selector = nbv_selection::octomapSelectorConfig(); }
  nbv_selection::OctomapScene::Config scene;
  std::vector<std::string> validate() const;
};

/// In the layout of config/nbv_selection.yaml, a strategy's section.
std::string toYaml(const GpisStrategyParams& params);
std::string toYaml(const OctomapStrategyParams& params);

/// Reads `private_nh`. Throws one std::invalid_argument that lists every unknown key, wrong type and impossible value.
GpisStrategyParams loadGpisStrategyParams(const ros::NodeHandle& private_nh);
OctomapStrategyParams loadOctomapStrategyParams(const ros::NodeHandle& private_nh);

}  // namespace nbv_selection_ros
