// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <map>
#include <vector>

#include <interactive_mapping_common/config/schema.h>
#include <mujoco/mujoco.h>

namespace simulated_world {

struct BrickSleepConfig {
  double rest_speed_m_per_s{0.002};
  double rest_rate_rad_per_s{0.02};
  double rest_time_s{0.5};
  double moved_m{1e-7};  ///< a sleeping brick that the world moved by more in one step wakes up; no parameter

  static void fields(BrickSleepConfig& c, interactive_mapping::Fields& f) {
    f("rest_speed_m_s", c.rest_speed_m_per_s, 1e-9, 1e3, "m/s", "speed of a brick's centre below which it is at rest");
    f("rest_rate_rad_s", c.rest_rate_rad_per_s, 1e-9, 1e3, "rad/s", "turn rate below which a brick is at rest");
    f("rest_time_s", c.rest_time_s, 1e-9, 1e6, "s",
      "time at rest after which bricks that touch each other fall asleep");
    f.require(c.moved_m > 0.0, "moved_m must be above 0 m");
  }
};

/// Spares the computation of bricks that lie still, which is most of the cost of a pile.
///
/// Bricks that touch each other and the ground form a group. A group at rest falls asleep: its bricks stay exactly where
/// they are, with no contacts among themselves and with the ground, and no weight. It wakes up as a whole as soon as
/// anything awake touches one of its bricks, an equality constraint (the magnet) takes hold of one, or somebody moves
/// one: in the step after, 2 ms late. Then it is an ordinary pile again. What the robot touches or holds never sleeps.
/// For this, ground and sleeping bricks must not collide but all else must: groundXml() and brickXml() are made for it,
/// and the robot's geoms keep contype and conaffinity 1, MuJoCo's defaults.
class BrickSleep {
 public:
  /// `brick_ids` are those of brickXml() bodies in the model. Throws std::invalid_argument for a brick or ground that is
  /// not in the model, ground that collides with sleeping bricks, and a bad config.
  BrickSleep(const mjModel& model, const std::vector<int>& brick_ids, const BrickSleepConfig& config = {});

  /// To be called after each mj_step, with the model given above and its data. Writes the bricks' conaffinity in the
  /// model; of the data, sleeping bricks' qpos, qvel, qacc_warmstart and qfrc_applied.
  void update(mjModel& model, mjData& data);

  /// Wakes a brick's group; for whoever is about to move a brick and does not want the one step's delay.
  void wake(mjModel& model, mjData& data, int brick_id);

  bool isAsleep(int brick_id) const;

 private:
  static constexpr int kAwake = -1;

  struct Brick {
    int id;
    int body;
    int qpos;
    int dof;
    std::vector<int> geoms;
    std::vector<int> conaffinities;  ///< of the geoms, when awake
    double mass_kg;
    double moved_s{0.0};  ///< time of the last motion
    int group{kAwake};
    std::array<mjtNum, 7> pose{};  ///< when asleep
    std::array<mjtNum, 3> lift_N{};
  };

  void sleep(mjModel& model, mjData& data, Brick& brick, int group);
  void wake(mjModel& model, mjData& data, Brick& brick);
  void wakeGroup(mjModel& model, mjData& data, int group);
  bool hasMoved(const mjData& data, const Brick& brick) const;
  void wakeTouched(mjModel& model, mjData& data);
  void sleepResting(mjModel& model, mjData& data);

  BrickSleepConfig config_;
  int ground_geom_;
  std::vector<Brick> bricks_;
  std::vector<int> brick_of_body_;  ///< index into bricks_, or -1
  std::map<int, std::size_t> index_of_id_;
  int next_group_{0};
};

}  // namespace simulated_world
