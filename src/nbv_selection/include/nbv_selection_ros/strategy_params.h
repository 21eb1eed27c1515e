// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <stdexcept>
#include <string>

#include <interactive_mapping_common/config/schema.h>

#include "nbv_selection/gpis_scene.h"
#include "nbv_selection/octomap_scene.h"
#include "nbv_selection/view_selector.h"

namespace nbv_selection_ros {

/// Parameters that all strategies have that leave the choice to a ViewSelector, in their section; to be read by
/// interactive_mapping_ros::loadParams(). A strategy of another package may derive its own from them.
struct StrategyParams {
  std::string plugin;
  std::string removed_factor{"none"};  // see UtilityConfig::without()
  nbv_selection::ViewSelectorConfig selector;

  static void fields(StrategyParams& c, interactive_mapping::Fields& f) {
    f("plugin", c.plugin, "class of the strategy, for pluginlib");
    f("removed_factor", c.removed_factor,
      "for ablations: none, manipulability, pick_order, travel, uncertainty or frontier, whose weight the others "
      "share, or failure_penalty");
    nbv_selection::ViewSelectorConfig::fields(c.selector, f);
    const std::string problem = c.removalProblem();
    f.require(problem.empty(), "removed_factor = '" + c.removed_factor + "': " + problem);
  }

  /// The selector's with what removed_factor changes. Throws std::invalid_argument if it cannot be removed.
  nbv_selection::ViewSelectorConfig effective() const {
    nbv_selection::ViewSelectorConfig config = selector;
    config.utility = selector.utility.without(removed_factor);
    return config;
  }

 private:
  std::string removalProblem() const {
    try {
      // An impossible utility is reported by itself; whether there is such a factor is checked all the same.
      const bool is_possible = interactive_mapping::problemsOf(selector.utility).empty();
      (is_possible ? selector.utility : nbv_selection::UtilityConfig()).without(removed_factor);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  }
};

struct GpisStrategyParams : StrategyParams {
  nbv_selection::GpisScene::Config scene;

  static void fields(GpisStrategyParams& c, interactive_mapping::Fields& f) {
    StrategyParams::fields(c, f);
    f.section("occupancy", c.scene);
  }
};

struct OctomapStrategyParams : StrategyParams {
  OctomapStrategyParams() { selector = nbv_selection::octomapSelectorConfig(); }
  nbv_selection::OctomapScene::Config scene;

  static void fields(OctomapStrategyParams& c, interactive_mapping::Fields& f) {
    StrategyParams::fields(c, f);
    f.section("octomap", c.scene);
  }
};

}  // namespace nbv_selection_ros
