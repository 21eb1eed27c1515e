// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <random>
#include <vector>

#include "base_navigation/base_path.h"
#include "base_navigation/grid_fusion.h"
#include "base_navigation/planar.h"

namespace base_navigation {

/// The MP-700's numbers of config/base_profile.yaml.
inline Polygon shippedFootprint() {
  return {{0.296, 0.296}, {-0.527, 0.296}, {-0.527, -0.296}, {0.296, -0.296}};
}
inline MotionLimits shippedLimits() {
  return {0.8, 0.1, 0.6, 0.2, 0.6, 1.0};
}

inline double crossProduct(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

inline Polygon moved(const Polygon& polygon, const Pose2d& pose) {
  Polygon result;
  for (const Eigen::Vector2d& corner : polygon) result.push_back(transform(pose, corner));
  return result;
}

inline Polygon box(double x_m, double y_m, double size_x_m, double size_y_m, double yaw_rad = 0.0) {
  const double x = 0.5 * size_x_m;
  const double y = 0.5 * size_y_m;
  return moved({{x, y}, {-x, y}, {-x, -y}, {x, -y}}, {x_m, y_m, yaw_rad});
}

inline bool isInside(const Polygon& convex, const Eigen::Vector2d& p) {
  for (std::size_t i = 0; i < convex.size(); ++i) {
    const Eigen::Vector2d& a = convex[i];
    if (crossProduct(convex[(i + 1) % convex.size()] - a, p - a) < 0.0) return false;
  }
  return true;
}

/// Separating axes of two convex polygons: the gap along the best of the edges' normals, negative when they overlap. The
/// distance between them if an edge is nearest, less than it if two corners are.
inline double gap(const Polygon& a, const Polygon& b) {
  double best_m = -std::numeric_limits<double>::infinity();
  for (int swap = 0; swap < 2; ++swap) {
    const Polygon& one = swap == 0 ? a : b;
    const Polygon& other = swap == 0 ? b : a;
    for (std::size_t i = 0; i < one.size(); ++i) {
      const Eigen::Vector2d edge = (one[(i + 1) % one.size()] - one[i]).normalized();
      double nearest_m = std::numeric_limits<double>::infinity();
      for (const Eigen::Vector2d& p : other) nearest_m = std::min(nearest_m, -crossProduct(edge, p - one[i]));
      best_m = std::max(best_m, nearest_m);
    }
  }
  return best_m;
}

/// Convex polygons that stand in the map.
using PolygonWorld = std::vector<Polygon>;

inline double gap(const PolygonWorld& world, const Polygon& polygon) {
  double smallest_m = std::numeric_limits<double>::infinity();
  for (const Polygon& one : world) smallest_m = std::min(smallest_m, gap(one, polygon));
  return smallest_m;
}

/// Part of a convex polygon with x >= `x_m`.
inline Polygon frontOf(const Polygon& polygon, double x_m) {
  Polygon result;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d& a = polygon[i];
    const Eigen::Vector2d& b = polygon[(i + 1) % polygon.size()];
    if (a.x() >= x_m) result.push_back(a);
    if ((a.x() >= x_m) != (b.x() >= x_m)) result.push_back(a + (x_m - a.x()) / (b.x() - a.x()) * (b - a));
  }
  return result;
}

/// The safety scanner of base_profile.yaml, upside down as on the robot; rays are cast exactly.
struct PlantScanner {
  double noise_m{0.0};
  int num_beams{381};

