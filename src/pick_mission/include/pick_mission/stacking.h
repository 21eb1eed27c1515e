// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "pick_mission/mission_types.h"

namespace pick_mission {

/// Whether `upper` lies on `lower`, upright or leaning: its middle is higher, and lowered by 3 cm it would cut `lower`.
/// The test takes 5 mm, the error of poses, off each side of `upper`: a corner that only just reaches over carries
/// nothing. False for a brick without a size.
bool restsOn(const SeenBrick& upper, const SeenBrick& lower);

}  // namespace pick_mission
