// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tasks/task_context.h"

namespace motion_planning {

/// Where a task begins.
struct StartState {
  ArmVector joints_rad;      // the request's start, or the end of `back_off`
  JointPath back_off;        // straight from where surface is too near: a face the empty magnet touches, or a margin
  CollisionChecker checker;  // knows what is held and the vacated place; the start is not in unknown space
  bool is_among_others;      // what is held touches its neighbours there, as in a lift
  Contact wedged;            // ... and overlaps them by more than a lift allows: the arm may only go straight out

  JointTrajectory withBackOff(const TaskContext& task, const JointTrajectory& trajectory) const;
};

/// Checks what all tasks ask of a request, and that the arm may be at its start.
Result<StartState> findStart(const TaskContext& task);

}  // namespace motion_planning
