// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "pick_mission/mission_types.h"
#include "pick_mission/transitions.h"

namespace pick_mission {

/// What a result of an action leads to.
struct Reaction {
  Trigger next{Trigger::kDone};
  bool counts_in_a_row{false};          // as a failure of this kind of action; too many end the mission
  bool blames_brick{false};             // uses up one of its attempts
  bool is_reported{false};              // to the selection: places near are less wanted
  EndReason end{EndReason::kNotEnded};  // if it is given up, at once or after too many in a row
  std::string why;                      // next, in words
};

/// For every action and every result that it can have; that it cannot have: std::invalid_argument.
Reaction reactTo(State action, const Result& result);

/// Every result that an action can have, NoAnswer too; empty for states that are none.
std::vector<Result> possibleResults(State action);

/// All of reactTo() as Markdown.
std::string reactionsAsMarkdown();

}  // namespace pick_mission
