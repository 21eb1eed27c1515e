// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "nbv_selection/outline.h"

namespace nbv_selection {

/// Positive if counter-clockwise.
inline double areaOf(const OutlinePolygon& polygon) {
  double area_m2 = 0.0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d& a = polygon[i];
    const Eigen::Vector2d& b = polygon[(i + 1) % polygon.size()];
    area_m2 += 0.5 * (a.x() * b.y() - a.y() * b.x());
  }
  return area_m2;
}

inline double perimeterOf(const OutlinePolygon& polygon) {
  double length_m = 0.0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    length_m += (polygon[(i + 1) % polygon.size()] - polygon[i]).norm();
  }
  return length_m;
}

/// How often it goes round the point, by the angles under which its edges are seen from there.
inline int turnsAround(const OutlinePolygon& polygon, const Eigen::Vector2d& p) {
  double turned_rad = 0.0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d a = polygon[i] - p;
    const Eigen::Vector2d b = polygon[(i + 1) % polygon.size()] - p;
    turned_rad += std::atan2(a.x() * b.y() - a.y() * b.x(), a.dot(b));
  }
  return static_cast<int>(std::lround(turned_rad / (2.0 * M_PI)));
}

inline double distanceToOutline(const OutlinePolygon& polygon, const Eigen::Vector2d& p) {
  double nearest_m = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d& a = polygon[i];
    const Eigen::Vector2d step = polygon[(i + 1) % polygon.size()] - a;
    const double along = std::clamp(step.dot(p - a) / step.squaredNorm(), 0.0, 1.0);
    nearest_m = std::min(nearest_m, (a + along * step - p).norm());
  }
  return nearest_m;
}

}  // namespace nbv_selection
