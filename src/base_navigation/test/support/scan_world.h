// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <limits>
#include <random>
#include <utility>
#include <vector>

#include <Eigen/Geometry>

#include "base_navigation/grid_fusion.h"

namespace base_navigation {

/// Walls and posts in the map frame, looked at by an exact scanner: +-95 degrees of 0.5, upside down, in front of the robot.
struct ScanWorld {
  struct Wall {
    Eigen::Vector2d from, to;
  };
  struct Post {
    Eigen::Vector2d middle;
    double radius_m;
  };
  std::vector<Wall> walls;
  std::vector<Post> posts;

  /// Distance along a ray; infinite: nothing there.
  double range(const Eigen::Vector2d& eye, const Eigen::Vector2d& direction) const {
    double nearest = std::numeric_limits<double>::infinity();
    for (const Wall& wall : walls) {
      Eigen::Matrix2d lines;
      lines << direction, wall.from - wall.to;
      if (std::abs(lines.determinant()) < 1e-12) continue;
      const Eigen::Vector2d at = lines.inverse() * (wall.from - eye);
      if (at.x() > 0.0 && at.y() >= 0.0 && at.y() <= 1.0) nearest = std::min(nearest, at.x());
    }
    for (const Post& post : posts) {
      const Eigen::Vector2d to = post.middle - eye;
      const double along = to.dot(direction);
      const double depth2 = post.radius_m * post.radius_m - (to - along * direction).squaredNorm();
      if (depth2 >= 0.0 && along > 0.0) nearest = std::min(nearest, along - std::sqrt(depth2));
    }
    return nearest;
  }

  /// `sigma_m`: of the ranges; beyond the scanner's range it tells 30 m.
  Scan look(const Pose2d& T_map_base, double sigma_m = 0.0, std::mt19937* engine = nullptr) const {
    Scan scan;
    scan.T_base_scanner = {0.244, 0.0, 0.0};
    scan.is_mirrored = true;
    scan.increment_rad = M_PI / 360.0;
    scan.min_angle_rad = -190.0 * scan.increment_rad;
    scan.range_min_m = 0.01;
    scan.range_max_m = 29.0;
    std::normal_distribution<double> noise(0.0, 1.0);
    const Pose2d T_map_scanner = compose(T_map_base, scan.T_base_scanner);
    for (int i = 0; i < 381; ++i) {
      const double bearing = T_map_scanner.yaw_rad - (scan.min_angle_rad + i * scan.increment_rad);  // clockwise
      double range_m = range(T_map_scanner.position(), {std::cos(bearing), std::sin(bearing)});
      if (engine != nullptr) range_m += sigma_m * noise(*engine);
      scan.ranges_m.push_back(static_cast<float>(range_m > scan.range_max_m ? 30.0 : range_m));
    }
    return scan;
  }
};

}  // namespace base_navigation
