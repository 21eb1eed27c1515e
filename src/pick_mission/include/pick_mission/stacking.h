// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "pick_mission/mission_types.h"

namespace pick_mission {

/// Whether `upper` lies on `lower`, upright or leaning: lowered by 3 cm it would cut it. The test takes 5 mm off each
/// of its sides, the error of poses. A corner that only just reaches over carries nothing. False for a brick without a
/// size.
bool restsOn(const SeenBrick& upper, const SeenBrick& lower);

}  // namespace pick_mission
