// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tasks/start_state.h"
#include "tasks/task_context.h"

/// What MotionPlanner's methods do once the start is known. A trajectory begins at the start state.
namespace motion_planning {

PickResult planPick(const TaskContext& task, const StartState& start, const PickTarget& target,
                    const std::vector<ArmGoal>& stow_goals);

/// By search; where that fails for what is held, straight out of its surroundings first.
Result<JointTrajectory> planMove(const TaskContext& task, const StartState& start, const ArmGoal& goal);

/// Out of the camera's view: to the first of `postures` that qualifies, else to one found by sampling.
Result<JointTrajectory> planClearView(const TaskContext& task, const StartState& start, const ViewFrustum& view,
                                      const std::vector<ArmVector>& postures);

}  // namespace motion_planning
