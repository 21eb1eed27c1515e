// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/reactions.h"

#include <stdexcept>
#include <type_traits>
#include <utility>

namespace pick_mission {
namespace {

/// The results that an action can have, and why a mission ends that gives it up.
struct Kind {
  State action;
  Result result;  // one of them
  int num_status;
  EndReason end;
};

/// Null: no action.
const Kind* kindOf(State action) {
  using E = EndReason;
  static const std::vector<Kind> kinds = {
      {State::kPlanClear, PlanResult{}, interactive_mapping::kNumPlanStatus, E::kPlanningFailed},
      {State::kClear, ArmResult{}, interactive_mapping::kNumArmStatus, E::kArmFailed},
      {State::kLook, LookResult{}, static_cast<int>(kLookStatusNames.size()), E::kLooksFailed},
      {State::kDetect, DetectionResult{}, interactive_mapping::kNumDetectionStatus, E::kDetectionFailed},
      {State::kReport, ReportResult{}, static_cast<int>(kReportStatusNames.size()), E::kNotEnded},
      {State::kPlanPick, PlanResult{}, interactive_mapping::kNumPlanStatus, E::kPlanningFailed},
      {State::kPick, ArmResult{}, interactive_mapping::kNumArmStatus, E::kPicksFailed},
      {State::kPlanStow, PlanResult{}, interactive_mapping::kNumPlanStatus, E::kBrickInHand},
      {State::kStow, ArmResult{}, interactive_mapping::kNumArmStatus, E::kBrickInHand},
      {State::kLetGo, ArmResult{}, interactive_mapping::kNumArmStatus, E::kBrickInHand},
      {State::kSelect, SelectionResult{}, interactive_mapping::kNumSelectionStatus, E::kSelectionFailed},
      {State::kDrive, NavigationResult{}, interactive_mapping::kNumNavigationStatus, E::kDrivesFailed},
      {State::kRecover, ArmResult{}, interactive_mapping::kNumArmStatus, E::kRecoveryFailed},
      {State::kWait, WaitResult{}, static_cast<int>(kWaitStatusNames.size()), E::kNotReady},
  };
  for (const Kind& kind : kinds) {
    if (kind.action == action) return &kind;
  }
  return nullptr;
}

EndReason endReasonOf(State action) {
  return kindOf(action)->end;
}

Reaction done() {
  return {};
}

Reaction notCounted(Trigger next, const char* why) {
  Reaction reaction;
  reaction.next = next;
  reaction.why = why;
  return reaction;
}

/// A failure that the place and the brick have nothing to do with.
Reaction inARow(State action, Trigger next, const char* why) {
  Reaction reaction = notCounted(next, why);
  reaction.counts_in_a_row = true;
  reaction.end = endReasonOf(action);
  return reaction;
}

Reaction ofBrick(Trigger next, bool is_reported, const char* why) {
  Reaction reaction = notCounted(next, why);
  reaction.blames_brick = true;
  reaction.is_reported = is_reported;
  return reaction;
}

Reaction giveUp(EndReason end, const char* why) {
  Reaction reaction = notCounted(Trigger::kGiveUp, why);
  reaction.end = end;
  return reaction;
}

Reaction toPickPlan(PlanStatus status) {
  const State action = State::kPlanPick;
  switch (status) {
    case PlanStatus::kSuccess:
      return done();
    case PlanStatus::kBadRequest:
      return ofBrick(Trigger::kNextBrick, false, "the request is invalid: asking again does not help");
    case PlanStatus::kNoMap:
      return inARow(action, Trigger::kWaitFirst, "the map must arrive first");
    case PlanStatus::kOutsideSector:
      return ofBrick(Trigger::kNextBrick, false, "out of the arm's reach from here");
    case PlanStatus::kNoIk:
      return ofBrick(Trigger::kNextBrick, false, "no posture of the arm reaches it from here");
    case PlanStatus::kStartInCollision:
      return inARow(action, Trigger::kRetryHere, "the map has changed around the arm: clear the view and look again");
    case PlanStatus::kGoalInCollision:
      return ofBrick(Trigger::kNextBrick, true, "an obstacle is where the arm would be");
    case PlanStatus::kGoalUnknown:
      return ofBrick(Trigger::kNextBrick, true, "unseen space at the brick: another view may show it");
    case PlanStatus::kApproachBlocked:
      return ofBrick(Trigger::kNextBrick, true, "the straight approach to it is blocked from here");
    case PlanStatus::kIterations:
      return ofBrick(Trigger::kNextBrick, true, "no path found from here");
    case PlanStatus::kConstraint:
      return ofBrick(Trigger::kNextBrick, true, "cannot be carried as it was taken");
    case PlanStatus::kCancelled:
      return inARow(action, Trigger::kRetryHere, "another client cancelled it");
    case PlanStatus::kNoRobotState:
      return inARow(action, Trigger::kWaitFirst, "the robot's state must be known first");
    case PlanStatus::kOutsideLimits:
      return ofBrick(Trigger::kNextBrick, false, "beyond the joints' limits from here");
  }
  throw std::invalid_argument("plan status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 13]");
}

Reaction toArmPlan(State action, PlanStatus status) {
  switch (status) {
    case PlanStatus::kSuccess:
      return done();
    case PlanStatus::kBadRequest:
      return giveUp(endReasonOf(action), "posture or pose is invalid: a mistake in the configuration");
    case PlanStatus::kCancelled:
      return inARow(action, Trigger::kRetryHere, "another client cancelled it");
    case PlanStatus::kNoMap:
      return inARow(action, Trigger::kWaitFirst, "the map must arrive first");
    case PlanStatus::kNoRobotState:
      return inARow(action, Trigger::kWaitFirst, "the robot's state must be known first");
    case PlanStatus::kOutsideSector:
    case PlanStatus::kNoIk:
    case PlanStatus::kStartInCollision:
    case PlanStatus::kGoalInCollision:
    case PlanStatus::kGoalUnknown:
    case PlanStatus::kApproachBlocked:
    case PlanStatus::kIterations:
    case PlanStatus::kConstraint:
    case PlanStatus::kOutsideLimits:
      return inARow(action, Trigger::kWaitFirst, "the arm must leave this posture: newer images may show a path");
  }
  throw std::invalid_argument("plan status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 13]");
}

Reaction react(State action, PlanStatus status) {
  return action == State::kPlanPick ? toPickPlan(status) : toArmPlan(action, status);
}

Reaction react(State action, ArmStatus status) {
  const bool is_pick = action == State::kPick;
  const bool is_recovery = action == State::kRecover;
  switch (status) {
    case ArmStatus::kSuccess:
      return done();
    case ArmStatus::kCancelled:
      return inARow(action, Trigger::kRetryHere, "another client cancelled it: replan from the arm's present posture");
    case ArmStatus::kBadRequest:
    case ArmStatus::kBeyondLimits:
      if (is_pick) return ofBrick(Trigger::kNextBrick, false, "a mistake in the plan: not to be repeated");
      if (is_recovery) return inARow(action, Trigger::kRetryHere, "not an answer of a recovery");
      return giveUp(endReasonOf(action), "a mistake in the plan: not to be repeated");
    case ArmStatus::kStartMismatch:
      return inARow(action, Trigger::kRetryHere, "replan from the arm's present posture");
    case ArmStatus::kNotReady:
    case ArmStatus::kProgramStopped:
      if (is_recovery) return inARow(action, Trigger::kWaitFirst, "it may become ready later or at the next attempt");
      return inARow(action, Trigger::kRecover, "mode, brakes or program must be restored");
    case ArmStatus::kStaleState:
    case ArmStatus::kStaleMap:
    case ArmStatus::kMonitorGone:
    case ArmStatus::kHeartbeatLost:
      return inARow(action, Trigger::kWaitFirst, "the arm waits for late data");
    case ArmStatus::kPathBlocked:
      if (is_pick) return ofBrick(Trigger::kRetryHere, true, "replan in the present map");
      return inARow(action, Trigger::kRetryHere, "replan in the present map");
    case ArmStatus::kHeld:
      return notCounted(Trigger::kHeldByOperator, "the operator holds: wait for resume");
    case ArmStatus::kProtectiveStop:
      if (is_recovery) return giveUp(EndReason::kNeedsPerson, "a person must find out why it stopped");
      return inARow(action, Trigger::kRecover, "unlock, if that is allowed without a person");
    case ArmStatus::kEmergencyStop:
      return giveUp(EndReason::kNeedsPerson, "a person must check the robot");
    case ArmStatus::kDriverGone:
      if (is_recovery) return inARow(action, Trigger::kWaitFirst, "the driver must come back");
      return inARow(action, Trigger::kRecover, "when the driver is back, its program must be restored");
    case ArmStatus::kTrajectoryRefused:
    case ArmStatus::kTrajectoryAborted:
      return inARow(action, Trigger::kRetryHere, "replan; if it repeats, the operator must check why");
    case ArmStatus::kStalled:
      return inARow(action, Trigger::kWaitFirst, "the speed slider is near zero");
    case ArmStatus::kIoRefused:
      if (action == State::kLetGo) return inARow(action, Trigger::kLetGoAgain, "the magnet must be switched off");
      return inARow(action, Trigger::kRetryHere, "the driver refused magnet, payload or force sensor");
    case ArmStatus::kNoContact:
    case ArmStatus::kContactTooEarly:
      if (is_pick) return ofBrick(Trigger::kRetryHere, true, "the brick is not at its expected pose: look again");
      return inARow(action, Trigger::kRetryHere, "not an answer of a motion");
    case ArmStatus::kNotAttached:
      if (is_pick) return ofBrick(Trigger::kNextBrick, true, "it does not hold: another brick first");
      return inARow(action, Trigger::kRetryHere, "not an answer of a motion");
    case ArmStatus::kLostOnTheWay:
      if (is_pick) return ofBrick(Trigger::kRetryHere, true, "the brick has another pose now: look again");
      return inARow(action, Trigger::kRetryHere, "the brick has another pose now: look again");
    case ArmStatus::kNotLetGo:
      if (is_pick || action == State::kLetGo) return inARow(action, Trigger::kLetGoAgain, "the weight is still there");
      return inARow(action, Trigger::kRetryHere, "not an answer of a motion");
    case ArmStatus::kNothingHeld:
      return inARow(action, Trigger::kRetryHere, "the magnet is off and holds nothing: look again");
    case ArmStatus::kFault:
      return giveUp(EndReason::kArmFailed, "the arm's bridge contradicts itself: it must not move on");
    case ArmStatus::kBusy:
      return inARow(action, Trigger::kArmBusy, "the arm still executes an earlier command");
  }
  throw std::invalid_argument("arm status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 27]");
}

Reaction react(State action, NavigationStatus status) {
  const auto other = [&](const char* why) {
    Reaction reaction = inARow(action, Trigger::kOtherView, why);
    reaction.is_reported = true;
    return reaction;
  };
  switch (status) {
    case NavigationStatus::kSuccess:
      return done();
    case NavigationStatus::kCancelled:
      return inARow(action, Trigger::kRetryHere, "another client cancelled it");
    case NavigationStatus::kBadGoal:
      return other("the goal pose is invalid");
    case NavigationStatus::kStartBlocked:
      return inARow(action, Trigger::kWaitFirst, "an obstacle is inside the robot's footprint: it may go away");
    case NavigationStatus::kGoalOccupied:
    case NavigationStatus::kGoalUnknown:
      return other("the goal is on occupied or unknown ground");
    case NavigationStatus::kNoApproach:
    case NavigationStatus::kNoPath:
    case NavigationStatus::kIterations:
      return other("no path to the goal");
    case NavigationStatus::kObstacle:
    case NavigationStatus::kTooManyPlans:
      return other("an obstacle on the path stays");
    case NavigationStatus::kStuck:
      return other("the base does not follow its commands: another path may work");
    case NavigationStatus::kStaleOdometry:
    case NavigationStatus::kStalePose:
    case NavigationStatus::kStaleScan:
    case NavigationStatus::kStaleGrid:
    case NavigationStatus::kStaleHeartbeat:
      return inARow(action, Trigger::kWaitFirst, "the base waits for late data");
    case NavigationStatus::kBadInput:
      return inARow(action, Trigger::kWaitFirst, "the base waits until its input is corrected");
    case NavigationStatus::kBaseStopped:
      return giveUp(EndReason::kNeedsPerson, "the base was stopped by its button or scanner: a person must check it");
    case NavigationStatus::kGoalMissed:
      return other("the base cannot reach the goal accurately enough");
  }
  throw std::invalid_argument("navigation status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 19]");
}

Reaction react(State action, SelectionStatus status) {
  switch (status) {
    case SelectionStatus::kSuccess:
      return done();
    case SelectionStatus::kCancelled:
      return inARow(action, Trigger::kRetryHere, "another client cancelled it");
    case SelectionStatus::kBadGoal:
      return giveUp(EndReason::kSelectionFailed, "strategy or zones are invalid: asking again does not help");
    case SelectionStatus::kStaleMap:
    case SelectionStatus::kStaleGround:
    case SelectionStatus::kNoPose:
      return inARow(action, Trigger::kWaitFirst, "the selection waits for its input");
    case SelectionStatus::kEmptyMap:
    case SelectionStatus::kNoGround:
      return notCounted(Trigger::kVantage, "ground and pile must be in view");
    case SelectionStatus::kNoPile:
      return notCounted(Trigger::kNoPile, "nothing left, or nothing seen");
    case SelectionStatus::kNoCandidate:
      return notCounted(Trigger::kVantage, "no reachable pose is known from here");
    case SelectionStatus::kLowUtility:
      return notCounted(Trigger::kLowUtility, "no pose has enough utility");
    case SelectionStatus::kMapChanged:
      return inARow(action, Trigger::kRetryHere, "the map still changes");
    case SelectionStatus::kBadInput:
      return inARow(action, Trigger::kWaitFirst, "map or grid must be corrected");
  }
  throw std::invalid_argument("selection status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 12]");
}

Reaction react(State action, DetectionStatus status) {
  switch (status) {
    case DetectionStatus::kOk:
      return done();
    case DetectionStatus::kNoImage:
      return inARow(action, Trigger::kWaitFirst, "the camera must come back");
    case DetectionStatus::kRefused:
      return inARow(action, Trigger::kRetryHere, "the next image may succeed");
    case DetectionStatus::kShuttingDown:
      return inARow(action, Trigger::kWaitFirst, "the detection must come back");
  }
  throw std::invalid_argument("detection status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 3]");
}

Reaction react(State action, LookStatus status) {
  switch (status) {
    case LookStatus::kSuccess:
      return done();
    case LookStatus::kCancelled:
      return inARow(action, Trigger::kRetryHere, "another client cancelled it");
    case LookStatus::kNoImage:
      return inARow(action, Trigger::kWaitFirst, "the map gets no images");
  }
  throw std::invalid_argument("look status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 2]");
}

Reaction react(State action, WaitStatus status) {
  switch (status) {
    case WaitStatus::kSuccess:
      return done();
    case WaitStatus::kCancelled:
      return inARow(action, Trigger::kRetryHere, "another client cancelled it");
    case WaitStatus::kNotReady:
      return inARow(action, Trigger::kRecover, "it does not become ready by itself");
  }
  throw std::invalid_argument("wait status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 2]");
}

Reaction react(State /*action*/, ReportStatus status) {
  switch (status) {
    case ReportStatus::kSuccess:
      return done();
    case ReportStatus::kRefused:
      return notCounted(Trigger::kRetryHere, "continues without the penalty; the pose is excluded anyway");
  }
  throw std::invalid_argument("report status " + std::to_string(static_cast<int>(status)) + ", must be in [0, 1]");
}

Reaction toNoAnswer(State action) {
  switch (action) {
    case State::kReport:
      return react(action, ReportStatus::kRefused);
    case State::kWait:
      return inARow(action, Trigger::kRetryHere, "try without");
    default:
      return inARow(action, Trigger::kWaitFirst, "wait for the server that did not answer");
  }
}

/// visit(result) with the alternative that is there; NoAnswer is left out.
template <typename Visitor>
void visitAnswer(const Result& result, Visitor&& visit) {
  std::visit(
      [&visit](const auto& r) {
        if constexpr (!std::is_same_v<std::decay_t<decltype(r)>, NoAnswer>) visit(r);
      },
      result);
}

using Rows = std::vector<std::pair<std::string, std::string>>;  // first cell, the others

/// Rows that differ in the first cell alone are one.
void add(const std::string& first, const std::string& others, Rows& rows) {
  for (auto& [cell, same] : rows) {
    if (same != others) continue;
    cell += ", " + first;
    return;
  }
  rows.emplace_back(first, others);
}

}  // namespace

Reaction reactTo(State action, const Result& result) {
  const Kind* kind = kindOf(action);
  const bool is_unanswered = std::holds_alternative<NoAnswer>(result);
  if (kind == nullptr || (!is_unanswered && kind->result.index() != result.index())) {
    throw std::invalid_argument(std::string("result \"") + toString(result) + "\" of kind " +
                                std::to_string(result.index()) + " in state \"" + toString(action) +
                                "\", must be one that its action can have");
  }
  if (is_unanswered) return toNoAnswer(action);
  Reaction reaction;
  visitAnswer(result, [&](const auto& answer) { reaction = react(action, answer.status); });
  return reaction;
}

std::vector<Result> possibleResults(State action) {
  const Kind* kind = kindOf(action);
  if (kind == nullptr) return {};
  std::vector<Result> results;
  visitAnswer(kind->result, [&](auto answer) {
    for (int i = 0; i < kind->num_status; ++i) {
      answer.status = static_cast<decltype(answer.status)>(i);
      results.emplace_back(answer);
    }
  });
  results.emplace_back(NoAnswer{});
  return results;
}

std::string reactionsAsMarkdown() {
  Rows rows;
  for (int i = 0; i < kNumStates; ++i) {
    const State action = static_cast<State>(i);
    Rows own;
    for (const Result& result : possibleResults(action)) {
      const Reaction reaction = reactTo(action, result);
      if (reaction.next == Trigger::kDone) continue;
      add(toString(result), std::string(toString(reaction.next)) + " | " + reaction.why, own);
    }
    for (const auto& [results, reaction] : own) add(toString(action), results + " | " + reaction, rows);
  }
  std::string text = "| State | Result | Then | Why |\n|---|---|---|---|\n";
  for (const auto& [actions, rest] : rows) text += "| " + actions + " | " + rest + " |\n";
  return text;
}

}  // namespace pick_mission
