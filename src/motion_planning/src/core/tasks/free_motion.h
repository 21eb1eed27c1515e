// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "tasks/carry_tilt.h"

namespace motion_planning {

struct FreeMotion {
  JointTrajectory trajectory;
  std::size_t goal;  // index of the goal that it reaches
};

/// Searches a path from `start` to any of the goals, rounds its corners as far as it stays free, and times it. `checker`
/// knows what is held. `what`: begins the sentence of a failure.
Result<FreeMotion> moveTo(const TaskContext& task, const ArmVector& start, const std::vector<ArmVector>& goals,
                          const CollisionChecker& checker, const Tilt& tilt, const std::string& what);

}  // namespace motion_planning
