// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "pick_mission/mission_types.h"

namespace pick_mission {

/// Whether `upper` lies on `lower`, upright or leaning: lowered by 3 cm it would cut it, though it is 5 mm shorter on each
/// side than it is (what poses are wrong by; a corner that only just reaches over carries nothing). False for a brick
/// without a size.
bool restsOn(const SeenBrick& upper, const SeenBrick& lower);

}  // namespace pick_mission
