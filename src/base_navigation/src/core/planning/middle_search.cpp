// SPDX-License-Identifier: BSD-3-Clause
#include "planning/stages.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "base_navigation/distance_field.h"
#include "text.h"

namespace base_navigation {
namespace {

constexpr int kRuns = 3;            // of RRTConnect, which share the iterations
constexpr double kAhead_rad = 0.2;  // a goal in this cone is reached without backing off first, if it can be

/// Dijkstra's way, and the cells that it reached.
struct Ground {
  Guide guide;
  Eigen::Vector2d nearest_map;  // of the cells, to the end of the way
};

Ground reachableGround(const PlanTask& task, const Eigen::Vector2d& from_map, const Eigen::Vector2d& to_map) {
  const NavigationGrid& grid = task.grid;
  // Dijkstra's cells are asked at their middles, up to half a diagonal beside the base: a radius smaller by so much
  // misses no way that there is.
  const double slack_m = std::sqrt(0.5) * grid.cell_size_m;
  const DistanceField field(grid, from_map, std::max(0.0, inscribedRadius(task.footprint) - slack_m));
  Ground ground{{field.pathTo(to_map), {}}, from_map};
  double nearest_m = std::numeric_limits<double>::infinity();
  for (int row = 0; row < grid.height; ++row) {
    for (int column = 0; column < grid.width; ++column) {
      const Eigen::Vector2d p_map = grid.centerOf(column, row);
      if (!std::isfinite(field.distance(p_map))) continue;
      ground.guide.places_map.push_back(p_map);
      const double beside_m = (p_map - to_map).norm();
      if (beside_m >= nearest_m) continue;
      nearest_m = beside_m;
      ground.nearest_map = p_map;
    }
  }
  return ground;
}

/// The motions between launch and approach.
class MiddleSearch {
 public:
  MiddleSearch(const PlanTask& task, const Approach& approach, BestPath* best)
      : task_(task), approach_(approach), best_(*best) {}

  /// A goal ahead, almost in line, needs no back-off even where the base could not turn round.
  void tryAhead() {
    if (!task_.roomy.isFree(task_.start_map)) return;
    const Pose2d approach_start = compose(inverse(task_.start_map), approach_.pose_map);
    if (approach_start.x_m < 0.0 || std::abs(approach_start.yaw_rad) > kAhead_rad ||
        std::abs(std::atan2(approach_start.y_m, approach_start.x_m)) > kAhead_rad) {
      return;
    }
    const Launch launch{0.0, 0.0, task_.start_map};
    if (const auto middle = connectDirectly(launch, true)) offer(launch, *middle);
  }

  /// By one connection, by turning and driving along Dijkstra's way, by RRTConnect with an `n`th of the iterations.
  /// Nothing: a path is known, this one or an earlier one, or it was cancelled.
  std::optional<PlanFailure> search(const Launch& launch, std::size_t n) {
    if (const auto direct = connectDirectly(launch, false)) {
      const bool is_forward = std::none_of(direct->begin(), direct->end(), isReverse);
      if (offer(launch, *direct) && is_forward) return std::nullopt;
    }
    const Ground ground = reachableGround(task_, launch.pose_map.position(), approach_.pose_map.position());
    if (ground.guide.way_map.empty() || ground.guide.places_map.empty()) {
      return failure(BasePlanStatus::kNoPath, "no path over free ground", launch,
                     ": it ends at " + text(ground.nearest_map));
    }
    if (task_.isCancelled()) return std::nullopt;
    const std::optional<Motions> turns = turnAndDrive(launch.pose_map);
    const bool has_wide = turns && offer(launch, *turns);
    const int iterations = task_.config.max_iterations / static_cast<int>(n) / kRuns;
    for (int run = 0; run < (has_wide ? 1 : kRuns) && !task_.isCancelled(); ++run) {
      const Growth growth =
          growTrees(task_, launch.pose_map, approach_.pose_map, ground.guide, std::max(1, iterations), &random_);
      iterations_ += growth.iterations;
      if (growth.motions) offer(launch, *growth.motions);
    }
    if (best_.best()) return std::nullopt;
    return failure(BasePlanStatus::kIterations, "no path found", launch,
                   " within " + std::to_string(iterations_) + " iterations");
  }

