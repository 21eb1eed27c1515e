// SPDX-License-Identifier: BSD-3-Clause
#include "surface_picking/bodies.h"

#include <algorithm>
#include <cmath>
#include <iterator>
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

bool areOverlapping(const Cuboid& a, const Cuboid& b) {
  return overlap(a.T_map_body, a.size_m, b.T_map_body, b.size_m, BodyConfig::kOverlap_m);
}

/// Known bodies and cuboids that may be them, in the order in which they are taken.
std::vector<Pair> pairsOf(const std::vector<Body>& bodies, const std::vector<Cuboid>& cuboids,
                          const BodyConfig& config) {
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const Cuboid& known = bodies[i].cuboid;
    for (std::size_t j = 0; j < cuboids.size(); ++j) {
      const double distance_m = distanceBetween(known, cuboids[j]);
      if (isSamePose(known, cuboids[j], config)) {
        pairs.push_back({0, distance_m, i, j});
      } else if (distance_m <= 0.5 * std::min(known.size_m.minCoeff(), cuboids[j].size_m.minCoeff())) {
        pairs.push_back({1, distance_m, i, j});
      }
    }
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

bool isFree(const Cuboid& cuboid, const SpaceQuery& space) {
  if (!space) return false;
  constexpr double kMargin_m = 0.02;  // nearer points may belong to the surface of a neighbour
  const std::vector<SpaceState> states = space(insidePoints(cuboid.T_map_body, cuboid.size_m, kMargin_m, 4));
  const auto num_free = std::count(states.begin(), states.end(), SpaceState::kFree);
  return !states.empty() &&
         static_cast<double>(num_free) >= BodyConfig::kFreeShare * static_cast<double>(states.size());
}

}  // namespace

BodyTracker::BodyTracker(const BodyConfig& config, int first_id)
    : config_(interactive_mapping::requireValid("impossible bodies:", config)), next_id_(first_id) {}

BodyTracker::Update BodyTracker::update(double stamp_s, const std::vector<Cuboid>& all_cuboids, const SpaceQuery& space,
                                        const Eigen::AlignedBox3d& looked_at_map) {
  if (!std::isfinite(stamp_s) || stamp_s < last_stamp_s_) {
    throw std::invalid_argument("stamp = " + std::to_string(stamp_s) + " s, must be finite and not before the last, " +
                                std::to_string(last_stamp_s_) + " s");
  }
  for (const Cuboid& cuboid : all_cuboids) {
    if (!cuboid.T_map_body.matrix().allFinite() || !cuboid.covariance.allFinite()) {
      throw std::invalid_argument("pose and covariance of a cuboid of type '" + cuboid.type + "' must be finite");
    }
  }
  last_stamp_s_ = stamp_s;
  looked_at_ = looked_at_map;
  shown_.clear();

  std::vector<Cuboid> cuboids;
  std::copy_if(all_cuboids.begin(), all_cuboids.end(), std::back_inserter(cuboids),
               [this](const Cuboid& cuboid) { return isLookedFor(cuboid); });
  for (Body& body : bodies_) body.num_missed += isLookedFor(body.cuboid);
  std::vector<bool> is_used = atTaken(cuboids);
  for (const Pair& pair : pairsOf(bodies_, cuboids, config_)) {
    if (shown_.count(bodies_[pair.body].id) > 0 || is_used[pair.cuboid]) continue;
    is_used[pair.cuboid] = true;
    show(cuboids[pair.cuboid], &bodies_[pair.body]);
  }
  Update result;
  result.dropped = dropContradicted(cuboids, space);
  for (std::size_t j = 0; j < cuboids.size(); ++j) {
    if (!is_used[j]) addSeen(cuboids[j]);
  }
  taken_.erase(std::remove_if(taken_.begin(), taken_.end(),
                              [&](Taken& taken) {
                                return hasLeftHand(taken) && isLookedFor(taken.body.cuboid) &&
                                       ++taken.num_missed > BodyConfig::kGoneUpdates;
                              }),
               taken_.end());
  std::sort(bodies_.begin(), bodies_.end(), [](const Body& a, const Body& b) { return a.id < b.id; });
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    if (shown_.count(bodies_[i].id) > 0) result.seen.push_back(i);
  }
  return result;
}

