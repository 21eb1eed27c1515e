// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>

#include "base_navigation/base_path.h"
#include "base_navigation/grid_fusion.h"

namespace base_navigation {

struct ObstacleGuardConfig {
  double margin_m{0.04};
  double latency_s{0.25};
  double braking_share{0.7};
  double look_ahead_m{3.0};
  double look_ahead_rad{1.6};
  int min_echoes{2};

  static void fields(ObstacleGuardConfig& c, interactive_mapping::Fields& f) {
    f.live("guard_margin_m")(
        "margin_m", c.margin_m, 0.001, 1.0, "m",
        "distance from echoes to the footprint that is kept; less than the distance of a standing pose from a "
        "pile");
    f("latency_s", c.latency_s, 0.01, 2.0, "s",
      "from an echo to the first effect of a command: scan period, transport, drives");
    f("braking_share", c.braking_share, 0.05, 1.0, "", "share of the deceleration limits that the guard counts on");
    f("look_ahead_m", c.look_ahead_m, 0.05, 100.0, "m",
      "how far ahead the guard looks: at least the stopping distance from the highest speed");
    f("look_ahead_rad", c.look_ahead_rad, 0.05, 6.283, "rad",
      "the same of turns: at least the angle that a stop takes from the highest rate");
    f("min_echoes", c.min_echoes, 1, 20, "",
      "neighbouring echoes that make an obstacle; a single one is dust or noise");
  }

  /// Problems that only the base has: too little look_ahead to stop from its highest speed. None while the fields or the
  /// limits have problems themselves.
  std::vector<std::string> problemsFor(const MotionLimits& limits) const;
};

struct GuardVerdict {
  double speed_factor{
      1.0};            // of the twist asked about, so that the base can stop in front of what the scanner sees; 0: stop
  double free_m{0.0};  // along the way until the footprint with its margin meets an echo, at most look_ahead
  double free_rad{0.0};                          // turned until then
  std::optional<Eigen::Vector2d> obstacle_base;  // the first echo met
};

/// Slows down and stops in front of what the safety scanner sees now, whatever map and plan say. The scanner does not
/// see behind: what is driven backwards relies on the grid alone.
///
/// An echo is met when it is within margin_m of an edge of the footprint (corners sharp, see padPolygon). min_echoes
/// beams side by side meet the base when the last of them does. So a lone speck before a wall counts as the wall. No
/// threshold for a step in range is needed; walls seen at a grazing angle would defeat it.
class ObstacleGuard {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  ObstacleGuard(const ObstacleGuardConfig& config, const MotionLimits& limits, const Polygon& footprint);

  /// How much of `wanted` is safe if it continues without end. Echoes inside the footprint itself are the robot's own
  /// and left out. Echoes already in the margin stop only motion that brings them nearer. `T_scan_base` is the base
  /// now, in base_link when the scan was taken. Throws std::invalid_argument for a twist or pose that is not finite.
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

  /// The way, as far as it is looked at.
  std::vector<Leg> legsOf(const std::vector<BaseMotion>& ahead) const;
  /// When the footprint meets an echo, as legs gone by plus share of the next.
  double whenMet(const Eigen::Vector2d& p_base, const std::vector<Leg>& legs) const;
  /// Along the way: what the wheels and, in curves, the turning allow, at the tightest place up to leg `last`.
  double deceleration(const std::vector<Leg>& legs, std::size_t last) const;
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
