// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "simulated_world/mujoco_model.h"
#include "simulated_world/physics_options.h"
#include "simulated_world/pile_scene.h"

namespace simulated_world {

/// Bricks on the ground, between walls, under gravity, and nothing else.
class BrickPhysics {
 public:
  /// Throws std::invalid_argument for bad options, std::runtime_error if MuJoCo refuses the bricks.
  BrickPhysics(const std::vector<BrickPlacement>& bricks, const PhysicsOptions& options,
               const std::vector<Wall>& walls = {});

  /// Simulates at least `duration_s`, in whole steps. Throws std::runtime_error if MuJoCo reports a problem (a state that
  /// diverges, a full buffer): from there on it computes something else than this pile.
  void run(double duration_s);

  double time() const { return data_->time; }

  /// The bricks where they are now.
  std::vector<BrickPlacement> bricks() const;

  /// How a brick moves now: of its centre [m/s], and [rad/s].
  double speed(int id) const;
  double rate(int id) const;

  /// Puts a brick elsewhere, at rest; what leaned on it will fall.
  void place(int id, const Eigen::Isometry3d& T_map_brick);

  /// Largest over all bricks.
  double maxSpeed() const;  ///< of the centre [m/s]
  double maxRate() const;   ///< [rad/s]

 private:
  std::vector<BrickPlacement> bricks_;
  ModelPtr model_;
  DataPtr data_;
};

struct SettleConfig {
  PhysicsOptions physics;
  double rest_speed_m_per_s{0.002};
  double rest_rate_rad_per_s{0.02};
  double rest_time_s{1.0};          ///< all slower than that for so long: settled
  double max_time_s{15.0};          ///< a pile that takes longer is refused
  double patience_s{10.0};          ///< tipped bricks: the one that moves most after so long is dropped once more ...
  double max_tipped_time_s{60.0};   ///< ... and the pile is refused only after this
  double extent_tolerance_m{0.05};  ///< a heap may settle so far out of its rectangle, on each side
  int max_attempts{5};              ///< with different jitter

  std::vector<std::string> validate() const;
};

struct SettledPile {
  PileScene scene;  ///< its bricks at rest
  int attempts{1};
  std::vector<std::string> refusals;  ///< why earlier attempts were no good, one line each
  double settle_time_s{0.0};          ///< simulated
};

/// What is wrong with a pile that was dropped as `scene` and came to rest as `settled`, one line each: bricks that rolled
/// away, a heap that has spread or lost a layer, a stack that has not stood, a wedged brick that lies free.
std::vector<std::string> faultsOfSettled(const PileScene& scene, const std::vector<BrickPlacement>& settled,
                                         double extent_tolerance_m);

/// Seed of an attempt; the first one, 0, has the run's own.
std::uint64_t seedOfAttempt(std::uint64_t seed, int attempt);

/// Drops the bricks of a scene and waits until they lie still. A brick of a tipped heap that does not come to rest is
/// dropped a second time; all are, with other jitter, if the pile is not what was asked for. The same arguments give
/// the same bits. Throws std::invalid_argument for an impossible scene or config, and
/// std::runtime_error with the reasons of all attempts if none was good.
SettledPile settlePile(const PileSceneConfig& scene, std::uint64_t seed, const SettleConfig& config = {});

}  // namespace simulated_world
