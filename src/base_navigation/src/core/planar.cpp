// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/planar.h"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string>

namespace base_navigation {
namespace {

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

void requireConvex(const Polygon& polygon) {
  const std::size_t n = polygon.size();
  if (n < 3) throw std::invalid_argument("polygon has " + std::to_string(n) + " corners, must be at least 3");
  double area_m2 = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    const Eigen::Vector2d& a = polygon[i];
    const Eigen::Vector2d& b = polygon[(i + 1) % n];
    const Eigen::Vector2d& c = polygon[(i + 2) % n];
    if (!a.allFinite()) throw std::invalid_argument("corner " + std::to_string(i) + " of the polygon is not finite");
    if (!(cross(b - a, c - b) > 0.0)) {
      throw std::invalid_argument("polygon must be convex and counter-clockwise, is not at corner " +
                                  std::to_string((i + 1) % n));
    }
    area_m2 += 0.5 * cross(a, b);
  }
  // All corners turn left, and still it may go round twice: then the turns add up to more than one.
  double turned_rad = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    const Eigen::Vector2d u = polygon[(i + 1) % n] - polygon[i];
    const Eigen::Vector2d v = polygon[(i + 2) % n] - polygon[(i + 1) % n];
    turned_rad += std::atan2(cross(u, v), u.dot(v));
  }
  if (turned_rad > 3.0 * M_PI || !(area_m2 > 0.0)) throw std::invalid_argument("polygon crosses itself");
}

}  // namespace

Eigen::Vector2d transform(const Pose2d& pose, const Eigen::Vector2d& point) {
  const double c = std::cos(pose.yaw_rad);
  const double s = std::sin(pose.yaw_rad);
  return {pose.x_m + c * point.x() - s * point.y(), pose.y_m + s * point.x() + c * point.y()};
}

Pose2d compose(const Pose2d& a, const Pose2d& b) {
  const Eigen::Vector2d p = transform(a, b.position());
  return {p.x(), p.y(), wrapAngle(a.yaw_rad + b.yaw_rad)};
}

Pose2d inverse(const Pose2d& pose) {
  const Eigen::Vector2d p = transform({0.0, 0.0, -pose.yaw_rad}, -pose.position());
  return {p.x(), p.y(), wrapAngle(-pose.yaw_rad)};
}

Pose2d moveAlongArc(const Pose2d& pose, double length_m, double turn_rad) {
  const double half_rad = 0.5 * turn_rad;
  // The chord of an arc; sin(x) / x by its series where the quotient loses digits.
  const double chord_m =
      length_m * (std::abs(half_rad) < 1e-4 ? 1.0 - half_rad * half_rad / 6.0 : std::sin(half_rad) / half_rad);
  return {pose.x_m + chord_m * std::cos(pose.yaw_rad + half_rad),
          pose.y_m + chord_m * std::sin(pose.yaw_rad + half_rad), wrapAngle(pose.yaw_rad + turn_rad)};
}

Polygon padPolygon(const Polygon& polygon, double padding_m) {
  requireConvex(polygon);
  if (!(padding_m >= 0.0) || !std::isfinite(padding_m)) {
    throw std::invalid_argument("padding = " + std::to_string(padding_m) + " m, must be finite and at least 0");
  }
  const std::size_t n = polygon.size();
  Polygon padded;
  for (std::size_t i = 0; i < n; ++i) {
    const Eigen::Vector2d u = (polygon[i] - polygon[(i + n - 1) % n]).normalized();
    const Eigen::Vector2d v = (polygon[(i + 1) % n] - polygon[i]).normalized();
    // The corner of the two edges moved out by d along their normals: p + d (n_u + n_v) / (1 + n_u . n_v).
    const Eigen::Vector2d normals(u.y() + v.y(), -u.x() - v.x());
    padded.push_back(polygon[i] + padding_m * normals / (1.0 + u.dot(v)));
  }
  return padded;
}

double inscribedRadius(const Polygon& polygon) {
  requireConvex(polygon);
  double radius_m = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d& a = polygon[i];
    const Eigen::Vector2d edge = (polygon[(i + 1) % polygon.size()] - a).normalized();
    radius_m = std::min(radius_m, cross(a, edge));
  }
  if (!(radius_m > 0.0)) throw std::invalid_argument("the polygon does not hold the origin");
  return radius_m;
}

double circumscribedRadius(const Polygon& polygon) {
  double radius_m = 0.0;
  for (const Eigen::Vector2d& corner : polygon) radius_m = std::max(radius_m, corner.norm());
  return radius_m;
}

}  // namespace base_navigation