  Scan scan(const PolygonWorld& world, const Pose2d& T_map_base, std::mt19937_64* random) const {
    Scan result;
    result.T_base_scanner = {0.244, 0.0, 0.0};
    result.is_mirrored = true;
    result.min_angle_rad = -1.6580627893946132;
    result.increment_rad = -2.0 * result.min_angle_rad / (num_beams - 1);
    result.range_min_m = 0.01;
    result.range_max_m = 29.0;
    result.ranges_m.assign(num_beams, 30.0F);
    const Eigen::Vector2d origin = transform(T_map_base, result.T_base_scanner.position());
    std::normal_distribution<double> noise(0.0, noise_m > 0.0 ? noise_m : 1.0);
    for (std::size_t beam = 0; beam < result.ranges_m.size(); ++beam) {
      const Eigen::Vector2d ray = transform({0.0, 0.0, T_map_base.yaw_rad}, result.direction(beam));
      double range_m = std::numeric_limits<double>::infinity();
      for (const Polygon& polygon : world) {
        for (std::size_t i = 0; i < polygon.size(); ++i) {
          // origin + range ray = a + share edge.
          const Eigen::Vector2d edge = polygon[(i + 1) % polygon.size()] - polygon[i];
          const Eigen::Vector2d to = polygon[i] - origin;
          const double determinant = crossProduct(ray, edge);
          if (determinant == 0.0) continue;
          const double share = crossProduct(to, ray) / determinant;
          const double at_m = crossProduct(to, edge) / determinant;
          if (share >= 0.0 && share <= 1.0 && at_m > 0.0) range_m = std::min(range_m, at_m);
        }
      }
      if (range_m > result.range_max_m) continue;
      if (noise_m > 0.0) range_m += noise(*random);
      result.ranges_m[beam] = static_cast<float>(range_m);
    }
    return result;
  }
};

/// An exact unicycle whose drives lag by first order, within what they are able to do, after a delay of the command.
struct PlantConfig {
  double lag_s{0.05};
  double delay_s{0.04};
  double max_linear_m_s2{2.4};  // rating of the drives
  double max_turn_rad_s2{6.0};
  double slip{0.0};            // share of the wheels' motion that the ground does not see
  double odometry_scale{1.0};  // odometry tells so many metres for one of the wheels
  double odometry_turn_scale{1.0};
  double localization_noise_m{0.0};
  double localization_noise_rad{0.0};
};

class Plant {
 public:
  Plant(const PlantConfig& config, const Pose2d& T_map_base) : config_(config), pose_map_(T_map_base) {}

  PlantConfig& config() { return config_; }

  void step(const Twist2d& command, double dt_s) {
    constexpr double kStep_s = 0.001;
    const int steps = std::max(1, static_cast<int>(std::lround(dt_s / kStep_s)));
    const double h = dt_s / steps;
    commands_.push_back({now_s_ + config_.delay_s, command});
    for (int i = 0; i < steps; ++i) {
      while (!commands_.empty() && commands_.front().first <= now_s_ + 1e-9) {
        effective_ = commands_.front().second;
        commands_.pop_front();
      }
      const auto lagged = [&](double now, double wanted, double limit) {
        return now + std::clamp((wanted - now) * (1.0 - std::exp(-h / config_.lag_s)), -limit * h, limit * h);
      };
      wheels_.linear_m_s = lagged(wheels_.linear_m_s, effective_.linear_m_s, config_.max_linear_m_s2);
      wheels_.angular_rad_s = lagged(wheels_.angular_rad_s, effective_.angular_rad_s, config_.max_turn_rad_s2);
      const double grip = 1.0 - config_.slip;
      pose_map_ = moveAlongArc(pose_map_, grip * wheels_.linear_m_s * h, grip * wheels_.angular_rad_s * h);
      pose_odom_ = moveAlongArc(pose_odom_, config_.odometry_scale * wheels_.linear_m_s * h,
                                config_.odometry_turn_scale * wheels_.angular_rad_s * h);
      now_s_ += h;
    }
  }

  const Pose2d& poseMap() const { return pose_map_; }
  const Pose2d& poseOdom() const { return pose_odom_; }
  Pose2d localized(std::mt19937_64* random) const {
    std::normal_distribution<double> unit;
    const double x = config_.localization_noise_m * unit(*random);
    const double y = config_.localization_noise_m * unit(*random);
    const double yaw = config_.localization_noise_rad * unit(*random);
    return {pose_map_.x_m + x, pose_map_.y_m + y, wrapAngle(pose_map_.yaw_rad + yaw)};
  }
  const Twist2d& wheels() const { return wheels_; }
  bool stands() const { return std::abs(wheels_.linear_m_s) < 1e-3 && std::abs(wheels_.angular_rad_s) < 1e-3; }
  void place(const Pose2d& T_map_base) { pose_map_ = T_map_base; }

 private:
  PlantConfig config_;
  Pose2d pose_map_;
  Pose2d pose_odom_;
  Twist2d wheels_;
  Twist2d effective_;
  std::deque<std::pair<double, Twist2d>> commands_;
  double now_s_{0.0};
};

}  // namespace base_navigation
