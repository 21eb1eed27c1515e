// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "motion_planning/arm_kinematics.h"
#include "motion_planning/collision_checker.h"

namespace motion_planning {

/// For each joint how far from its axis a point of the arm, or of what is held, can be in any posture [m]. No point moves
/// farther than reach * |dq| between two postures.
ArmVector armReach(const ArmKinematics& arm, const std::optional<HeldBrick>& held);

}  // namespace motion_planning