  int iterations() const { return iterations_; }

 private:
  /// Shortened; as it is, if that does not stand the last check.
  bool offer(const Launch& launch, const Motions& middle) {
    const Motions shortened = shorten(task_, connections_, launch, approach_, middle, &random_);
    return best_.offer(assemble(task_, launch, approach_, shortened)) ||
           best_.offer(assemble(task_, launch, approach_, middle));
  }

  /// The best valid connection from the launch to the approach.
  std::optional<Motions> connectDirectly(const Launch& launch, bool forward_only) const {
    std::vector<std::pair<double, Motions>> ways;
    for (Motions& motions : connections_.between(launch.pose_map, approach_.pose_map)) {
      if (forward_only && std::any_of(motions.begin(), motions.end(), isReverse)) continue;
      const double cost_s = assemble(task_, launch, approach_, motions).cost_s;
      ways.emplace_back(cost_s, std::move(motions));
    }
    std::stable_sort(ways.begin(), ways.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (auto& [cost_s, motions] : ways) {
      if (task_.isFree(launch.pose_map, motions)) return std::move(motions);
    }
    return std::nullopt;
  }

  /// Turn, drive, turn, ... along Dijkstra's way for the circle in which the base can turn; nothing if there is none, or a
  /// piece of it is not free, which happens only about ends where it cannot turn.
  std::optional<Motions> turnAndDrive(const Pose2d& from_map) const {
    const DistanceField wide(task_.grid, from_map.position(), task_.roomy.circumscribedRadius());
    std::vector<Eigen::Vector2d> places = wide.pathTo(approach_.pose_map.position());
    if (places.empty()) return std::nullopt;
    places.push_back(approach_.pose_map.position());
    Motions motions;
    Pose2d here = from_map;
    const auto driveTo = [&](std::size_t k) {
      const Eigen::Vector2d way = places[k] - here.position();
      const double heading_rad = way.norm() < kNothing ? here.yaw_rad : std::atan2(way.y(), way.x());
      return turnDriveTurn(here, {places[k].x(), places[k].y(), heading_rad}, true);
    };
    for (std::size_t next = 0; next < places.size();) {
      if (task_.isCancelled()) return std::nullopt;
      // The farthest place in one straight line: steps that double, then halve.
      std::size_t reached = next;
      if (!task_.isFree(here, driveTo(next))) return std::nullopt;
      for (std::size_t stride = 1; stride > 0;) {
        const std::size_t to = std::min(reached + stride, places.size() - 1);
        if (to > reached && task_.isFree(here, driveTo(to))) {
          reached = to;
          stride *= 2;
        } else {
          stride /= 2;
        }
      }
      const Motions drive = driveTo(reached);
      motions.insert(motions.end(), drive.begin(), drive.end());
      here = follow(here, drive);
      next = reached + 1;
    }
    const Motions last = {{0.0, wrapAngle(approach_.pose_map.yaw_rad - here.yaw_rad)}};
    if (!task_.isFree(here, last)) return std::nullopt;
    motions.push_back(last.front());
    return motions;
  }

  PlanFailure failure(BasePlanStatus status, const char* what, const Launch& launch, const std::string& detail) const {
    return {status, std::string(what) + " from " + text(launch.pose_map.position()) + " to " +
                        text(approach_.pose_map.position()) + " before the goal" + detail};
  }

  const PlanTask& task_;
  const Approach& approach_;
  BestPath& best_;
  const Connections connections_{task_.config.turn_radius_m};
  interactive_mapping::Random random_{task_.config.seed};
  int iterations_{0};
};

}  // namespace

PlanFailure searchBetween(const PlanTask& task, const std::vector<Launch>& launches, const Approach& approach,
                          BestPath* best, int* iterations) {
  MiddleSearch middle(task, approach, best);
  middle.tryAhead();
  if (best->best()) return {};
  std::optional<PlanFailure> failure;
  for (const Launch& launch : launches) {
    auto why = middle.search(launch, launches.size());
    // A search that found nothing says more than ground that ends.
    if (why && (!failure || why->status == BasePlanStatus::kIterations)) failure = std::move(why);
  }
  *iterations = middle.iterations();
  return failure.value_or(PlanFailure{});
}

}  // namespace base_navigation
