// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>

#include "base_navigation/base_path.h"
#include "base_navigation/grid_fusion.h"

namespace base_navigation {

struct ObstacleGuardConfig {
  double margin_m{0.04};      // echoes stay so far off the footprint; less than the stand-off from a pile
  double latency_s{0.25};     // from an echo to the first effect of a command: scan period, transport, drives
  double braking_share{0.7};  // of the linear and turning deceleration that is counted on
  double look_ahead_m{3.0};   // at least what it takes to stop from the highest speed
  double look_ahead_rad{1.6};
  int min_echoes{2};  // so many neighbouring echoes make an obstacle; one is dust or noise

  std::vector<std::string> validate() const;
  /// What the limits rule out beyond that: too little look_ahead to stop from the highest speed. Nothing while validate()
  /// or the limits' own has something to say.
  std::vector<std::string> validateFor(const MotionLimits& limits) const;
};

struct GuardVerdict {
  double speed_factor{1.0};  // of the twist asked about, so that the base can stop in front of what the scanner sees
  double free_m{0.0};        // along the way until the footprint with its margin meets an echo, at most look_ahead
  double free_rad{0.0};      // turned until then
  std::optional<Eigen::Vector2d> obstacle_base;  // the first echo met
  bool mustStop() const { return speed_factor <= 0.0; }
};

/// Slows down and stops in front of what the safety scanner sees now, whatever map and plan say. The scanner does not
/// see behind: what is driven backwards relies on the grid alone.
///
/// An echo is met when it is within margin_m of an edge of the footprint (corners sharp, see padPolygon). min_echoes beams
/// side by side meet the base when the last of them does: a lone speck before a wall counts as the wall, and no
/// threshold for a step in range is needed, which walls seen at a grazing angle would defeat.
class ObstacleGuard {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  ObstacleGuard(const ObstacleGuardConfig& config, const MotionLimits& limits, const Polygon& footprint);

  /// How much of `wanted` is safe if it goes on for ever. Echoes inside the footprint itself are the robot's own and left
  /// out; those already in the margin stop what brings them nearer, and nothing that takes them away. `T_scan_base` is
  /// the base now, in base_link when the scan was taken. Throws std::invalid_argument for a twist or pose that is not
  /// finite.
  GuardVerdict check(const Twist2d& wanted, const Scan& scan, const Pose2d& T_scan_base = {}) const;

  /// Likewise if the base goes along `ahead` from where it is, beginning with `wanted`, and stands at the end. `ahead`
  /// has one direction or is one turn on the spot; throws std::invalid_argument otherwise.
  GuardVerdict check(const Twist2d& wanted, const std::vector<BaseMotion>& ahead, const Scan& scan,
                     const Pose2d& T_scan_base = {}) const;

  const ObstacleGuardConfig& config() const { return config_; }

 private:
  struct Edge {
    Eigen::Vector2d normal;  // outwards
    double offset_m;         // normal . p on the edge
    double normal_rad;       // bearing of the normal
  };
  /// A motion of the way ahead, in the base's frame now.
  struct Leg {
    BaseMotion motion;
    Eigen::Isometry2d T_leg_base;
    double before_m;    // way up to here
    double before_rad;  // turned up to here
    // Echoes nearer to or farther from the middle of the turn do not meet the footprint. Straight: unused.
    double min_radius_m;
    double max_radius_m;
    double reach_m;  // of the footprint, from the leg's start
  };

  double distance(const Eigen::Vector2d& p_base) const;
  double approach(const Eigen::Vector2d& p_base, const Twist2d& twist) const;
  double meets(const Eigen::Vector2d& p_leg, const Leg& leg, double padding_m) const;

  ObstacleGuardConfig config_;
  MotionLimits limits_;
  Polygon padded_;
  std::vector<Edge> edges_;
  double radius_m_{0.0};  // of padded_
};

}  // namespace base_navigation
