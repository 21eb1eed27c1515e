// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/brick_sleep.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <stdexcept>

#include "simulated_world/mujoco_model.h"
#include "simulated_world/world_observation.h"

namespace simulated_world {
namespace {

bool isActive(const mjModel& model, const mjData& data, int equality) {
#if mjVERSION_HEADER >= 300
  static_cast<void>(model);
  return data.eq_active[equality] != 0;
#else
  static_cast<void>(data);
  return model.eq_active[equality] != 0;
#endif
}

/// Bodies that an active connect or weld constraint holds.
std::vector<int> constrainedBodies(const mjModel& model, const mjData& data) {
  std::vector<int> bodies;
  for (int i = 0; i < model.neq; ++i) {
    if (isActive(model, data, i) && (model.eq_type[i] == mjEQ_WELD || model.eq_type[i] == mjEQ_CONNECT)) {
      bodies.push_back(model.eq_obj1id[i]);
      bodies.push_back(model.eq_obj2id[i]);
    }
  }
  return bodies;
}

/// Sets of indices that are joined pair by pair.
class Islands {
 public:
  explicit Islands(std::size_t count) : parents_(count) { std::iota(parents_.begin(), parents_.end(), 0); }

  std::size_t rootOf(std::size_t i) {
    while (parents_[i] != i) i = parents_[i] = parents_[parents_[i]];
    return i;
  }

  void join(std::size_t a, std::size_t b) { parents_[rootOf(a)] = rootOf(b); }

