// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/judge.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <stdexcept>

#include <interactive_mapping_common/config/range_check.h>
#include <interactive_mapping_common/config/schema.h>

namespace simulated_world {
namespace {

bool isInPile(BrickStatus status) {
  return status == BrickStatus::kInPile || status == BrickStatus::kDropped;
}

[[noreturn]] void refuse(const std::string& what) {
  throw std::invalid_argument("WorldObservation: " + what);
}

}  // namespace

std::vector<std::string> LookoutConfig::validate() const {
  interactive_mapping::RangeCheck check;
  check("height_m", height_m, 0.01, 10.0, "m");
  check("spacing_m", spacing_m, 0.1, 10.0, "m");
  check("margin_m", margin_m, 0.0, 10.0, "m");
  check("clearance_m", clearance_m, 0.0, 100.0, "m");
  return check.problems();
}

std::vector<std::string> JudgeConfig::validate() const {
  std::vector<std::string> problems;
  const auto add = [&](const std::string& section, const std::vector<std::string>& of_section) {
    for (const std::string& problem : of_section) problems.push_back(section + problem);
  };
  add("falls/", falls.validate());
  add("collisions/", collisions.validate());
  add("pile/", pile.validate());
  add("score/", score.validate());
  add("lookouts/", lookouts.validate());
  interactive_mapping::RangeCheck check;
  check("truth_period_s", truth_period_s, 0.0, 3600.0, "s");
  check("surface_history_s", surface_history_s, 0.001, 3600.0, "s");
  check("row_period_s", row_period_s, 0.001, 3600.0, "s");
  check("min_step_m", min_step_m, 0.0, 1.0, "m");
  add("", check.problems());
  return problems;
}

Judge::Judge(const JudgeConfig& config)
    : config_(config), falls_(config.falls), collisions_(config.collisions), pile_(config.pile) {
  interactive_mapping::refuseIfAny("JudgeConfig:", config.validate());
}

void Judge::check(const WorldObservation& observation) const {
  if (!std::isfinite(observation.time_s) || (has_started_ && observation.time_s <= time_s_)) {
    refuse("time_s = " + std::to_string(observation.time_s) + " s, must be later than " + std::to_string(time_s_) +
           " s");
  }
  if (!observation.base_xy_m.allFinite()) {
    refuse("base_xy_m, must be finite");
  }
  std::set<int> ids;
  for (const BrickObservation& brick : observation.bricks) {
    if (!ids.insert(brick.id).second || !brick.T_map_brick.matrix().allFinite() || !brick.size_m.allFinite() ||
        !(brick.size_m.minCoeff() > 0.0)) {
      refuse("bricks, id = " + std::to_string(brick.id) + ", must be unique, with a finite pose and a size > 0 m");
    }
  }
  for (const Obstacle& obstacle : observation.obstacles) {
    if (!obstacle.xy_map.allFinite()) {
      refuse("obstacles, index = " + std::to_string(obstacle.index) + ": its place must be finite");
    }
  }
  for (const RobotContact& contact : observation.contacts) {
    if (!std::isfinite(contact.force_N) || contact.force_N < 0.0) {
      refuse("contacts, " + contact.robot_body + " and " + contact.other_body +
             ": force_N = " + std::to_string(contact.force_N) + " N, must be >= 0 N");
    }
  }
}

void Judge::start(const WorldObservation& observation) {
  has_started_ = true;
  report_.start_time_s = observation.time_s;
  report_.bricks_total = static_cast<int>(observation.bricks.size());
  report_.bricks_pickable =
      static_cast<int>(std::count_if(observation.bricks.begin(), observation.bricks.end(),
                                     [](const BrickObservation& brick) { return brick.is_pickable; }));
  counted_base_xy_m_ = observation.base_xy_m;
  region_.min_xy_m.setConstant(std::numeric_limits<double>::infinity());
  region_.max_xy_m = -region_.min_xy_m;
  for (const BrickObservation& brick : observation.bricks) {
    const Eigen::Vector2d reach_m =
        (0.5 * brick.T_map_brick.linear().cwiseAbs() * brick.size_m).head<2>().array() + config_.score.region_margin_m;
    const Eigen::Vector2d center_m = brick.T_map_brick.translation().head<2>();
    region_.min_xy_m = region_.min_xy_m.cwiseMin(center_m - reach_m);
    region_.max_xy_m = region_.max_xy_m.cwiseMax(center_m + reach_m);
  }
}

void Judge::count(const std::vector<JudgeEvent>& events) {
  events_.insert(events_.end(), events.begin(), events.end());
}

std::vector<Eigen::Vector3d> Judge::lookouts(const PileTruth& truth) const {
  const LookoutConfig& config = config_.lookouts;
  const double height_m = config_.pile.ground_height_m + config.height_m;
  const Eigen::Vector2d margin_m = Eigen::Vector2d::Constant(config.margin_m - config_.score.region_margin_m);
  const Eigen::Vector2d low_m = region_.min_xy_m - margin_m;
  const Eigen::Array2i steps = ((region_.max_xy_m + margin_m - low_m) / config.spacing_m).array().floor().cast<int>();
  std::vector<Eigen::Vector3d> eyes_map;
  for (int i = 0; i <= steps.x(); ++i) {
    for (int j = 0; j <= steps.y(); ++j) {
      const Eigen::Vector2d xy_m = low_m + config.spacing_m * Eigen::Vector2d(i, j);
      const bool is_free = std::none_of(truth.bricks.begin(), truth.bricks.end(), [&](const PileBrick& brick) {
        const double reach_m = 0.5 * brick.size_m.norm() + config.clearance_m;
        return (brick.T_map_brick.translation().head<2>() - xy_m).squaredNorm() < reach_m * reach_m;
      });
      if (is_free) eyes_map.emplace_back(xy_m.x(), xy_m.y(), height_m);
    }
  }
  return eyes_map;
}

void Judge::renewTruth(const WorldObservation& observation) {
  if (!truths_.empty() && observation.time_s - truth_checked_s_ < config_.truth_period_s) {
    return;
  }
  truth_checked_s_ = observation.time_s;
  std::vector<PileBrick> bricks;
  for (const BrickObservation& brick : observation.bricks) {
    if (isInPile(brick.status)) {
      bricks.push_back({brick.id, brick.T_map_brick, brick.size_m, falls_.isAtRest(brick.id)});
    }
  }
  if (!pile_.update(bricks) && !truths_.empty()) {
    return;
  }
  truths_.push_back({observation.time_s, pile_.truth()});
  while (truths_.size() > 1 && truths_[1].time_s <= observation.time_s - config_.surface_history_s) {
    truths_.pop_front();
  }
  const PileTruth& truth = *pile_.truth();
  const std::vector<Eigen::Vector3d> eyes_map = lookouts(truth);
  for (const PileTruth::Sample& sample : truth.exposed) {
    Ledger& ledger = ledgers_[sample.brick_id];
    if (ledger.was_exposed.empty()) {
      ledger.was_exposed.resize(pile_.samplesOf(sample.brick_id).size());
      ledger.was_coverable.resize(ledger.was_exposed.size());
      ledger.was_covered.resize(ledger.was_exposed.size());
    }
    if (!ledger.was_exposed[sample.index]) {
      ledger.was_exposed[sample.index] = true;
      report_.exposed_area_m2 += sample.area_m2;
    }
    if (!ledger.was_coverable[sample.index] &&
        std::any_of(eyes_map.begin(), eyes_map.end(), [&](const Eigen::Vector3d& eye_map) {
          return isVisibleFrom(eye_map, sample, truth, config_.pile.max_view_angle_rad);
        })) {
      ledger.was_coverable[sample.index] = true;
      report_.coverable_area_m2 += sample.area_m2;
      if (ledger.was_covered[sample.index]) report_.covered_area_m2 += sample.area_m2;
    }
  }
}

void Judge::renewObstacles(const WorldObservation& observation) {
  const auto is_same = [](const Obstacle& a, const Obstacle& b) { return a.index == b.index && a.xy_map == b.xy_map; };
  if (obstacles_.empty() ||
      !std::equal(observation.obstacles.begin(), observation.obstacles.end(), obstacles_.back().obstacles.begin(),
                  obstacles_.back().obstacles.end(), is_same)) {
    obstacles_.push_back({observation.time_s, observation.obstacles});
  }
  while (obstacles_.size() > 1 && obstacles_[1].time_s <= observation.time_s - config_.surface_history_s) {
    obstacles_.pop_front();
  }
}

void Judge::noteMoved(const WorldObservation& observation) {
  for (const BrickObservation& brick : observation.bricks) {
    const Eigen::Vector3d& p_map = brick.T_map_brick.translation();
    Moved& moved = moved_.try_emplace(brick.id, Moved{p_map}).first->second;
    if (brick.status == BrickStatus::kMovedByHand) moved.start_map = p_map;
    if (brick.status != BrickStatus::kInPile || observation.target_id == brick.id) continue;
    moved.distance_m = (p_map - moved.start_map).norm();
  }
}

void Judge::drive(const Eigen::Vector2d& base_xy_m) {
  const double step_m = (base_xy_m - counted_base_xy_m_).norm();
  if (step_m >= config_.min_step_m) {
    report_.totals.distance_m += step_m;
    counted_base_xy_m_ = base_xy_m;
  }
}

void Judge::observe(const WorldObservation& observation) {
  check(observation);
  if (!has_started_) {
    start(observation);
  }
  time_s_ = observation.time_s;
  const std::size_t num_events_before = events_.size();
  for (const BrickObservation& brick : observation.bricks) {
    if (brick.status != BrickStatus::kStowed) {
      stowed_ids_.erase(brick.id);
    } else if (stowed_ids_.insert(brick.id).second) {
      JudgeEvent event;
      event.kind = JudgeEventKind::kStow;
      event.time_s = time_s_;
      event.brick_id = brick.id;
      events_.push_back(event);
    }
  }
  count(falls_.observe(observation));
  count(collisions_.observe(observation));
  drive(observation.base_xy_m);
  noteMoved(observation);
  renewTruth(observation);
  renewObstacles(observation);
  if (history_.empty() || events_.size() > num_events_before ||
      time_s_ - history_.back().time_s >= config_.row_period_s) {
    history_.push_back(totals());
  }
}

SurfaceVerdict Judge::judgeSurface(const StrategySurface& surface) {
  surface.check();
  if (!has_started_) {
    throw std::invalid_argument("Judge: a surface before the first observation has no truth to be judged by");
  }
  if (surface.stamp_s < time_s_ - config_.surface_history_s || surface.stamp_s < truths_.front().time_s) {
    ++report_.surfaces_refused;
    return SurfaceVerdict::kOutsideOfHistory;
  }
  ++report_.surfaces_judged;
  auto at = truths_.rbegin();
  while (at->time_s > surface.stamp_s) ++at;
  const PileTruth& truth = *at->truth;
  auto obstacles = obstacles_.rbegin();
  while (obstacles->time_s > surface.stamp_s && std::next(obstacles) != obstacles_.rend()) ++obstacles;

  std::vector<const PileTruth::Sample*> open;
  std::vector<Eigen::Vector3d> points_map;
  for (const PileTruth::Sample& sample : truth.exposed) {
    if (!ledgers_.at(sample.brick_id).was_covered[sample.index]) {
      open.push_back(&sample);
      points_map.push_back(sample.p_map);
    }
  }
  const std::vector<bool> is_near = isNearSurface(points_map, surface, config_.score.tolerance_m);
  for (std::size_t i = 0; i < open.size(); ++i) {
    if (is_near[i]) {
      Ledger& ledger = ledgers_.at(open[i]->brick_id);
      ledger.was_covered[open[i]->index] = true;
      if (ledger.was_coverable[open[i]->index]) report_.covered_area_m2 += open[i]->area_m2;
    }
  }
  const std::optional<double> precision = surfacePrecision(surface, truth.bricks, region_, config_.pile.ground_height_m,
                                                           config_.score, obstacles->obstacles, config_.pile.walls);
  if (precision) {
    report_.totals.precision = precision;
  }
  return SurfaceVerdict::kJudged;
}

void Judge::finish() {
  count(collisions_.finish());
  if (has_started_) {
    history_.push_back(totals());
  }
}

JudgeRow Judge::totals() const {
  JudgeRow row = report_.totals;
  row.time_s = time_s_;
  row.stowed = static_cast<int>(stowed_ids_.size());
  row.falls = falls_.falls();
  row.drops = falls_.drops();
  row.collisions = collisions_.collisions();
  row.load_contacts = collisions_.loadContacts();
  for (const auto& [id, moved] : moved_) row.disturbance_m += moved.distance_m;
  if (report_.coverable_area_m2 > 0.0) {
    row.coverage = report_.covered_area_m2 / report_.coverable_area_m2;
  }
  return row;
}

JudgeReport Judge::report() const {
  JudgeReport report = report_;
  report.totals = totals();
  report.max_collision_force_N = collisions_.maxForce();
  report.history = history_;
  report.events = events_;
  return report;
}

}  // namespace simulated_world
