// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/base_planner.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <utility>
#include <vector>

#include "planning/stages.h"

namespace base_navigation {
namespace {

bool isThere(const PlanTask& task) {
  return away_m(task.start_map, task.goal_map) <= task.config.position_tolerance_m &&
         away_rad(task.start_map, task.goal_map) <= task.config.yaw_tolerance_rad;
}

void tryStraightLine(const PlanTask& task, BestPath* best) {
  const Pose2d goal_start = compose(inverse(task.start_map), task.goal_map);
  if (std::abs(goal_start.y_m) > kExact_m || std::abs(goal_start.yaw_rad) > kExact_rad) return;
  const double length_m = std::abs(goal_start.x_m);
  Candidate candidate;
  candidate.path = {task.start_map, {{goal_start.x_m, 0.0}}};
  candidate.approach_m = std::min(length_m, task.config.approach_m);
  const std::optional<double> tight_m = tightLength(task, goal_start.x_m > 0.0 ? 1 : -1);
  candidate.tight_m = std::min(tight_m.value_or(task.config.max_back_off_m), length_m);
  // Backwards is slow: far behind, turning round may be faster, and is for the search to find out.
  const bool is_sure = goal_start.x_m > 0.0 || length_m <= task.config.max_back_off_m;
  if (is_sure) best->offer(candidate);
}

/// Straight out, straight to the goal, and what is between. Why there is no path, if there is none.
PlanFailure search(const PlanTask& task, BestPath* best, int* iterations) {
  tryStraightLine(task, best);
  if (best->best()) return {};
  const Result<Approach> approach = findApproach(task);
  if (!approach) return approach.failure();
  const Result<std::vector<Launch>> launches = findLaunches(task);
  if (!launches) return launches.failure();
  return searchBetween(task, *launches, *approach, best, iterations);
}

BasePlan failed(const PlanTask& task, PlanFailure why, int iterations = 0) {
  BasePlan plan;
  plan.status = why.status;
  plan.message = std::move(why.message);
  plan.path.start = task.start_map;
  plan.iterations = iterations;
  return plan;
}

BasePlan solved(const PlanTask& task, const Candidate& candidate, int iterations) {
  BasePlan plan;
  plan.status = BasePlanStatus::kSolved;
  plan.path = candidate.path;
  plan.tight_start_m = candidate.tight_m;
  plan.tight_end_m = candidate.approach_m;
  plan.duration_s = duration(candidate.path, task.limits);
  plan.iterations = iterations;
  return plan;
}

void requireGrid(const std::shared_ptr<const NavigationGrid>& grid) {
  if (!grid) throw std::invalid_argument("grid: none given");
  if (grid->width < 0 || grid->height < 0 || !(grid->cell_size_m > 0.0) ||
      grid->state.size() != static_cast<std::size_t>(grid->width) * static_cast<std::size_t>(grid->height)) {
    throw std::invalid_argument("grid: " + std::to_string(grid->state.size()) + " cells of " +
                                std::to_string(grid->cell_size_m) + " m, must be " + std::to_string(grid->width) +
                                " x " + std::to_string(grid->height) + " of a positive size");
  }
}

void requireFinite(const char* what, const Pose2d& pose) {
  if (std::isfinite(pose.x_m) && std::isfinite(pose.y_m) && std::isfinite(pose.yaw_rad)) return;
  std::ostringstream out;
  out << what << " = (" << pose.x_m << " m, " << pose.y_m << " m, " << pose.yaw_rad << " rad), must be finite";
  throw std::invalid_argument(out.str());
}

/// The part of the grid within `reach_m` of the path from `from_m` on: a checker looks at all cells of its grid beforehand.
std::shared_ptr<const NavigationGrid> around(const BasePath& path, double from_m, double reach_m,
                                             const NavigationGrid& grid) {
  Eigen::AlignedBox2d box(path.end().position());
  for (const BasePath::Sample& sample : path.sample(grid.cell_size_m, reach_m)) {
    if (sample.at_m >= from_m) box.extend(sample.pose.position());
  }
  // A cell more for the step between samples, and one for rounding.
  const Eigen::Vector2d room = Eigen::Vector2d::Constant(reach_m + 2.0 * grid.cell_size_m);
  const Eigen::Vector2i low = grid.cellOf(box.min() - room).cwiseMax(0);
  const Eigen::Vector2i high = grid.cellOf(box.max() + room).cwiseMin(Eigen::Vector2i(grid.width - 1, grid.height - 1));
  NavigationGrid part;
  part.cell_size_m = grid.cell_size_m;
  part.origin_m = grid.origin_m + grid.cell_size_m * low.cast<double>();
  part.width = std::max(0, high.x() - low.x() + 1);
  part.height = std::max(0, high.y() - low.y() + 1);
  part.state.reserve(static_cast<std::size_t>(part.width) * part.height);
  for (int row = low.y(); part.width > 0 && row <= high.y(); ++row) {
    const auto begin = grid.state.begin() + static_cast<std::ptrdiff_t>(grid.index(low.x(), row));
    part.state.insert(part.state.end(), begin, begin + part.width);
  }
  return std::make_shared<const NavigationGrid>(std::move(part));
}

}  // namespace

BasePlanner::BasePlanner(const BasePlannerConfig& config, const MotionLimits& limits, Polygon footprint)
    : config_(config), limits_(limits), footprint_(std::move(footprint)) {
  std::vector<std::string> problems = interactive_mapping::problemsOf(config_);
  for (const std::string& problem : limits_.validate()) problems.push_back(problem);
  interactive_mapping::refuseIfAny("impossible planner:", problems);
  padPolygon(footprint_, config_.padding_m);  // throws for what is no footprint
  inscribedRadius(footprint_);
}

BasePlan BasePlanner::plan(std::shared_ptr<const NavigationGrid> grid, const Pose2d& start_map, const Pose2d& goal_map,
                           const std::function<bool()>& is_cancelled) const {
  requireGrid(grid);
  requireFinite("start", start_map);
  requireFinite("goal", goal_map);
  const PlanTask task(config_, limits_, footprint_, grid, start_map, goal_map, is_cancelled);
  const PlanFailure cancelled{BasePlanStatus::kCancelled, "cancelled"};
  if (task.isCancelled()) return failed(task, cancelled);
  if (isThere(task)) return solved(task, {{start_map, {}}}, 0);
  if (const auto blocked = blockedEnd(task)) return failed(task, *blocked);
  BestPath best(task);
  int iterations = 0;
  const PlanFailure why = search(task, &best, &iterations);
  if (task.isCancelled()) return failed(task, cancelled, iterations);
  return best.best() ? solved(task, *best.best(), iterations) : failed(task, why, iterations);
}

FootprintVerdict BasePlanner::recheck(const BasePlan& plan, double from_m,
                                      std::shared_ptr<const NavigationGrid> grid) const {
  requireGrid(grid);
  if (!std::isfinite(from_m)) {
    throw std::invalid_argument("from = " + std::to_string(from_m) + " m along the path, must be finite");
  }
  if (plan.path.motions.empty()) return {};
  const double padding_m = std::max(config_.padding_m, config_.goal_padding_m);
  grid = around(plan.path, from_m, circumscribedRadius(padPolygon(footprint_, padding_m)), *grid);
  const FootprintChecker tight(grid, footprint_, config_.goal_padding_m);
  const FootprintChecker roomy(std::move(grid), footprint_, config_.padding_m);
  const std::optional<Blocked> blocked =
      firstBlocked(plan.path, plan.tight_start_m, plan.tight_end_m, from_m, tight, roomy, [] { return false; });
  if (!blocked) return {};
  FootprintVerdict verdict = blocked->by->check(blocked->sample.pose);
  verdict.at_m = blocked->sample.at_m;
  return verdict;
}

}  // namespace base_navigation
