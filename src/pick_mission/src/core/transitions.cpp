// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/transitions.h"

namespace pick_mission {
namespace {

constexpr std::optional<State> kAnyAction = std::nullopt;

std::vector<Transition> makeTransitions() {
  using S = State;
  using T = Trigger;
  using G = Guard;
  return {
      // Before and after.
      {S::kIdle, T::kStart, G::kAlways, S::kBegin},
      {S::kIdle, T::kStop, G::kBegunBefore, S::kEnded},
      {S::kPaused, T::kResume, G::kAlways, S::kBegin},
      {S::kPaused, T::kHold, G::kAlways, S::kHeld},
      {S::kPaused, T::kStop, G::kAlways, S::kEnded},
      {S::kHeld, T::kResume, G::kAlways, S::kBegin},
      {S::kHeld, T::kStop, G::kAlways, S::kEnded},
      // What goes before each action, and what ends one before its time.
      {kAnyAction, T::kEntering, G::kPauseWanted, S::kPaused},
      {kAnyAction, T::kEntering, G::kNotInOrder, S::kBegin},
      {kAnyAction, T::kHold, G::kAlways, S::kHalting},
      {kAnyAction, T::kStop, G::kAlways, S::kHalting},
      {kAnyAction, T::kTimeUp, G::kMayBreakOff, S::kHalting},
      {kAnyAction, T::kActionTimeout, G::kAlways, S::kHalting},
      {kAnyAction, T::kHeldByOperator, G::kAlways, S::kHeld},
      {S::kHalting, T::kHalted, G::kForHold, S::kHeld},
      {S::kHalting, T::kHalted, G::kForResume, S::kBegin},
      {S::kHalting, T::kHalted, G::kForEnd, S::kEnded},
      {S::kHalting, T::kGiveUp, G::kStowBeforeEnd, S::kBegin},
      {S::kHalting, T::kGiveUp, G::kAlways, S::kEnded},
      {S::kHalting, T::kWaitFirst, G::kAlways, S::kWait},
      {S::kHalting, T::kRetryHere, G::kAlways, S::kBegin},
      // The arm empty and out of view, then a look.
      {S::kBegin, T::kAtOnce, G::kHandUnknownTooLong, S::kEnded},
      {S::kBegin, T::kAtOnce, G::kHandUnknown, S::kWait},
      {S::kBegin, T::kAtOnce, G::kHandFull, S::kPlanStow},
      {S::kBegin, T::kAtOnce, G::kEnding, S::kEnded},
      {S::kBegin, T::kAtOnce, G::kTimeUp, S::kEnded},
      {S::kBegin, T::kAtOnce, G::kAlways, S::kPlanClear},
      {S::kPlanClear, T::kDone, G::kAlways, S::kClear},
      {S::kClear, T::kDone, G::kAlways, S::kLook},
      {S::kLook, T::kDone, G::kAlways, S::kDetect},
      {S::kDetect, T::kDone, G::kAlways, S::kChoose},
      // What to do here.
      {S::kChoose, T::kAtOnce, G::kTimeUp, S::kEnded},
      {S::kChoose, T::kAtOnce, G::kReportLeft, S::kReport},
      {S::kChoose, T::kAtOnce, G::kAllDealtWith, S::kEnded},
      {S::kChoose, T::kAtOnce, G::kSurveyLeft, S::kDrive},
      {S::kChoose, T::kAtOnce, G::kBrickHere, S::kPlanPick},
      {S::kChoose, T::kAtOnce, G::kViewsSpent, S::kEnded},
      {S::kChoose, T::kAtOnce, G::kAlways, S::kSelect},
      {S::kReport, T::kDone, G::kAlways, S::kChoose},
      {S::kReport, T::kRetryHere, G::kAlways, S::kChoose},
      // A pick.
      {S::kPlanPick, T::kDone, G::kAlways, S::kPick},
      {S::kPlanPick, T::kNextBrick, G::kAlways, S::kChoose},
      {S::kPick, T::kDone, G::kAlways, S::kBegin},
      {S::kPick, T::kNextBrick, G::kAlways, S::kBegin},
      {S::kPick, T::kLetGoAgain, G::kAlways, S::kLetGo},
      {S::kPick, T::kGiveUp, G::kHandFull, S::kBegin},
      // A brick that was not let go where it should have been.
      {S::kPlanStow, T::kDone, G::kAlways, S::kStow},
      {S::kStow, T::kDone, G::kAlways, S::kLetGo},
      {S::kLetGo, T::kDone, G::kAlways, S::kBegin},
      {S::kLetGo, T::kLetGoAgain, G::kAlways, S::kLetGo},
      // The next view.
      {S::kSelect, T::kDone, G::kAlways, S::kDrive},
      {S::kSelect, T::kVantage, G::kLeaves, S::kSelect},
      {S::kSelect, T::kLowUtility, G::kLeaves, S::kSelect},
      {S::kSelect, T::kVantage, G::kSomeExcluded, S::kSelect},
      {S::kSelect, T::kVantage, G::kVantageLeft, S::kDrive},
      {S::kSelect, T::kVantage, G::kAlways, S::kEnded},
      {S::kSelect, T::kLowUtility, G::kUnseenWorth, S::kDrive},
      {S::kSelect, T::kLowUtility, G::kWorthWaiting, S::kWait},
      {S::kSelect, T::kLowUtility, G::kBricksLeft, S::kDrive},
      {S::kSelect, T::kLowUtility, G::kAlways, S::kEnded},
      {S::kSelect, T::kNoPile, G::kBricksLeft, S::kDrive},
      {S::kSelect, T::kNoPile, G::kAlways, S::kEnded},
      {S::kDrive, T::kDone, G::kAlways, S::kLook},
      {S::kDrive, T::kOtherView, G::kAlways, S::kBegin},
      // Mending.
      {S::kRecover, T::kDone, G::kAlways, S::kBegin},
      {S::kRecover, T::kRetryHere, G::kAlways, S::kRecover},
      {S::kWait, T::kDone, G::kAlways, S::kBegin},
      {S::kWait, T::kRecover, G::kAlways, S::kRecover},
      {kAnyAction, T::kRetryHere, G::kAlways, S::kBegin},
      {kAnyAction, T::kWaitFirst, G::kAlways, S::kWait},
      {kAnyAction, T::kRecover, G::kMayRecover, S::kRecover},
      {kAnyAction, T::kRecover, G::kAlways, S::kEnded},
      {kAnyAction, T::kGiveUp, G::kAlways, S::kEnded},
  };
}

}  // namespace

const char* toString(Trigger trigger) {
  switch (trigger) {
    case Trigger::kDone:
      return "done";
    case Trigger::kRetryHere:
      return "retry here";
    case Trigger::kNextBrick:
      return "next brick";
    case Trigger::kOtherView:
      return "other view";
    case Trigger::kVantage:
      return "look from farther away";
    case Trigger::kLowUtility:
      return "low utility";
    case Trigger::kNoPile:
      return "no pile";
    case Trigger::kLetGoAgain:
      return "let go again";
    case Trigger::kWaitFirst:
      return "wait first";
    case Trigger::kRecover:
      return "recover";
    case Trigger::kHeldByOperator:
      return "held by the operator";
    case Trigger::kGiveUp:
      return "give up";
    case Trigger::kStart:
      return "start";
    case Trigger::kPause:
      return "pause";
    case Trigger::kResume:
      return "resume";
    case Trigger::kHold:
      return "hold";
    case Trigger::kStop:
      return "stop";
    case Trigger::kTimeUp:
      return "time is up";
    case Trigger::kActionTimeout:
      return "takes too long";
    case Trigger::kHalted:
      return "halted";
    case Trigger::kAtOnce:
      return "at once";
    case Trigger::kEntering:
      return "entering";
  }
  return "?";
}

const char* toString(Guard guard) {
  switch (guard) {
    case Guard::kAlways:
      return "";
    case Guard::kHandFull:
      return "brick in the hand";
    case Guard::kStowBeforeEnd:
      return "brick in the hand, nothing given up before";
    case Guard::kHandUnknown:
      return "hand unknown";
    case Guard::kHandUnknownTooLong:
      return "hand unknown too long";
    case Guard::kBegunBefore:
      return "begun by an earlier process";
    case Guard::kEnding:
      return "mission over";
    case Guard::kTimeUp:
      return "time is up";
    case Guard::kPauseWanted:
      return "pause wanted";
    case Guard::kNotInOrder:
      return "needs empty hand or arm out of view, and is not so";
    case Guard::kReportLeft:
      return "failure not reported yet";
    case Guard::kSurveyLeft:
      return "survey not finished";
    case Guard::kAllDealtWith:
      return "every brick picked or exhausted";
    case Guard::kBrickHere:
      return "brick to be tried from here";
    case Guard::kViewsSpent:
      return "too many fruitless views";
    case Guard::kMayRecover:
      return "not recovered too often, no protective stop or may unlock it";
    case Guard::kLeaves:
      return "bricks tried in vain are kept away from";
    case Guard::kSomeExcluded:
      return "places are excluded";
    case Guard::kUnseenWorth:
      return "something unseen, not gone there too often";
    case Guard::kWorthWaiting:
      return "bricks with attempts left, not waited too often";
    case Guard::kVantageLeft:
      return "survey place, not gone back too often";
    case Guard::kBricksLeft:
      return "bricks neither picked nor given up, survey place not gone back to too often";
    case Guard::kMayBreakOff:
      return "hand empty, arm at rest";
    case Guard::kForHold:
      return "for hold";
    case Guard::kForResume:
      return "for hold, resumed since";
    case Guard::kForEnd:
      return "for stop or time";
  }
  return "?";
}

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
  std::string text = "| State | Event | If | Next |\n|---|---|---|---|\n";
  for (const Transition& row : transitions()) {
    text += std::string("| ") + (row.from ? toString(*row.from) : "any action") + " | " + toString(row.trigger) +
            " | " + toString(row.guard) + " | " + toString(row.to) + " |\n";
  }
  return text;
}

std::string transitionsAsDot() {
  std::string text = "digraph pick_mission {\n";
  for (const Transition& row : transitions()) {
    if (row.trigger == Trigger::kEntering) continue;
    const std::string guard = toString(row.guard);
    text += std::string("  \"") + (row.from ? toString(*row.from) : "any action") + "\" -> \"" + toString(row.to) +
            "\" [label=\"" + toString(row.trigger) + (guard.empty() ? "" : " [" + guard + "]") + "\"];\n";
  }
  return text + "}\n";
}

}  // namespace pick_mission