bool BodyTracker::isLookedFor(const Cuboid& cuboid) const {
  return looked_at_.contains(boxAround(cuboid.T_map_body, cuboid.size_m));
}

bool BodyTracker::hasLeftHand(const Taken& taken) const {
  return taken.released_s && last_stamp_s_ > *taken.released_s;
}

std::vector<bool> BodyTracker::atTaken(const std::vector<Cuboid>& cuboids) {
  std::vector<bool> is_at_taken(cuboids.size());
  for (Taken& taken : taken_) {
    if (hasLeftHand(taken) && !taken.is_elsewhere) continue;
    for (std::size_t j = 0; j < cuboids.size(); ++j) {
      if (!areOverlapping(taken.body.cuboid, cuboids[j])) continue;
      is_at_taken[j] = true;
      taken.num_missed = -1;  // update() counts this one, if it looked for it
    }
  }
  return is_at_taken;
}

void BodyTracker::show(const Cuboid& cuboid, Body* body) {
  Eigen::Matrix3d like = Eigen::Matrix3d::Identity();  // another type keeps no names of axes
  if (body->num_looks > 0 && body->cuboid.type == cuboid.type) like = body->cuboid.T_map_body.linear();
  body->cuboid = alignedLike(cuboid, like);
  ++body->num_looks;
  body->num_missed = 0;
  body->last_seen_s = last_stamp_s_;
  shown_.insert(body->id);
}

std::vector<int> BodyTracker::dropContradicted(const std::vector<Cuboid>& cuboids, const SpaceQuery& space) {
  std::vector<int> dropped;  // all of them before any goes: `space` may throw
  for (const Body& body : bodies_) {
    const auto contradicts = [&](const Cuboid& cuboid) { return areOverlapping(body.cuboid, cuboid); };
    const bool is_gone = shown_.count(body.id) == 0 && (body.num_missed > config_.max_missed ||
                                                        std::any_of(cuboids.begin(), cuboids.end(), contradicts) ||
                                                        (isLookedFor(body.cuboid) && isFree(body.cuboid, space)));
    if (is_gone) dropped.push_back(body.id);
  }
  const auto isDropped = [&](const Body& body) {
    return std::find(dropped.begin(), dropped.end(), body.id) != dropped.end();
  };
  bodies_.erase(std::remove_if(bodies_.begin(), bodies_.end(), isDropped), bodies_.end());
  return dropped;
}

void BodyTracker::addSeen(const Cuboid& cuboid) {
  Body body;
  const auto back = std::find_if(taken_.begin(), taken_.end(), [&](const Taken& taken) {
    return hasLeftHand(taken) && !taken.is_elsewhere && taken.body.cuboid.type == cuboid.type &&
           distanceBetween(taken.body.cuboid, cuboid) <= config_.put_back_m;
  });
  if (back != taken_.end()) {
    body = back->body;
    taken_.erase(back);
  } else {
    body.id = next_id_++;
    body.first_seen_s = last_stamp_s_;
  }
  show(cuboid, &body);
  bodies_.push_back(std::move(body));
}

bool BodyTracker::attach(int id) {
  const auto at = std::find_if(bodies_.begin(), bodies_.end(), [id](const Body& body) { return body.id == id; });
  if (at == bodies_.end()) return false;
  taken_.push_back({*at, std::nullopt});
  bodies_.erase(at);
  return true;
}

void BodyTracker::detach(double stamp_s, const std::optional<Eigen::Vector3d>& place_map) {
  for (Taken& taken : taken_) {
    if (taken.released_s) continue;
    taken.released_s = stamp_s;
    taken.is_elsewhere =
        place_map && (*place_map - taken.body.cuboid.T_map_body.translation()).norm() > config_.put_back_m;
  }
}

void BodyTracker::clear() {
  bodies_.clear();
  taken_.clear();
  last_stamp_s_ = -std::numeric_limits<double>::infinity();
}

}  // namespace surface_picking
