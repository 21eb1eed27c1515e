// SPDX-License-Identifier: BSD-3-Clause
#include "planning/stages.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <ompl/datastructures/NearestNeighborsLinear.h>

#include <interactive_mapping_common/search/rrt_connect.h>

namespace base_navigation {
namespace {

namespace ob = ompl::base;
using interactive_mapping::Random;

constexpr double kRange_m = 1.5;          // one growth of a tree
constexpr double kGuided = 0.6;           // share of samples drawn about Dijkstra's way
constexpr double kGuideSpread_m = 0.25;   // standard deviation from the way
constexpr double kGuideSpread_rad = 0.4;  // and from its heading
constexpr double kGuideReversed = 0.2;    // share of these that go backwards

void draw(const Guide& guide, double cell_size_m, Random* random, const ob::StateSpace* space, ob::State* state) {
  auto* se2 = state->as<ob::SE2StateSpace::StateType>();
  if (random->uniform01() < kGuided && guide.way_map.size() > 1) {
    const std::size_t i = random->index(guide.way_map.size());
    const Eigen::Vector2d ahead =
        guide.way_map[std::min(i + 4, guide.way_map.size() - 1)] - guide.way_map[i < 4 ? 0 : i - 4];
    const double reversed_rad = random->uniform01() < kGuideReversed ? M_PI : 0.0;
    se2->setXY(guide.way_map[i].x() + kGuideSpread_m * random->normal(),
               guide.way_map[i].y() + kGuideSpread_m * random->normal());
    se2->setYaw(wrapAngle(std::atan2(ahead.y(), ahead.x()) + reversed_rad + kGuideSpread_rad * random->normal()));
    space->enforceBounds(state);
    return;
  }
  const Eigen::Vector2d& place = guide.places_map[random->index(guide.places_map.size())];
  const double half_m = 0.5 * cell_size_m;
  se2->setXY(place.x() + random->uniform(-half_m, half_m), place.y() + random->uniform(-half_m, half_m));
  se2->setYaw(random->uniform(-M_PI, M_PI));
}

/// Linear search, as exact, and with no generator of its own (OMPL's default draws its pivots from the shared one). No curve
/// is shorter than the straight line, which is asked first: it spares most of the expensive distances.
template <typename T>
class NearestByCurve : public ompl::NearestNeighborsLinear<T> {
 public:
  T nearest(const T& wanted) const override {
    const auto& data = this->data_;
    if (data.empty()) throw std::logic_error("nearest of none");
    const Pose2d p = fromOmpl(wanted->state);
    std::size_t best = 0;
    double straight_best = std::numeric_limits<double>::infinity();
    straight_.resize(data.size());
    for (std::size_t i = 0; i < data.size(); ++i) {
      straight_[i] = away_m(fromOmpl(data[i]->state), p);
      if (straight_[i] >= straight_best) continue;
      straight_best = straight_[i];
      best = i;
    }
    double shortest = this->distFun_(data[best], wanted);
    const std::size_t first = best;
    for (std::size_t i = 0; i < data.size(); ++i) {
      if (straight_[i] >= shortest || i == first) continue;
      const double curve = this->distFun_(data[i], wanted);
      if (curve >= shortest) continue;
      shortest = curve;
      best = i;
    }
    return data[best];
  }

 private:
  mutable std::vector<double> straight_;
};

}  // namespace

Growth growTrees(const PlanTask& task, const Pose2d& from_map, const Pose2d& to_map, const Guide& guide,
                 int max_iterations, Random* random) {
  const NavigationGrid& grid = task.grid;
  const double radius_m = task.config.turn_radius_m;
  const auto space = std::make_shared<ob::ReedsSheppStateSpace>(radius_m);
  ob::RealVectorBounds bounds(2);
  for (unsigned i = 0; i < 2; ++i) {
    const int cells = i == 0 ? grid.width : grid.height;
    bounds.setLow(i, grid.origin_m[i]);
    bounds.setHigh(i, grid.origin_m[i] + grid.cell_size_m * cells);
  }
  space->setBounds(bounds);

  interactive_mapping::TreeSearch search;
  search.is_valid = [&](const ob::State* state) { return task.isFree(fromOmpl(state)); };
  search.is_motion_valid = [&](const ob::State* from, const ob::State* to) {
    const Pose2d begin = fromOmpl(from);
    const Pose2d end = fromOmpl(to);
    const Motions motions = reedsShepp(*space, from, to, radius_m);
    return away_m(follow(begin, motions), end) <= kSamePlace && task.isFree(end) && task.isFree(begin, motions);
  };
  search.sample = [&](const ob::StateSpace* of, ob::State* state) { draw(guide, grid.cell_size_m, random, of, state); };
  search.is_cancelled = [&] { return task.isCancelled(); };
  search.range = kRange_m;
  search.max_iterations = max_iterations;

  const OmplPose first = toOmpl(space, from_map);
  const OmplPose last = toOmpl(space, to_map);
  for (const ob::State* state : {first.get(), last.get()}) {
    if (!space->satisfiesBounds(state) || !search.is_valid(state)) return {};
  }
  const auto found = interactive_mapping::connectByTrees<NearestByCurve>(space, first.get(), {last.get()}, search);
  Growth growth;
  growth.iterations = found.iterations;
  if (!found.path) return growth;
  growth.motions.emplace();
  for (unsigned k = 0; k + 1 < found.path->getStateCount(); ++k) {
    const Motions curve = reedsShepp(*space, found.path->getState(k), found.path->getState(k + 1), radius_m);
    growth.motions->insert(growth.motions->end(), curve.begin(), curve.end());
  }
  return growth;
}

}  // namespace base_navigation
