// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/mission_types.h"

#include "enum_names.h"

namespace pick_mission {

const char* toString(SelectionStatus status) {
  static constexpr const char* kNames[] = {"success",     "cancelled",   "bad goal",  "stale map", "stale ground",
                                           "no pose",     "empty map",   "no ground", "no pile",   "no candidate",
                                           "low utility", "map changed", "bad input"};
  return nameOf<kNumSelectionStatus>(kNames, status);
}

const char* toString(DetectionStatus status) {
  static constexpr const char* kNames[] = {"success", "no image", "refused", "shutting down"};
  return nameOf<kNumDetectionStatus>(kNames, status);
}

const char* toString(LookStatus status) {
  static constexpr const char* kNames[] = {"success", "cancelled", "no image"};
  return nameOf<kNumLookStatus>(kNames, status);
}

const char* toString(WaitStatus status) {
  static constexpr const char* kNames[] = {"success", "cancelled", "not ready"};
  return nameOf<kNumWaitStatus>(kNames, status);
}

const char* toString(ReportStatus status) {
  static constexpr const char* kNames[] = {"success", "refused"};
  return nameOf<kNumReportStatus>(kNames, status);
}

const char* toString(Hand hand) {
  static constexpr const char* kNames[] = {"empty", "holding", "unknown"};
  return nameOf(kNames, hand);
}

const char* toString(State state) {
  static constexpr const char* kNames[] = {"idle",       "paused", "held",   "halting", "ended",  "begin",     "choose",
                                           "plan_clear", "clear",  "look",   "detect",  "report", "plan_pick", "pick",
                                           "plan_stow",  "stow",   "let_go", "select",  "drive",  "recover",   "wait"};
  return nameOf<kNumStates>(kNames, state);
}

bool isAction(State state) {
  return state >= State::kPlanClear;
}

const char* toString(EndReason reason) {
  static constexpr const char* kNames[] = {
      "none",         "no_brick_left",    "bricks_exhausted", "nothing_worth_going", "no_progress",     "time_up",
      "stopped",      "needs_person",     "brick_in_hand",    "planning_failed",     "arm_failed",      "picks_failed",
      "looks_failed", "detection_failed", "selection_failed", "drives_failed",       "recovery_failed", "not_ready"};
  return nameOf<kNumEndReasons>(kNames, reason);
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
