// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <Eigen/Core>
#include <interactive_mapping_common/formatted.h>

/// Numbers as messages show them.
namespace base_navigation {

inline std::string text(double value, int digits = 2) {
  return interactive_mapping::formatted("%.*f", digits, value);
}

inline std::string text(const Eigen::Vector2d& p_map) {
  return "(" + text(p_map.x()) + ", " + text(p_map.y()) + ")";
}

}  // namespace base_navigation
