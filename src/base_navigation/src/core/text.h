// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <iomanip>
#include <sstream>
#include <string>

#include <Eigen/Core>

/// Numbers as messages show them.
namespace base_navigation {

inline std::string text(double value, int digits = 2) {
  std::ostringstream out;
  out << std::fixed << std::setprecision(digits) << value;
  return out.str();
}

inline std::string text(const Eigen::Vector2d& p_map) {
  return "(" + text(p_map.x()) + ", " + text(p_map.y()) + ")";
}

}  // namespace base_navigation
