// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "simulated_world/collision_monitor.h"
#include "simulated_world/fall_monitor.h"
#include "simulated_world/judge_event.h"
#include "simulated_world/pile_surface.h"
#include "simulated_world/surface_score.h"
#include "simulated_world/world_observation.h"

namespace simulated_world {

/// Where an ideal camera at the robot's camera's height would look at the pile from: all free places of a grid.
struct LookoutConfig {
  double height_m{1.5};     ///< of the camera over the ground; the simulation takes the robot's
  double spacing_m{0.5};    ///< of the grid
  double margin_m{1.5};     ///< the grid reaches so far round the bricks' places at the start
  double clearance_m{0.5};  ///< a place is at least so far from every brick, on the ground

  std::vector<std::string> validate() const;
};

struct JudgeConfig {
  FallConfig falls;
  CollisionConfig collisions;
  PileSurfaceConfig pile;
  ScoreConfig score;
  LookoutConfig lookouts;
  double truth_period_s{0.5};      ///< the pile's true surface is renewed at most this often
  double surface_history_s{30.0};  ///< a strategy's surface whose data are older is not judged
  double row_period_s{1.0};        ///< of the history; an event makes a row of its own
  double min_step_m{0.005};        ///< shorter ways of the base add up before they count: standing is not driving

  std::vector<std::string> validate() const;
};

/// State of a run at one time; counts are those since its start.
struct JudgeRow {
  double time_s{0.0};
  int stowed{0};
  int falls{0};
  int drops{0};
  int collisions{0};
  int load_contacts{0};             ///< of a brick in the hand with anything but the robot
  std::optional<double> coverage;   ///< in [0, 1]; nothing before a face was coverable
  std::optional<double> precision;  ///< in [0, 1], of the latest surface; nothing before one had a part to be judged
  double distance_m{0.0};           ///< driven by the base
  double disturbance_m{0.0};  ///< sum over bricks: how far from its place at the start each was before the tool had it
};

struct JudgeReport {
  JudgeRow totals;  ///< at the last observation
  double start_time_s{0.0};
  int bricks_total{0};     ///< at the first observation
  int bricks_pickable{0};  ///< of them; see unpickable()
  double max_collision_force_N{0.0};
  double exposed_area_m2{0.0};    ///< ever, of all bricks
  double coverable_area_m2{0.0};  ///< of it, ever in an ideal camera's view (LookoutConfig)
  double covered_area_m2{0.0};    ///< of the coverable area, ever covered while exposed
  int surfaces_judged{0};
  int surfaces_refused{0};  ///< too old, or from before the run
  std::vector<JudgeRow> history;
  std::vector<JudgeEvent> events;
};

enum class SurfaceVerdict { kJudged, kOutsideOfHistory };

/// Ground truth's view of a run: what was stowed, what fell, what was hit, how well the pile was mapped, how far the base
/// drove. Knows nothing of the robot's software but the surface it is shown.
///
/// Exposed: all the area of bricks at rest that somebody could ever have seen from somewhere (see PileSurface). In a cleft
/// or against a wall it may face no place where the robot's camera can be; coverable is what one could have seen that is
/// everywhere at once.
/// Coverage: of the coverable area, the share that was ever within the tolerance of the strategy's surface at a time when
/// it was exposed. Each surface is judged against the truth at its own stamp, once, on arrival. What was covered stays
/// covered, whatever happens to the brick.
/// Precision: see surfacePrecision(), with the truth at the surface's stamp.
class Judge {
 public:
  /// Throws std::invalid_argument with all that is wrong with `config`.
  explicit Judge(const JudgeConfig& config);

  /// Times increase, ids are unique, poses finite, sizes positive; std::invalid_argument otherwise, with nothing taken
  /// over.
  void observe(const WorldObservation& observation);

  /// Throws std::invalid_argument for a broken surface (StrategySurface::check) and before the first observation.
  SurfaceVerdict judgeSurface(const StrategySurface& surface);

  /// Ends collisions that still last; to be called once, after the last observation.
  void finish();

  /// Both only grow.
  const std::vector<JudgeEvent>& events() const { return events_; }
  const std::vector<JudgeRow>& history() const { return history_; }

  /// Counts and shares as of the last observation. The report has them too, with a copy of all that happened.
  JudgeRow totals() const;

  JudgeReport report() const;

 private:
  struct TruthAt {
    double time_s;
    std::shared_ptr<const PileTruth> truth;
  };
  struct ObstaclesAt {
    double time_s;
    std::vector<Obstacle> obstacles;
  };
  /// Per sample of a brick; sized at its first exposure.
  struct Ledger {
    std::vector<bool> was_exposed;
    std::vector<bool> was_coverable;
    std::vector<bool> was_covered;
  };

  void check(const WorldObservation& observation) const;
  void start(const WorldObservation& observation);
  void count(const std::vector<JudgeEvent>& events);
  void renewTruth(const WorldObservation& observation);
  std::vector<Eigen::Vector3d> lookouts(const PileTruth& truth) const;
  void renewObstacles(const WorldObservation& observation);
  void drive(const Eigen::Vector2d& base_xy_m);
  void noteMoved(const WorldObservation& observation);

  JudgeConfig config_;
  FallMonitor falls_;
  CollisionMonitor collisions_;
  PileSurface pile_;
  GroundRegion region_;
  std::deque<TruthAt> truths_;         ///< the last one older than the history, and all later ones
  std::deque<ObstaclesAt> obstacles_;  ///< of the same times; each holds until the next
  double truth_checked_s_{0.0};
  std::map<int, Ledger> ledgers_;
  std::set<int> stowed_ids_;
  struct Moved {
    Eigen::Vector3d start_map;
    double distance_m{0.0};
  };
  std::map<int, Moved> moved_;  ///< by others than tool and person
  bool has_started_{false};
  double time_s_{0.0};
  Eigen::Vector2d counted_base_xy_m_{0.0, 0.0};
  JudgeReport report_;  ///< what is not in the members above
  std::vector<JudgeEvent> events_;
  std::vector<JudgeRow> history_;
};

}  // namespace simulated_world
