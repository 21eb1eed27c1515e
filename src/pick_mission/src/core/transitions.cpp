// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/transitions.h"

namespace pick_mission {
namespace {

constexpr std::optional<State> kAnyAction = std::nullopt;

/// One row each, in one place: the order counts.
std::vector<Transition> makeTransitions() {
  using S = State;
  using T = Trigger;
  using G = Guard;
  using E = Effect;
  return {
      // Before and after.
      {S::kIdle, T::kStart, G::kAlways, S::kBegin},
      {S::kIdle, T::kStop, G::kBegunBefore, S::kEnded, E::kEndStopped},
      {S::kPaused, T::kResume, G::kAlways, S::kBegin, E::kForgetTries},
      {S::kPaused, T::kHold, G::kAlways, S::kHeld},
      {S::kPaused, T::kStop, G::kAlways, S::kEnded, E::kEndStopped},
      {S::kHeld, T::kResume, G::kAlways, S::kBegin, E::kForgetTries},
      {S::kHeld, T::kStop, G::kAlways, S::kEnded, E::kEndStopped},
      {S::kUnload, T::kUnloaded, G::kAlways, S::kBegin, E::kForgetTries},
      {S::kUnload, T::kHold, G::kAlways, S::kHeld},
      {S::kUnload, T::kStop, G::kAlways, S::kEnded, E::kEndStopped},
      // What goes before each action, and what ends one before its time.
      {kAnyAction, T::kEntering, G::kPickDue, S::kPick, E::kAwaitPick},
      {kAnyAction, T::kEntering, G::kPauseWanted, S::kPaused},
      {S::kDrive, T::kEntering, G::kArmNotReady, S::kPlanClear},
      {kAnyAction, T::kEntering, G::kArmNotReady, S::kBegin},
      {kAnyAction, T::kHold, G::kAlways, S::kHalting, E::kHaltForHold},
      {kAnyAction, T::kStop, G::kAlways, S::kHalting, E::kHaltForStop},
      {kAnyAction, T::kTimeUp, G::kMayBreakOff, S::kHalting, E::kHaltForTimeUp},
      {kAnyAction, T::kActionTimeout, G::kCarries, S::kPick, E::kAwaitPick},
      {kAnyAction, T::kActionTimeout, G::kAlways, S::kHalting, E::kHaltForTimeout},
      {kAnyAction, T::kHeldByOperator, G::kAlways, S::kHeld},
      {S::kHalting, T::kHalted, G::kForHold, S::kHeld},
      {S::kHalting, T::kHalted, G::kForResume, S::kBegin},
      {S::kHalting, T::kHalted, G::kForEnd, S::kEnded, E::kEndHalted},
      {S::kHalting, T::kGiveUp, G::kStowBeforeEnd, S::kBegin, E::kGiveUp},
      {S::kHalting, T::kGiveUp, G::kAlways, S::kEnded, E::kGiveUp},
      {S::kHalting, T::kWaitFirst, G::kAlways, S::kWait, E::kWaitForPose},
      {S::kHalting, T::kRetryHere, G::kAlways, S::kBegin},
      // The arm empty and out of view, then a look. It is folded before a drive, not between two picks from one place.
      {S::kBegin, T::kAtOnce, G::kCarries, S::kPick, E::kAwaitPick},
      {S::kBegin, T::kAtOnce, G::kHandUnknownTooLong, S::kEnded, E::kEndHandUnknown},
      {S::kBegin, T::kAtOnce, G::kHandUnknown, S::kWait, E::kWaitForHand},
      {S::kBegin, T::kAtOnce, G::kHandFull, S::kPlanStow},
      {S::kBegin, T::kAtOnce, G::kTimeUp, S::kEnded, E::kEndTimeUp},
      {S::kBegin, T::kAtOnce, G::kUnloadDue, S::kPlanClear},
      {S::kBegin, T::kAtOnce, G::kEnding, S::kEnded},
      {S::kBegin, T::kAtOnce, G::kViewClear, S::kLook},
      {S::kBegin, T::kAtOnce, G::kAlways, S::kPlanClear},
      {S::kPlanClear, T::kDone, G::kAlways, S::kClear},
      {S::kClear, T::kDone, G::kDriveDue, S::kDrive},
      {S::kClear, T::kDone, G::kAlways, S::kLook},
      {S::kLook, T::kDone, G::kAlways, S::kDetect},
      {S::kDetect, T::kDone, G::kAlways, S::kChoose},
      // What to do here.
      {S::kChoose, T::kAtOnce, G::kTimeUp, S::kEnded, E::kEndTimeUp},
      {S::kChoose, T::kAtOnce, G::kReportLeft, S::kReport},
      {S::kChoose, T::kAtOnce, G::kUnloadDue, S::kDrive, E::kGoToDepot},
      {S::kChoose, T::kAtOnce, G::kAllDealtWith, S::kBegin, E::kEndAllDealtWith},
      {S::kChoose, T::kAtOnce, G::kSurveyLeft, S::kDrive, E::kGoToSurveyPose},
      {S::kChoose, T::kAtOnce, G::kChoiceDue, S::kSelect},
      {S::kChoose, T::kAtOnce, G::kBrickHere, S::kPlanPick},
      {S::kChoose, T::kAtOnce, G::kViewsSpent, S::kBegin, E::kEndViewsSpent},
      {S::kChoose, T::kAtOnce, G::kAlways, S::kSelect},
      {S::kReport, T::kDone, G::kAlways, S::kChoose},
      {S::kReport, T::kRetryHere, G::kAlways, S::kChoose},
      // A pick. The state is left while the brick is carried away, and entered again when its end is waited for.
      {S::kPlanPick, T::kDone, G::kCarries, S::kPick, E::kAwaitPickWithPlan},
      {S::kPlanPick, T::kDone, G::kAlways, S::kPick},
      {S::kPlanPick, T::kNextBrick, G::kAlways, S::kChoose},
      {S::kPick, T::kPileLeft, G::kLooksAhead, S::kLook, E::kLookAhead},
      {S::kPick, T::kDone, G::kHandFull, S::kBegin},
      {S::kPick, T::kDone, G::kUnloadDue, S::kDrive, E::kGoToDepot},
      {S::kPick, T::kDone, G::kNextPlanned, S::kPick},
      {S::kPick, T::kDone, G::kDriveDue, S::kDrive},
      {S::kPick, T::kDone, G::kAlways, S::kBegin},
      {S::kPick, T::kNextBrick, G::kAlways, S::kBegin},
      {S::kPick, T::kLetGoAgain, G::kAlways, S::kLetGo},
      {S::kPick, T::kGiveUp, G::kHandFull, S::kBegin, E::kGiveUp},
      // A brick that was not let go where it should have been.
      {S::kPlanStow, T::kDone, G::kAlways, S::kStow},
      {S::kStow, T::kDone, G::kAlways, S::kLetGo},
      {S::kLetGo, T::kDone, G::kAlways, S::kBegin},
      {S::kLetGo, T::kLetGoAgain, G::kAlways, S::kLetGo},
      // The next view.
      {S::kSelect, T::kDone, G::kStaysToWait, S::kPick, E::kAwaitPick},
      {S::kSelect, T::kDone, G::kStays, S::kChoose, E::kStayHere},
      {S::kSelect, T::kDone, G::kAlways, S::kDrive, E::kGoToView},
      {S::kSelect, T::kVantage, G::kBrickHere, S::kPlanPick},
      {S::kSelect, T::kLowUtility, G::kBrickHere, S::kPlanPick},
      {S::kSelect, T::kNoPile, G::kBrickHere, S::kPlanPick},
      // What to do without a view is decided when the brick is stowed.
      {S::kSelect, T::kVantage, G::kCarries, S::kPick, E::kAwaitPick},
      {S::kSelect, T::kLowUtility, G::kCarries, S::kPick, E::kAwaitPick},
      {S::kSelect, T::kNoPile, G::kCarries, S::kPick, E::kAwaitPick},
      {S::kSelect, T::kVantage, G::kKeepsAway, S::kSelect, E::kAllowTriedBricks},
      {S::kSelect, T::kLowUtility, G::kKeepsAway, S::kSelect, E::kAllowTriedBricks},
      {S::kSelect, T::kVantage, G::kSomeExcluded, S::kSelect, E::kClearExcluded},
      {S::kSelect, T::kVantage, G::kVantageLeft, S::kDrive, E::kGoToVantage},
      {S::kSelect, T::kVantage, G::kAlways, S::kBegin, E::kEndNoView},
      {S::kSelect, T::kLowUtility, G::kUnseenWorth, S::kDrive, E::kGoToUnseen},
      {S::kSelect, T::kLowUtility, G::kWorthWaiting, S::kWait, E::kWaitForFading},
      {S::kSelect, T::kLowUtility, G::kBricksLeft, S::kDrive, E::kGoToVantage},
      {S::kSelect, T::kLowUtility, G::kAlways, S::kBegin, E::kEndNoView},
      {S::kSelect, T::kNoPile, G::kBricksLeft, S::kDrive, E::kGoToVantage},
      {S::kSelect, T::kNoPile, G::kAlways, S::kBegin, E::kEndNoPile},
      {S::kDrive, T::kDone, G::kAtDepot, S::kUnload},
      {S::kDrive, T::kDone, G::kAlways, S::kLook},
      {S::kDrive, T::kOtherView, G::kAlways, S::kBegin},
      // Mending.
      {S::kRecover, T::kDone, G::kAlways, S::kBegin},
      {S::kRecover, T::kRetryHere, G::kAlways, S::kRecover, E::kCountRecovery},
      {S::kWait, T::kDone, G::kAlways, S::kBegin},
      {S::kWait, T::kRecover, G::kAlways, S::kRecover, E::kCountRecovery},
      {kAnyAction, T::kRetryHere, G::kAlways, S::kBegin},
      {S::kRecover, T::kWaitFirst, G::kAlways, S::kWait, E::kWaitAfterRecovery},
      {S::kClear, T::kWaitFirst, G::kAlways, S::kWait, E::kWaitForArm},
      {S::kPick, T::kWaitFirst, G::kAlways, S::kWait, E::kWaitForArm},
      {S::kStow, T::kWaitFirst, G::kAlways, S::kWait, E::kWaitForArm},
      {S::kLetGo, T::kWaitFirst, G::kAlways, S::kWait, E::kWaitForArm},
      {kAnyAction, T::kWaitFirst, G::kAlways, S::kWait, E::kWaitForPose},
      {kAnyAction, T::kArmBusy, G::kAlways, S::kWait, E::kWaitForIdleArm},
      {kAnyAction, T::kRecover, G::kMayRecover, S::kRecover, E::kCountRecovery},
      {kAnyAction, T::kRecover, G::kAlways, S::kEnded, E::kEndNotRecovered},
      {kAnyAction, T::kGiveUp, G::kAlways, S::kEnded, E::kGiveUp},
  };
}

}  // namespace

const std::vector<Transition>& transitions() {
  static const std::vector<Transition> table = makeTransitions();
  return table;
}

const Transition* nextTransition(State from, Trigger trigger, const std::function<bool(Guard)>& holds) {
  for (const Transition& row : transitions()) {
    const bool is_from = row.from ? *row.from == from : isAction(from);
    if (is_from && row.trigger == trigger && holds(row.guard)) return &row;
  }
  return nullptr;
}

std::string transitionsAsMarkdown() {
  std::string text = "| State | Event | If | Next | Effect |\n|---|---|---|---|---|\n";
  for (const Transition& row : transitions()) {
    text += std::string("| ") + (row.from ? toString(*row.from) : "any action") + " | " + toString(row.trigger) +
            " | " + toString(row.guard) + " | " + toString(row.to) + " | " + toString(row.effect) + " |\n";
  }
  return text;
}

}  // namespace pick_mission
