// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mission.h"
#include "pick_mission/transitions.h"

namespace pick_mission {

/// "text (message)", or the one that is not empty.
std::string withMessage(const std::string& text, const std::string& message);

/// Why `row` is taken from the mission's state: `reason`, its guard, and what comes next where neither tells that.
std::string reasonFor(const Transition& row, const std::string& reason, const Mission& mission);

/// Bricks that are neither picked nor given up, "; brick 3 is still there, ...". One that is not seen any more may lie
/// anywhere, or have been stowed by a pick whose end nobody told.
std::string leftInWords(const Mission& mission);

}  // namespace pick_mission
