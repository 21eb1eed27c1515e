// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/mission_types.h"

namespace pick_mission {

bool isAction(State state) {
  return state >= State::kPlanClear && state != State::kUnload;
}

bool isControl(const Command& command) {
  return std::holds_alternative<command::Cancel>(command.body) || std::holds_alternative<command::Hold>(command.body) ||
         std::holds_alternative<command::Release>(command.body);
}

std::string toString(const Result& result) {
  return std::visit(
      [](const auto& r) -> std::string {
        if constexpr (std::is_same_v<std::decay_t<decltype(r)>, NoAnswer>) {
          return "no answer";
        } else {
          return toString(r.status);
        }
      },
      result);
}

bool isSuccess(const Result& result) {
  return std::visit(
      [](const auto& r) {
        if constexpr (std::is_same_v<std::decay_t<decltype(r)>, NoAnswer>) {
          return false;
        } else {
          return static_cast<int>(r.status) == 0;
        }
      },
      result);
}

}  // namespace pick_mission
