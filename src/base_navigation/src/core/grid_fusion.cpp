// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/grid_fusion.h"

#include <cmath>

namespace base_navigation {

Eigen::Vector2d Scan::direction(std::size_t beam) const {
  const double angle_rad = min_angle_rad + static_cast<double>(beam) * increment_rad;
  const double bearing_rad = T_base_scanner.yaw_rad + (is_mirrored ? -angle_rad : angle_rad);
  return {std::cos(bearing_rad), std::sin(bearing_rad)};
}

bool Scan::isEcho(std::size_t beam) const {
  return ranges_m[beam] >= range_min_m && ranges_m[beam] <= range_max_m;  // false for NaN
}

bool Scan::isEmpty(std::size_t beam) const {
  return ranges_m[beam] > range_max_m;
}

Eigen::Vector2d Scan::echo(std::size_t beam) const {
  return T_base_scanner.position() + ranges_m[beam] * direction(beam);
}

}  // namespace base_navigation
