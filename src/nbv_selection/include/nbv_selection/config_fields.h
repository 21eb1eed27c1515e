// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "nbv_selection/gpis_scene.h"
#include "nbv_selection/octomap_scene.h"
#include "nbv_selection/view_selector.h"

/// The tables of all keys, for whoever reads or writes configurations: visit(key, value) for each. Of the ground only what
/// the estimate of its plane needs.
namespace nbv_selection {

template <typename Config, typename Visitor>
void visitUtilityFields(Config& config, Visitor&& visit) {
  for (std::size_t i = 0; i < kNumFactors; ++i) {
    visit(std::string("weights/") + toString(static_cast<Factor>(i)), config.factors[i].weight);
  }
  for (std::size_t i = 0; i < kNumFactors; ++i) {
    const std::string key = std::string("logistic/") + toString(static_cast<Factor>(i));
    visit(key + "/l", config.factors[i].logistic.l);
    visit(key + "/a", config.factors[i].logistic.a);
    visit(key + "/b", config.factors[i].logistic.b);
  }
  visit("gamma_per_s", config.gamma_per_s);
  visit("min_utility", config.min_utility);
}

template <typename Config, typename Visitor>
void visitSelectorFields(Config& config, Visitor&& visit) {
  visit("ground/max_tilt_rad", config.ground.max_tilt_rad);
  visit("ground/plane_tolerance_m", config.ground.plane_tolerance_m);
  visit("outline/cell_size_m", config.outline.cell_size_m);
  visit("outline/min_height_m", config.outline.min_height_m);
  visit("outline/max_height_m", config.outline.max_height_m);
  visit("outline/closing_m", config.outline.closing_m);
  visit("outline/min_area_m2", config.outline.min_area_m2);
  visit("outline/tolerance_m", config.outline.tolerance_m);
  visit("segments/spacing_m", config.segments.spacing_m);
  visit("segments/standoff_m", config.segments.standoff_m);
  visit("segments/sample_spacing_m", config.segments.sample_spacing_m);
  visit("segments/profile_depth_m", config.segments.profile_depth_m);
  visit("manipulability/cell_m", config.manipulability.cell_m);
  visit("manipulability/band_m", config.manipulability.band_m);
  visit("imaginary_share", config.imaginary_share);
  visit("standing_padding_m", config.standing_padding_m);
  visit("max_lost_share", config.max_lost_share);
  visitUtilityFields(config.utility, visit);
}

template <typename Config, typename Visitor>
void visitGpisFields(Config& config, Visitor&& visit) {
  visit("occupancy/alpha_1_m", config.alpha_1_m);
  visit("occupancy/beta", config.beta);
  visit("occupancy/support_m", config.support_m);
}

template <typename Config, typename Visitor>
void visitOctomapFields(Config& config, Visitor&& visit) {
  visit("octomap/gradient_step_m", config.gradient_step_m);
  visit("octomap/surface_band_m", config.surface_band_m);
}

}  // namespace nbv_selection
