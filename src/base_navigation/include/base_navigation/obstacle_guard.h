// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base_navigation/base_path.h"
#include "base_navigation/grid_fusion.h"

namespace base_navigation {

struct ObstacleGuardConfig {
  double margin_m{0.04};      // echoes stay so far off the footprint; less than the stand-off from a pile
  double latency_s{0.25};     // from an echo to the first effect of a command: scan period, transport, drives
  double braking_share{0.7};  // of the linear and turning deceleration that is counted on
  double look_ahead_m{2.0};
  double look_ahead_rad{1.6};
  int min_echoes{2};  // so many neighbouring echoes make an obstacle; one is dust or noise

  std::vector<std::string> validate() const;
};

struct GuardVerdict {
  double speed_factor{1.0};  // of the twist asked about, so that the base can stop in front of what the scanner sees
  double free_m{0.0};        // along the arc until the footprint with its margin meets an echo, at most look_ahead
  double free_rad{0.0};      // turned until then
  std::optional<Eigen::Vector2d> obstacle_base;  // the first echo met
  bool mustStop() const { return speed_factor <= 0.0; }
};

/// Slows down and stops in front of what the safety scanner sees now, whatever map and plan say. The scanner does not
/// see behind: what is driven backwards relies on the grid alone.
class ObstacleGuard {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  ObstacleGuard(const ObstacleGuardConfig& config, const MotionLimits& limits, Polygon footprint);

  /// How much of `wanted` is safe. Echoes inside the footprint itself are the robot's own and left out; those already in
  /// the margin stop what brings them nearer, and nothing that takes them away. Throws std::invalid_argument for a
  /// twist that is not finite.
  GuardVerdict check(const Twist2d& wanted, const Scan& scan) const;

 private:
  ObstacleGuardConfig config_;
  MotionLimits limits_;
  Polygon footprint_;
};

}  // namespace base_navigation
