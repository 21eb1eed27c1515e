// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/mission_types.h"

namespace pick_mission {

const char* toString(SelectionStatus status) {
  switch (status) {
    case SelectionStatus::kSuccess:
      return "success";
    case SelectionStatus::kCancelled:
      return "cancelled";
    case SelectionStatus::kBadGoal:
      return "bad goal";
    case SelectionStatus::kStaleMap:
      return "stale map";
    case SelectionStatus::kStaleGround:
      return "stale ground";
    case SelectionStatus::kNoPose:
      return "no pose";
    case SelectionStatus::kEmptyMap:
      return "empty map";
    case SelectionStatus::kNoGround:
      return "no ground";
    case SelectionStatus::kNoPile:
      return "no pile";
    case SelectionStatus::kNoCandidate:
      return "no candidate";
    case SelectionStatus::kLowUtility:
      return "low utility";
    case SelectionStatus::kMapChanged:
      return "map changed";
    case SelectionStatus::kBadInput:
      return "bad input";
  }
  return "?";
}

const char* toString(DetectionStatus status) {
  switch (status) {
    case DetectionStatus::kSuccess:
      return "success";
    case DetectionStatus::kNoImage:
      return "no image";
    case DetectionStatus::kRefused:
      return "refused";
    case DetectionStatus::kShuttingDown:
      return "shutting down";
  }
  return "?";
}

const char* toString(LookStatus status) {
  switch (status) {
    case LookStatus::kSuccess:
      return "success";
    case LookStatus::kCancelled:
      return "cancelled";
    case LookStatus::kNoImage:
      return "no image";
  }
  return "?";
}

const char* toString(WaitStatus status) {
  switch (status) {
    case WaitStatus::kSuccess:
      return "success";
    case WaitStatus::kCancelled:
      return "cancelled";
    case WaitStatus::kNotReady:
      return "not ready";
  }
  return "?";
}

const char* toString(ReportStatus status) {
  switch (status) {
    case ReportStatus::kSuccess:
      return "success";
    case ReportStatus::kRefused:
      return "refused";
  }
  return "?";
}

const char* toString(Hand hand) {
  switch (hand) {
    case Hand::kEmpty:
      return "empty";
    case Hand::kHolding:
      return "holding";
    case Hand::kUnknown:
      return "unknown";
  }
  return "?";
}

const char* toString(State state) {
  switch (state) {
    case State::kIdle:
      return "idle";
    case State::kPaused:
      return "paused";
    case State::kHeld:
      return "held";
    case State::kHalting:
      return "halting";
    case State::kEnded:
      return "ended";
    case State::kBegin:
      return "begin";
    case State::kChoose:
      return "choose";
    case State::kPlanClear:
      return "plan_clear";
    case State::kClear:
      return "clear";
    case State::kLook:
      return "look";
    case State::kDetect:
      return "detect";
    case State::kReport:
      return "report";
    case State::kPlanPick:
      return "plan_pick";
    case State::kPick:
      return "pick";
    case State::kPlanStow:
      return "plan_stow";
    case State::kStow:
      return "stow";
    case State::kLetGo:
      return "let_go";
    case State::kSelect:
      return "select";
    case State::kDrive:
      return "drive";
    case State::kRecover:
      return "recover";
    case State::kWait:
      return "wait";
  }
  return "?";
}

bool isAction(State state) {
  return state >= State::kPlanClear;
}

const char* toString(EndReason reason) {
  switch (reason) {
    case EndReason::kNone:
      return "none";
    case EndReason::kNoBrickLeft:
      return "no_brick_left";
    case EndReason::kBricksExhausted:
      return "bricks_exhausted";
    case EndReason::kNothingWorthGoing:
      return "nothing_worth_going";
    case EndReason::kNoProgress:
      return "no_progress";
    case EndReason::kTimeUp:
      return "time_up";
    case EndReason::kStopped:
      return "stopped";
    case EndReason::kNeedsPerson:
      return "needs_person";
    case EndReason::kBrickInHand:
      return "brick_in_hand";
    case EndReason::kPlanningFailed:
      return "planning_failed";
    case EndReason::kArmFailed:
      return "arm_failed";
    case EndReason::kPicksFailed:
      return "picks_failed";
    case EndReason::kLooksFailed:
      return "looks_failed";
    case EndReason::kDetectionFailed:
      return "detection_failed";
    case EndReason::kSelectionFailed:
      return "selection_failed";
    case EndReason::kDrivesFailed:
      return "drives_failed";
    case EndReason::kRecoveryFailed:
      return "recovery_failed";
    case EndReason::kNotReady:
      return "not_ready";
  }
  return "?";
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
