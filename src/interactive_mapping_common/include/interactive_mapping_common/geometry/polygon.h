// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include <Eigen/Core>

/// Polygons in the plane: corners in either turning sense, convex or not, the last joined to the first.
namespace interactive_mapping {

/// Why the corners make no polygon without holes, for the user ("has 2 corners, must have at least 3"). Empty: they do.
inline std::string problemOfPolygon(const std::vector<Eigen::Vector2d>& corners) {
  const std::size_t count = corners.size();
  if (count < 3) return "has " + std::to_string(count) + " corners, must have at least 3";
  for (std::size_t i = 0; i < count; ++i) {
    if (!corners[i].allFinite()) return "has a corner " + std::to_string(i) + " that is not finite, must be finite";
  }
  const auto corner = [&](std::size_t i) { return corners[i % count]; };
  /// Which side of the line a b is p on: -1, 0 or 1.
  const auto sideOf = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& p) {
    const Eigen::Vector2d along = b - a, to_p = p - a;
    const double cross = along.x() * to_p.y() - along.y() * to_p.x();
    return (cross > 0.0) - (cross < 0.0);
  };
  /// Of a point on the line a b.
  const auto isBetween = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& p) {
    return (p - a).dot(p - b) <= 0.0;
  };
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector2d a = corner(i), b = corner(i + 1);
    const Eigen::Vector2d next = corner(i + 2);
    if (a == b || (sideOf(a, b, next) == 0 && (a - b).dot(next - b) > 0.0)) {
      return "turns back at corner " + std::to_string((i + 1) % count) + ", must have an area";
    }
  }
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector2d a = corner(i), b = corner(i + 1);
    for (std::size_t k = i + 2; k < count && k + 1 < count + i; ++k) {
      const Eigen::Vector2d c = corner(k), d = corner(k + 1);
      const int of_c = sideOf(a, b, c), of_d = sideOf(a, b, d), of_a = sideOf(c, d, a), of_b = sideOf(c, d, b);
      const bool touches = (of_c == 0 && isBetween(a, b, c)) || (of_d == 0 && isBetween(a, b, d)) ||
                           (of_a == 0 && isBetween(c, d, a)) || (of_b == 0 && isBetween(c, d, b));
      if (touches || (of_c * of_d < 0 && of_a * of_b < 0)) {
        return "crosses itself: its edges from corners " + std::to_string(i) + " and " + std::to_string(k) + " meet";
      }
    }
  }
  return "";
}

/// Even-odd rule.
inline bool isInside(const std::vector<Eigen::Vector2d>& corners, const Eigen::Vector2d& p) {
  bool is_inside = false;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Eigen::Vector2d &a = corners[i], &b = corners[(i + 1) % corners.size()];
    if ((a.y() > p.y()) == (b.y() > p.y())) continue;
    if (p.x() < a.x() + (p.y() - a.y()) / (b.y() - a.y()) * (b.x() - a.x())) is_inside = !is_inside;
  }
  return is_inside;
}

}  // namespace interactive_mapping
