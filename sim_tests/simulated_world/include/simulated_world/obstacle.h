// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <Eigen/Core>

namespace simulated_world {

// A thing of a person's size that stands in the way: an upright cylinder on the ground. Nothing moves it.
constexpr double kObstacleRadius_m = 0.2;
constexpr double kObstacleHeight_m = 1.7;
constexpr int kMaxObstacles = 4;  ///< at a time: bodies cannot be added to a world that runs

struct Obstacle {
  int index{0};                                     ///< in [0, kMaxObstacles)
  Eigen::Vector2d xy_map{Eigen::Vector2d::Zero()};  ///< of its axis
};

/// Name of an obstacle's body in the simulated world and in contacts.
inline std::string obstacleBodyName(int index) {
  return "obstacle_" + std::to_string(index);
}

}  // namespace simulated_world