 private:
  std::vector<std::size_t> parents_;
};

}  // namespace

BrickSleep::BrickSleep(const mjModel& model, const std::vector<int>& brick_ids, const BrickSleepConfig& config)
    : config_(interactive_mapping::requireValid("BrickSleepConfig:", config)),
      ground_geom_(requireId(model, mjOBJ_GEOM, "ground")),
      brick_of_body_(static_cast<std::size_t>(model.nbody), -1) {
  if (model.geom_conaffinity[ground_geom_] != 0) {
    throw std::invalid_argument(
        "BrickSleep: conaffinity of ground = " + std::to_string(model.geom_conaffinity[ground_geom_]) + ", must be 0");
  }
  for (const int id : brick_ids) {
    const int body = requireId(model, mjOBJ_BODY, brickBodyName(id));
    Brick brick{
        id, body, model.jnt_qposadr[model.body_jntadr[body]], model.body_dofadr[body], {}, {}, model.body_mass[body]};
    for (int g = model.body_geomadr[body]; g < model.body_geomadr[body] + model.body_geomnum[body]; ++g) {
      brick.geoms.push_back(g);
      brick.conaffinities.push_back(model.geom_conaffinity[g]);
    }
    brick_of_body_[static_cast<std::size_t>(body)] = static_cast<int>(bricks_.size());
    index_of_id_[id] = bricks_.size();
    bricks_.push_back(brick);
  }
}

void BrickSleep::sleep(mjModel& model, mjData& data, Brick& brick, int group) {
  brick.group = group;
  std::copy_n(data.qpos + brick.qpos, 7, brick.pose.begin());
  for (const int geom : brick.geoms) model.geom_conaffinity[geom] = 0;
  for (int axis = 0; axis < 3; ++axis) {
    brick.lift_N[static_cast<std::size_t>(axis)] = -brick.mass_kg * model.opt.gravity[axis];
  }
  // On the joint, whose first three axes are the map's: MuJoCo would project a force on the body onto all joints.
  std::copy(brick.lift_N.begin(), brick.lift_N.end(), data.qfrc_applied + brick.dof);
  std::fill_n(data.qvel + brick.dof, 6, 0.0);
  std::fill_n(data.qacc_warmstart + brick.dof, 6, 0.0);
}

void BrickSleep::wake(mjModel& model, mjData& data, Brick& brick) {
  brick.group = kAwake;
  brick.moved_s = data.time;
  for (std::size_t i = 0; i < brick.geoms.size(); ++i) {
    model.geom_conaffinity[brick.geoms[i]] = brick.conaffinities[i];
  }
  // A force that somebody has put in the place of the lift is theirs.
  if (std::equal(brick.lift_N.begin(), brick.lift_N.end(), data.qfrc_applied + brick.dof)) {
    std::fill_n(data.qfrc_applied + brick.dof, 3, 0.0);
  }
}

void BrickSleep::wakeGroup(mjModel& model, mjData& data, int group) {
  for (Brick& brick : bricks_) {
    if (brick.group == group) wake(model, data, brick);
  }
}

void BrickSleep::wake(mjModel& model, mjData& data, int brick_id) {
  const int group = bricks_[index_of_id_.at(brick_id)].group;
  if (group != kAwake) wakeGroup(model, data, group);
}

bool BrickSleep::isAsleep(int brick_id) const {
  return bricks_[index_of_id_.at(brick_id)].group != kAwake;
}

bool BrickSleep::hasMoved(const mjData& data, const Brick& brick) const {
  for (std::size_t i = 0; i < 7; ++i) {
    if (!(std::abs(data.qpos[static_cast<std::size_t>(brick.qpos) + i] - brick.pose[i]) <= config_.moved_m))
      return true;
  }
  return false;
}

void BrickSleep::wakeTouched(mjModel& model, mjData& data) {
  std::set<int> groups;
  for (int c = 0; c < data.ncon; ++c) {
    // Two sleeping bricks have no contact, so the other one is awake.
    for (const int geom : {data.contact[c].geom1, data.contact[c].geom2}) {
      const int index = brick_of_body_[static_cast<std::size_t>(model.geom_bodyid[geom])];
      if (index >= 0) groups.insert(bricks_[static_cast<std::size_t>(index)].group);
    }
  }
  for (const int body : constrainedBodies(model, data)) {
    const int index = brick_of_body_[static_cast<std::size_t>(body)];
    if (index >= 0) groups.insert(bricks_[static_cast<std::size_t>(index)].group);
  }
  for (const Brick& brick : bricks_) {
    if (brick.group != kAwake && hasMoved(data, brick)) groups.insert(brick.group);
  }
  groups.erase(kAwake);
  for (const int group : groups) wakeGroup(model, data, group);
  for (const Brick& brick : bricks_) {
    if (brick.group != kAwake) {  // rounding must not add up
      std::copy(brick.pose.begin(), brick.pose.end(), data.qpos + brick.qpos);
      std::fill_n(data.qvel + brick.dof, 6, 0.0);
      std::fill_n(data.qacc_warmstart + brick.dof, 6, 0.0);
    }
  }
}

void BrickSleep::sleepResting(mjModel& model, mjData& data) {
  Islands islands(bricks_.size());
  std::vector<bool> may_sleep(bricks_.size(), true);
  std::vector<bool> is_on_ground(bricks_.size(), false);
  for (int c = 0; c < data.ncon; ++c) {
    const mjContact& contact = data.contact[c];
    const int a = brick_of_body_[static_cast<std::size_t>(model.geom_bodyid[contact.geom1])];
    const int b = brick_of_body_[static_cast<std::size_t>(model.geom_bodyid[contact.geom2])];
    if (a >= 0 && b >= 0) {
      islands.join(static_cast<std::size_t>(a), static_cast<std::size_t>(b));
    } else if (a >= 0 || b >= 0) {
      const auto brick = static_cast<std::size_t>(std::max(a, b));
      const bool is_ground = contact.geom1 == ground_geom_ || contact.geom2 == ground_geom_;
      const bool is_fixed = model.geom_bodyid[a >= 0 ? contact.geom2 : contact.geom1] == 0;  // ground or wall
      is_on_ground[brick] = is_on_ground[brick] || is_ground;
      may_sleep[brick] = may_sleep[brick] && is_fixed;
    }
  }
  for (const int body : constrainedBodies(model, data)) {
    const int index = brick_of_body_[static_cast<std::size_t>(body)];
    if (index >= 0) may_sleep[static_cast<std::size_t>(index)] = false;
  }
  std::vector<bool> island_may_sleep(bricks_.size(), true);
  std::vector<bool> island_is_on_ground(bricks_.size(), false);
  for (std::size_t i = 0; i < bricks_.size(); ++i) {
    Brick& brick = bricks_[i];
    const mjtNum* v = data.qvel + brick.dof;
    if (mju_norm3(v) > config_.rest_speed_m_per_s || mju_norm3(v + 3) > config_.rest_rate_rad_per_s) {
      brick.moved_s = data.time;
    }
    const std::size_t root = islands.rootOf(i);
    island_may_sleep[root] = island_may_sleep[root] && may_sleep[i] && data.time - brick.moved_s >= config_.rest_time_s;
    island_is_on_ground[root] = island_is_on_ground[root] || is_on_ground[i];
  }
  const int first_group = next_group_;
  for (std::size_t i = 0; i < bricks_.size(); ++i) {
    const std::size_t root = islands.rootOf(i);
    if (bricks_[i].group == kAwake && island_may_sleep[root] && island_is_on_ground[root]) {
      sleep(model, data, bricks_[i], first_group + static_cast<int>(root));
      next_group_ = first_group + static_cast<int>(bricks_.size());
    }
  }
}

void BrickSleep::update(mjModel& model, mjData& data) {
  wakeTouched(model, data);
  sleepResting(model, data);
}

}  // namespace simulated_world
