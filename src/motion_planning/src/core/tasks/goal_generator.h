// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tasks/carry_tilt.h"

namespace motion_planning {

/// Free postures that reach the goal, nearest to `near` first, about pick/max_goals at most. `checker` knows what is held.
/// At least one, or the reason why none does.
Result<std::vector<ArmVector>> findGoals(const TaskContext& task, const ArmGoal& goal, const ArmVector& near,
                                         const CollisionChecker& checker, const Tilt& tilt);

}  // namespace motion_planning
