// SPDX-License-Identifier: BSD-3-Clause
#include "planning/candidate.h"

#include <utility>

namespace base_navigation {
namespace {

// Of two paths about as fast, the one that drives backwards less (the scanner does not see behind) and has fewer pieces.
constexpr double kBackwards_s = 2.0;  // each time anew
constexpr double kPiece_s = 0.05;

bool endsAt(const BasePath& path, const Pose2d& goal_map, double share) {
  const Pose2d end = path.end();
  return away_m(end, goal_map) <= share * kExact_m && away_rad(end, goal_map) <= share * kExact_rad;
}

}  // namespace

Candidate assemble(const PlanTask& task, const Launch& launch, const Approach& approach, const Motions& middle) {
  Candidate candidate;
  Motions& motions = candidate.path.motions;
  candidate.path.start = task.start_map;
  if (launch.length_m != 0.0) motions.push_back({launch.length_m, 0.0});
  motions.insert(motions.end(), middle.begin(), middle.end());
  motions.push_back({approach.length_m, 0.0});
  candidate.tight_m = launch.tight_m;
  candidate.approach_m = approach.length_m;
  BasePath tidied = candidate.path;
  tidied.tidy();
  if (endsAt(tidied, task.goal_map, 1.0)) candidate.path = std::move(tidied);
  candidate.cost_s = duration(candidate.path, task.limits) + kPiece_s * static_cast<double>(motions.size());
  for (std::size_t i = 0; i < middle.size(); ++i) {
    if (isReverse(middle[i]) && (i == 0 || !isReverse(middle[i - 1]))) candidate.cost_s += kBackwards_s;
  }
  return candidate;
}

std::optional<Blocked> firstBlocked(const BasePath& path, double tight_start_m, double tight_end_m, double from_m,
                                    const FootprintChecker& tight, const FootprintChecker& roomy,
                                    const std::function<bool()>& stop) {
  const double length_m = path.length();
  // The same poses whatever grid is asked: what was free is found free again.
  for (const BasePath::Sample& sample : path.sample(0.25 * roomy.grid().cell_size_m, roomy.circumscribedRadius())) {
    if (sample.at_m < from_m) continue;
    const bool is_tight = sample.at_m < tight_start_m - kNothing || sample.at_m > length_m - tight_end_m + kNothing;
    const FootprintChecker& checker = is_tight ? tight : roomy;
    if (stop() || !checker.isFree(sample.pose)) return Blocked{sample, &checker};
  }
  return std::nullopt;
}

bool isWholeFree(const PlanTask& task, const Candidate& candidate) {
  return !firstBlocked(candidate.path, candidate.tight_m, candidate.approach_m, 0.0, task.tight, task.roomy,
                       [&task] { return task.isCancelled(); });
}

bool BestPath::offer(const Candidate& candidate) {
  if (best_ && best_->cost_s <= candidate.cost_s) return true;
  if (!endsAt(candidate.path, task_.goal_map, 5.0) || !isWholeFree(task_, candidate)) return false;
  best_ = candidate;
  return true;
}

}  // namespace base_navigation
