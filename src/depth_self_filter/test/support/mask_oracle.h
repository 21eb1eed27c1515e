// SPDX-License-Identifier: BSD-3-Clause
// The mask by brute force, sharing nothing with the one under test but the rules: distance functions in double precision,
// walked along the ray of every pixel to every shape; windows and shadows by looking at every pixel of them.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "depth_self_filter/robot_mask.h"

namespace depth_self_filter {
namespace test {

namespace description = mp700_ur5e_description;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// From the surface, negative inside; p in the shape's frame. Exact, by the theorem of Pythagoras on the nearest feature.
inline double signedDistance(const description::Shape& shape, const Eigen::Vector3d& p) {
  if (const auto* box = std::get_if<description::Box>(&shape)) {
    const Eigen::Vector3d q = p.cwiseAbs() - 0.5 * box->size_m;
    return q.cwiseMax(0.0).norm() + std::min(0.0, q.maxCoeff());
  }
  if (const auto* cylinder = std::get_if<description::Cylinder>(&shape)) {
    const Eigen::Vector2d q(std::hypot(p.x(), p.y()) - cylinder->radius_m, std::abs(p.z()) - 0.5 * cylinder->length_m);
    return q.cwiseMax(0.0).norm() + std::min(0.0, q.maxCoeff());
  }
  return p.norm() - std::get<description::Sphere>(shape).radius_m;
}

inline description::Shape grown(const description::Shape& shape, double by_m) {
  if (const auto* box = std::get_if<description::Box>(&shape)) {
    return description::Box{(box->size_m.array() + 2.0 * by_m).matrix()};
  }
  if (const auto* cylinder = std::get_if<description::Cylinder>(&shape)) {
    return description::Cylinder{cylinder->radius_m + by_m, cylinder->length_m + 2.0 * by_m};
  }
  return description::Sphere{std::get<description::Sphere>(shape).radius_m + by_m};
}

inline double farthestPoint(const description::Shape& shape) {
  if (const auto* box = std::get_if<description::Box>(&shape)) return (0.5 * box->size_m).norm();
  if (const auto* cylinder = std::get_if<description::Cylinder>(&shape)) {
    return std::sqrt(cylinder->radius_m * cylinder->radius_m + 0.25 * cylinder->length_m * cylinder->length_m);
  }
  return std::get<description::Sphere>(shape).radius_m;
}

struct OracleShape {
  description::Shape shape;
  Eigen::Isometry3d T_shape_camera;
};

/// The padded shapes by the rules that the header tells, grown by `more_m`.
inline std::vector<OracleShape> oracleShapes(const RobotMask& mask, const Eigen::Isometry3d& T_root_camera,
                                             const Eigen::VectorXd& positions_rad,
                                             const std::optional<HeldBrick>& brick, double more_m) {
  std::vector<OracleShape> shapes;
  const RobotMaskConfig& config = mask.config();
  const auto add = [&](const description::Shape& shape, const Eigen::Isometry3d& T_root_shape, double base_m) {
    const Eigen::Isometry3d T_shape_camera = T_root_shape.inverse() * T_root_camera;
    const double gap_m = signedDistance(shape, T_shape_camera.translation());
    if (gap_m <= 0.0) return;
    const double padding_m = base_m + config.padding_rad * (T_shape_camera.translation().norm() + farthestPoint(shape));
    shapes.push_back({grown(shape, std::min(padding_m, 0.5 * gap_m) + more_m), T_shape_camera});
  };
  std::vector<Eigen::Isometry3d> T_root_body;
  mask.robot().bodyPoses(positions_rad, &T_root_body);
  for (const description::BodyShape& shape : mask.robot().shapes()) {
    add(shape.shape, T_root_body[shape.body] * shape.T_body_shape, config.padding_m);
  }
  if (brick) {
    add(description::Box{brick->size_m}, mask.robot().framePose(brick->frame, positions_rad) * brick->T_frame_brick,
        config.brick_padding_m);
  }
  return shapes;
}

/// Depth at which the ray of a pixel enters the shape, from the least depth on; +Inf if it does not. Rays that graze take
/// steps without end: they are given up, and are hits if the shapes were grown.
inline double walk(const OracleShape& shape, const Eigen::Vector3d& direction, bool grazing_hits) {
  constexpr double kFarthest_m = 30.0;
  const double length = direction.norm();
  double z = kNear_m;
  for (int step = 0; step < 300; ++step) {
    const double distance = signedDistance(shape.shape, shape.T_shape_camera * (z * direction));
    if (distance < 1e-9) return z;
    z += distance / length;
    if (z > kFarthest_m) return kInfinity;
  }
  return grazing_hits ? z : kInfinity;
}

/// What is left of `image`, with all shapes grown by `more_m` (or shrunk). Growing can only take out more.
inline depth_camera::DepthImage oracleMask(const RobotMask& mask, const depth_camera::CameraModel& camera,
                                           const Eigen::Isometry3d& T_root_camera, const Eigen::VectorXd& positions_rad,
                                           const std::optional<HeldBrick>& brick, const depth_camera::DepthImage& image,
                                           double more_m) {
  const RobotMaskConfig& config = mask.config();
  const std::vector<OracleShape> shapes = oracleShapes(mask, T_root_camera, positions_rad, brick, more_m);
  const auto at = [&camera](const auto& values, int u, int v) {
    return values[static_cast<std::size_t>(v) * static_cast<std::size_t>(camera.width) + static_cast<std::size_t>(u)];
  };
  std::vector<double> entry;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const Eigen::Vector3d direction((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
      double nearest = kInfinity;
      for (const OracleShape& shape : shapes) nearest = std::min(nearest, walk(shape, direction, more_m > 0.0));
      entry.push_back(nearest);
    }
  }
  std::vector<double> spread;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      double nearest = kInfinity;
      for (int y = std::max(0, v - config.edge_px); y <= std::min(camera.height - 1, v + config.edge_px); ++y) {
        for (int x = std::max(0, u - config.edge_px); x <= std::min(camera.width - 1, u + config.edge_px); ++x) {
          nearest = std::min(nearest, at(entry, x, y));
        }
      }
      spread.push_back(nearest);
    }
  }
  depth_camera::DepthImage left = image;
  std::vector<bool> is_masked(left.depth_m.size(), false);
  for (std::size_t i = 0; i < left.depth_m.size(); ++i) {
    if (spread[i] == kInfinity) continue;
    const double z = image.depth_m[i];
    const double tolerance_m = config.noise_sigmas * config.noise.sigma(spread[i]);
    const bool is_before = z > 0.0 && z < spread[i] - tolerance_m;
    if (is_before) continue;
    is_masked[i] = true;
    left.depth_m[i] = std::numeric_limits<float>::quiet_NaN();
  }
  if (config.baseline_m <= 0.0) return left;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      if (at(image.depth_m, u, v) != 0.0F || at(is_masked, u, v) || at(spread, u, v) < kInfinity) continue;
      for (int x = 0; x < camera.width; ++x) {
        const bool is_robot =
            at(spread, x, v) < kInfinity && (at(is_masked, x, v) || std::isnan(at(image.depth_m, x, v)));
        if (is_robot && std::abs(x - u) <= camera.fx * config.baseline_m / at(spread, x, v) + 2.0) {
          left.depth_m[static_cast<std::size_t>(v) * static_cast<std::size_t>(camera.width) +
                       static_cast<std::size_t>(u)] = std::numeric_limits<float>::quiet_NaN();
          break;
        }
      }
    }
  }
  return left;
}

}  // namespace test
}  // namespace depth_self_filter
