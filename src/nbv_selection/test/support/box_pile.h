// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include <Eigen/Geometry>
#include <gpis_mapping/ground_projection.h>

#include "nbv_selection/scene_model.h"

namespace nbv_selection {

/// A plane tilted by `tilt_rad` whose uphill direction from above is `uphill_rad`, through (0, 0, z_m).
inline gpis_mapping::GroundPlane tiltedGround(double tilt_rad, double uphill_rad = 0.0, double z_m = 0.0) {
  gpis_mapping::GroundPlane ground;
  ground.normal_map = {-std::sin(tilt_rad) * std::cos(uphill_rad), -std::sin(tilt_rad) * std::sin(uphill_rad),
                       std::cos(tilt_rad)};
  ground.offset_m = ground.normal_map.z() * z_m;
  ground.num_points = 1000;
  return ground;
}

struct Box {
  Eigen::Isometry3d T_map_box{Eigen::Isometry3d::Identity()};  // box frame: its middle
  Eigen::Vector3d size_m{Eigen::Vector3d::Ones()};
};

/// Boxes on the ground. What is below the ground plane, or inside of a box, is full; the rest is free.
struct BoxPile {
  gpis_mapping::GroundPlane ground;
  std::vector<Box> boxes;

  /// Adds a box whose bottom is `lift_m` above the ground, flat on it, its middle above (x, y).
  void add(const Eigen::Vector2d& middle_map, const Eigen::Vector3d& size_m, double yaw_rad = 0.0,
           double lift_m = 0.0) {
    const Eigen::Vector3d& up = ground.normal_map;
    const Eigen::Vector3d heading(std::cos(yaw_rad), std::sin(yaw_rad), 0.0);
    Box box;
    box.size_m = size_m;
    box.T_map_box.linear().col(2) = up;
    box.T_map_box.linear().col(1) = up.cross(heading).normalized();
    box.T_map_box.linear().col(0) = box.T_map_box.linear().col(1).cross(up);
    const Eigen::Vector3d foot(middle_map.x(), middle_map.y(), ground.zAt(middle_map.x(), middle_map.y()));
    box.T_map_box.translation() = foot + (lift_m + 0.5 * size_m.z()) * up;
    boxes.push_back(box);
  }
};

inline bool isInside(const Box& box, const Eigen::Vector3d& p_map) {
  return (2.0 * (box.T_map_box.inverse() * p_map).cwiseAbs().array() < box.size_m.array()).all();
}

inline bool isFull(const BoxPile& pile, const Eigen::Vector3d& p_map) {
  return pile.ground.heightOf(p_map) < 0.0 ||
         std::any_of(pile.boxes.begin(), pile.boxes.end(), [&](const Box& box) { return isInside(box, p_map); });
}

/// Whether the line between two points goes through the inside of the box: it does where it is between all three pairs
/// of its faces at once.
inline bool isHidden(const Box& box, const Eigen::Vector3d& from_map, const Eigen::Vector3d& to_map) {
  const Eigen::Vector3d from = box.T_map_box.inverse() * from_map;
  const Eigen::Vector3d step = box.T_map_box.inverse().linear() * (to_map - from_map);
  double enter = 0.0;
  double leave = 1.0;
  for (int axis = 0; axis < 3; ++axis) {
    const double half_m = 0.5 * box.size_m(axis);
    if (step(axis) == 0.0) {
      if (std::abs(from(axis)) >= half_m) return false;
      continue;
    }
    const double a = (-half_m - from(axis)) / step(axis);
    const double b = (half_m - from(axis)) / step(axis);
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter < leave;
}

/// Whether an eye sees a point of the pile's or the ground's surface: it is on the side the surface looks to, and no
/// box is between.
inline bool isSeenFrom(const BoxPile& pile, const Eigen::Vector3d& eye_map, const Eigen::Vector3d& p_map,
                       const Eigen::Vector3d& normal_map) {
  if (normal_map.dot(eye_map - p_map) <= 0.0) return false;
  constexpr double kClear_m = 1e-6;  // off the point's own face; far more than rounding
  const Eigen::Vector3d from_map = p_map + kClear_m * normal_map;
  return std::none_of(pile.boxes.begin(), pile.boxes.end(),
                      [&](const Box& box) { return isHidden(box, from_map, eye_map); });
}

struct SamplingOptions {
  double spacing_m{0.02};       // at most, between neighbours on a face
  double ground_margin_m{0.5};  // ground is sampled so far around the boxes
  std::function<bool(const Eigen::Vector3d& p_map, const Eigen::Vector3d& normal_map)> is_seen;       // empty: all is
  std::function<float(const Eigen::Vector3d& p_map, const Eigen::Vector3d& normal_map)> uncertainty;  // empty: 1e-4
};

/// Seen by an eye at any of the points. Keeps a copy of the pile.
inline std::function<bool(const Eigen::Vector3d&, const Eigen::Vector3d&)> seenFrom(
    const BoxPile& pile, const std::vector<Eigen::Vector3d>& eyes_map) {
  return [pile, eyes_map](const Eigen::Vector3d& p_map, const Eigen::Vector3d& normal_map) {
    return std::any_of(eyes_map.begin(), eyes_map.end(),
                       [&](const Eigen::Vector3d& eye) { return isSeenFrom(pile, eye, p_map, normal_map); });
  };
}

/// The surface between full and free: the boxes' faces, edges included, then the ground around them. What touches the
/// ground or another box is no surface. The same pile gives the same samples, in the same order.
inline MappedSurface sampleSurface(const BoxPile& pile, const SamplingOptions& options = {}) {
  MappedSurface surface;
  surface.update = 1;
  const auto add = [&](const Eigen::Vector3d& p_map, const Eigen::Vector3d& normal_map) {
    constexpr double kFree_m = 1e-4;  // before the face: closer than that, two boxes touch
    if (isFull(pile, p_map + kFree_m * normal_map)) return;
    if (options.is_seen && !options.is_seen(p_map, normal_map)) return;
    surface.points_map.push_back(p_map);
    surface.normals_map.push_back(normal_map.cast<float>());
    surface.uncertainty.push_back(options.uncertainty ? options.uncertainty(p_map, normal_map) : 1e-4F);
  };
  const auto numSteps = [&](double length_m) {
    return std::max(1, static_cast<int>(std::ceil(length_m / options.spacing_m - 1e-9)));
  };
  for (const Box& box : pile.boxes) {
    for (int axis = 0; axis < 3; ++axis) {
      const int u = (axis + 1) % 3;
      const int v = (axis + 2) % 3;
      const int steps_u = numSteps(box.size_m(u));
      const int steps_v = numSteps(box.size_m(v));
      for (const double side : {-1.0, 1.0}) {
        const Eigen::Vector3d normal_map = side * box.T_map_box.linear().col(axis);
        for (int i = 0; i <= steps_u; ++i) {
          for (int j = 0; j <= steps_v; ++j) {
            Eigen::Vector3d p;
            p(axis) = 0.5 * side * box.size_m(axis);
            p(u) = (static_cast<double>(i) / steps_u - 0.5) * box.size_m(u);
            p(v) = (static_cast<double>(j) / steps_v - 0.5) * box.size_m(v);
            add(box.T_map_box * p, normal_map);
          }
        }
      }
    }
  }
  Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Vector2d high = -low;
  for (const Box& box : pile.boxes) {
    for (int corner = 0; corner < 8; ++corner) {
      const Eigen::Vector3d sign((corner & 1) - 0.5, ((corner >> 1) & 1) - 0.5, ((corner >> 2) & 1) - 0.5);
      const Eigen::Vector3d p_map = box.T_map_box * sign.cwiseProduct(box.size_m);
      low = low.cwiseMin(p_map.head<2>());
      high = high.cwiseMax(p_map.head<2>());
    }
  }
  if (pile.boxes.empty()) low = high = Eigen::Vector2d::Zero();
  low.array() -= options.ground_margin_m;
  high.array() += options.ground_margin_m;
  const int columns = numSteps(high.x() - low.x());
  const int rows = numSteps(high.y() - low.y());
  for (int row = 0; row <= rows; ++row) {
    for (int column = 0; column <= columns; ++column) {
      const double x_m = low.x() + (high.x() - low.x()) * column / columns;
      const double y_m = low.y() + (high.y() - low.y()) * row / rows;
      add({x_m, y_m, pile.ground.zAt(x_m, y_m)}, pile.ground.normal_map);
    }
  }
  return surface;
}

}  // namespace nbv_selection
