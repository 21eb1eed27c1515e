// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <map>
#include <string>
#include <vector>

#include <Eigen/Geometry>

#include "simulated_world/judge_event.h"
#include "simulated_world/world_observation.h"

namespace simulated_world {

struct FallConfig {
  double fall_distance_m{0.05};     ///< moved farther than this from its reference pose: fallen
  double fall_tilt_rad{0.2617994};  ///< 15 deg, see tiltBetween()
  double rest_window_s{0.5};        ///< at rest: over this time no faster than ...
  double rest_speed_m_per_s{0.01};  ///< ... this, and
  double rest_rate_rad_per_s{0.1};  ///< this
  std::string tool_body{"magnet"};  ///< while it touches the target, the target is being handled

  std::vector<std::string> validate() const;
};

/// Angle by which what was up in the first rotation leans away from up in the second. A turn about the vertical is no
/// tilt: a brick that is only turned has not been tipped, and what it moves by is a distance.
double tiltBetween(const Eigen::Matrix3d& R_map_before, const Eigen::Matrix3d& R_map_now);

/// Counts bricks that fall and bricks that are dropped.
///
/// A brick falls when, handled by nobody, it has moved or tilted too far from its reference pose: that of the run's
/// start, later that in which it came to rest at the end of an event of its own. Creeping therefore adds up. From the
/// detection to the next rest it is one fall, however far it rolls. What was moved by hand, dropped or put back is
/// watched again from its next rest on; a target that the tool lets go of is watched from that moment on.
class FallMonitor {
 public:
  /// Throws std::invalid_argument with all that is wrong with `config`.
  explicit FallMonitor(const FallConfig& config);

  /// Observations come with increasing time. A brick that is missing from one is forgotten.
  std::vector<JudgeEvent> observe(const WorldObservation& observation);

  int falls() const { return falls_; }
  int drops() const { return drops_; }

  /// False for a brick that moves, is handled or was first seen less than the window ago and moved since.
  bool isAtRest(int id) const;

 private:
  struct PoseAt {
    double time_s;
    Eigen::Isometry3d T_map_brick;
  };
  enum class State { kWatched, kFalling, kHandled, kSettling };
  struct Brick {
    State state{State::kWatched};
    BrickStatus status{BrickStatus::kInPile};
    Eigen::Isometry3d reference{Eigen::Isometry3d::Identity()};
    double fall_time_s{0.0};
    std::deque<PoseAt> recent;  ///< covers the window as soon as the brick is known for that long
    bool is_resting{true};
  };

  bool isResting(const Brick& brick) const;

  FallConfig config_;
  std::map<int, Brick> bricks_;
  int falls_{0};
  int drops_{0};
};

}  // namespace simulated_world
