// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "simulated_world/judge_event.h"
#include "simulated_world/world_observation.h"

namespace simulated_world {

constexpr double kDegree = 3.14159265358979323846 / 180.0;

/// A world that stands still unless a test moves something; advance() makes the next observation of it.
struct ObservedWorld {
  WorldObservation now;

  BrickObservation& add(int id, const Eigen::Vector3d& xyz_m, const Eigen::Vector3d& size_m = {0.3, 0.15, 0.1}) {
    BrickObservation brick;
    brick.id = id;
    brick.T_map_brick.translation() = xyz_m;
    brick.size_m = size_m;
    now.bricks.push_back(brick);
    return now.bricks.back();
  }

  BrickObservation& brick(int id) {
    return *std::find_if(now.bricks.begin(), now.bricks.end(), [id](const auto& b) { return b.id == id; });
  }

  void turn(int id, const Eigen::Vector3d& axis, double angle_rad) {
    brick(id).T_map_brick.linear() = Eigen::AngleAxisd(angle_rad, axis).toRotationMatrix();
  }

  void touch(const std::string& robot_body, const std::string& other_body, double force_N = 10.0) {
    now.contacts = {{robot_body, other_body, force_N, false, {0.3, 0.2, 0.1}}};
  }

  /// Observes with `watch` now and then every `period_s` for `duration_s`, the world standing still.
  template <typename Watcher>
  std::vector<JudgeEvent> hold(Watcher& watcher, double duration_s, double period_s = 0.05) {
    std::vector<JudgeEvent> all;
    const int steps = std::max(1, static_cast<int>(duration_s / period_s + 0.5));
    for (int i = 0; i < steps; ++i) {
      now.time_s += period_s;
      const std::vector<JudgeEvent> events = watcher.observe(now);
      all.insert(all.end(), events.begin(), events.end());
    }
    return all;
  }
};

}  // namespace simulated_world
