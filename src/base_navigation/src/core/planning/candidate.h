// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>

#include "planning/plan_task.h"

namespace base_navigation {

/// A whole path. The footprint has the goal's padding on its first `tight_m` and its last `approach_m`.
struct Candidate {
  BasePath path;
  double tight_m{0.0};
  double approach_m{0.0};
  double cost_s{0.0};
};

Candidate assemble(const PlanTask& task, const Launch& launch, const Approach& approach, const Motions& middle);

struct Blocked {
  BasePath::Sample sample;
  const FootprintChecker* by;
};

/// The last check: the first pose from `from_m` on that is not free, or at which `stop` says so, at double the density of
/// all other checks. `tight` holds on the first `tight_start_m` and the last `tight_end_m`, `roomy` between.
std::optional<Blocked> firstBlocked(const BasePath& path, double tight_start_m, double tight_end_m, double from_m,
                                    const FootprintChecker& tight, const FootprintChecker& roomy,
                                    const std::function<bool()>& stop);
bool isWholeFree(const PlanTask& task, const Candidate& candidate);

/// Keeps the fastest of the paths offered that stand the last check.
class BestPath {
 public:
  explicit BestPath(const PlanTask& task) : task_(task) {}

  /// False: it does not stand the check.
  bool offer(const Candidate& candidate);
  const std::optional<Candidate>& best() const { return best_; }

 private:
  const PlanTask& task_;
  std::optional<Candidate> best_;
};

}  // namespace base_navigation
