// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "motion_planning/arm_kinematics.h"
#include "motion_planning/motion_planner.h"

namespace motion_planning {

/// Whether a link of the arm, the magnet or the held brick may be nearer than `clear_m` to the view's pyramid. Never
/// misses one; may name one that is just outside an edge of the pyramid (a shape counts as out if one of the pyramid's
/// planes has all of it on the far side).
bool blocksView(const ArmKinematics& arm, const ArmVector& joints_rad, const std::optional<HeldBrick>& held,
                const ViewFrustum& view, double clear_m);

}  // namespace motion_planning
