// SPDX-License-Identifier: BSD-3-Clause
#include "surface_picking/bodies.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>
#include <utility>

namespace surface_picking {
namespace {

struct Pair {
  int round;  // 0: as known; 1: another type or rotation at the same place
  double distance_m;
  std::size_t body, cuboid;

  bool operator<(const Pair& other) const {
    return std::tie(round, distance_m, body, cuboid) <
           std::tie(other.round, other.distance_m, other.body, other.cuboid);
  }
};

double distanceBetween(const Cuboid& a, const Cuboid& b) {
  return (a.T_map_body.translation() - b.T_map_body.translation()).norm();
}

bool isSamePose(const Cuboid& a, const Cuboid& b, const BodyConfig& config) {
  return a.type == b.type && distanceBetween(a, b) <= config.gate_m &&
         angleBetweenBodies(a.T_map_body, b.T_map_body, a.size_m) <= config.gate_rad;
}

}  // namespace

BodyTracker::BodyTracker(const BodyConfig& config)
    : config_(interactive_mapping::requireValid("impossible bodies:", config)) {}

BodyTracker::Update BodyTracker::update(double stamp_s, const std::vector<Cuboid>& cuboids, const SpaceQuery& space) {
  if (!std::isfinite(stamp_s) || stamp_s < last_stamp_s_) {
    throw std::invalid_argument("stamp = " + std::to_string(stamp_s) + " s, must be finite and not before the last, " +
                                std::to_string(last_stamp_s_) + " s");
  }
  for (const Cuboid& cuboid : cuboids) {
    if (!cuboid.T_map_body.matrix().allFinite() || !cuboid.covariance.allFinite()) {
      throw std::invalid_argument("pose and covariance of a cuboid of type '" + cuboid.type + "' must be finite");
    }
  }
  last_stamp_s_ = stamp_s;

  std::vector<bool> is_used(cuboids.size(), false);
  for (std::size_t j = 0; j < cuboids.size(); ++j) {
    is_used[j] = std::any_of(taken_.begin(), taken_.end(), [&](const Taken& taken) {
      return (!taken.released_s || stamp_s <= *taken.released_s) &&
             overlap(taken.body.cuboid.T_map_body, taken.body.cuboid.size_m, cuboids[j].T_map_body, cuboids[j].size_m,
                     config_.overlap_m);
    });
  }
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    const Cuboid& known = bodies_[i].cuboid;
    for (std::size_t j = 0; j < cuboids.size(); ++j) {
      if (is_used[j]) continue;
      const double distance_m = distanceBetween(known, cuboids[j]);
      if (isSamePose(known, cuboids[j], config_)) {
        pairs.push_back({0, distance_m, i, j});
      } else if (distance_m <= 0.5 * std::min(known.size_m.minCoeff(), cuboids[j].size_m.minCoeff())) {
        pairs.push_back({1, distance_m, i, j});
      }
    }
  }
  std::sort(pairs.begin(), pairs.end());
  std::vector<bool> is_seen(bodies_.size(), false);
  const auto show = [&](Body* body, const Cuboid& cuboid) {
    Eigen::Matrix3d like = Eigen::Matrix3d::Identity();  // another type keeps no names of axes
    if (body->num_looks > 0 && body->cuboid.type == cuboid.type) like = body->cuboid.T_map_body.linear();
    body->cuboid = alignedLike(cuboid, like);
    ++body->num_looks;
    body->num_missed = 0;
    body->last_seen_s = stamp_s;
  };
  for (const Pair& pair : pairs) {
    if (is_seen[pair.body] || is_used[pair.cuboid]) continue;
    is_seen[pair.body] = is_used[pair.cuboid] = true;
    show(&bodies_[pair.body], cuboids[pair.cuboid]);
  }

  Update result;
  std::vector<Body> kept;
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    Body& body = bodies_[i];
    if (!is_seen[i]) {
      ++body.num_missed;
      const Cuboid& old = body.cuboid;
      bool is_gone = body.num_missed > config_.max_missed ||
                     std::any_of(cuboids.begin(), cuboids.end(), [&](const Cuboid& cuboid) {
                       return overlap(old.T_map_body, old.size_m, cuboid.T_map_body, cuboid.size_m, config_.overlap_m);
                     });
      if (!is_gone && space) {
        constexpr double kMargin_m = 0.02;  // nearer points may belong to the surface of a neighbour
        const std::vector<SpaceState> states = space(insidePoints(old.T_map_body, old.size_m, kMargin_m, 4));
        const auto num_free = std::count(states.begin(), states.end(), SpaceState::kFree);
        is_gone =
            !states.empty() && static_cast<double>(num_free) >= config_.free_share * static_cast<double>(states.size());
      }
      if (is_gone) {
        result.dropped.push_back(body.id);
        continue;
      }
    }
    kept.push_back(std::move(body));
  }
  bodies_ = std::move(kept);

  for (std::size_t j = 0; j < cuboids.size(); ++j) {
    if (is_used[j]) continue;
    Body body;
    const auto back = std::find_if(taken_.begin(), taken_.end(), [&](const Taken& taken) {
      return taken.released_s && stamp_s > *taken.released_s && taken.body.cuboid.type == cuboids[j].type &&
             distanceBetween(taken.body.cuboid, cuboids[j]) <= config_.put_back_m;
    });
    if (back != taken_.end()) {
      body = back->body;
      taken_.erase(back);
    } else {
      body.id = next_id_++;
      body.first_seen_s = stamp_s;
    }
    show(&body, cuboids[j]);
    bodies_.push_back(std::move(body));
  }
  taken_.erase(std::remove_if(taken_.begin(), taken_.end(),
                              [&](Taken& taken) {
                                return taken.released_s && stamp_s > *taken.released_s &&
                                       ++taken.num_missed > config_.max_missed;
                              }),
               taken_.end());
  std::sort(bodies_.begin(), bodies_.end(), [](const Body& a, const Body& b) { return a.id < b.id; });
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    if (bodies_[i].num_missed == 0) result.seen.push_back(i);
  }
  return result;
}

bool BodyTracker::attach(int id) {
  const auto at = std::find_if(bodies_.begin(), bodies_.end(), [id](const Body& body) { return body.id == id; });
  if (at == bodies_.end()) return false;
  taken_.push_back({*at, std::nullopt});
  bodies_.erase(at);
  return true;
}

void BodyTracker::detach(double stamp_s) {
  for (Taken& taken : taken_) {
    if (!taken.released_s) taken.released_s = stamp_s;
  }
}

void BodyTracker::clear() {
  bodies_.clear();
  taken_.clear();
  last_stamp_s_ = -std::numeric_limits<double>::infinity();
}

}  // namespace surface_picking
