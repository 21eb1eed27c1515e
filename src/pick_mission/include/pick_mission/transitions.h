// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "pick_mission/mission_types.h"

namespace pick_mission {

/// What makes a state be left. The first group is how an action ended, by reactTo().
enum class Trigger {
  kDone,
  kRetryHere,   // the same again, after a fresh look where the world may have changed
  kNextBrick,   // not this brick, not from here
  kOtherView,   // not from here
  kVantage,     // look from farther away
  kLowUtility,  // the best view is not worth much
  kNoPile,      // nothing above the ground
  kLetGoAgain,
  kWaitFirst,       // until what is missing is there
  kArmBusy,         // with something else: wait until it has ended that
  kRecover,         // the arm
  kHeldByOperator,  // at the arm's bridge
  kGiveUp,
  // Of the operator and the clock.
  kStart,
  kPause,
  kResume,
  kHold,
  kStop,
  kTimeUp,
  kActionTimeout,  // the running action takes too long
  kHalted,         // it has ended, or does not even do that
  // Of the machine itself.
  kAtOnce,    // junctions
  kEntering,  // what goes before each action
};
constexpr int kNumTriggers = 23;
const char* toString(Trigger trigger);

/// What must hold for a transition to be taken.
enum class Guard {
  kAlways,
  kHandFull,
  kStowBeforeEnd,  // the same, and nothing has been given up before: then it would be tried for ever
  kHandUnknown,
  kHandUnknownTooLong,
  kBegunBefore,  // by a process that is no more
  kEnding,       // the mission is over but for the brick in the hand
  kTimeUp,
  kPauseWanted,
  kArmNotReady,  // the action needs an empty hand or the arm out of view, and it is not so
  kReportLeft,   // a failure that the selection has not been told yet
  kSurveyLeft,
  kAllDealtWith,  // as many bricks as there are have been picked or have used their attempts
  kBrickHere,     // one to be tried from here
  kViewsSpent,    // too many views in a row without a pick or a new brick
  kMayRecover,    // not too often in a row; no protective stop, or the configuration lets the program unlock it
  kKeepsAway,     // the selection passes over the surroundings of bricks that were tried in vain
  kSomeExcluded,  // places are excluded from the selection
  kUnseenWorth,   // something unseen is left, and going there has not been tried too often
  kWorthWaiting,  // bricks have attempts left, and failures may fade
  kVantageLeft,   // not been back to a place of the survey too often
  kBricksLeft,    // the same, and bricks are known, there or not, that are neither picked nor given up
  kMayBreakOff,   // nothing moves or hangs on the arm
  kForHold,       // why what goes on was halted
  kForResume,
  kForEnd,
};
constexpr int kNumGuards = 26;
const char* toString(Guard guard);

/// What a transition does besides leading to its state. What a result says is recorded before (results.h).
enum class Effect {
  kNone,
  kForgetTries,  // made from this pose: robot and pile may have been moved by people
  // Why the running action is cancelled.
  kHaltForHold,
  kHaltForStop,
  kHaltForTimeUp,
  kHaltForTimeout,
  // Where to drive.
  kGoToSurveyPose,
  kGoToView,
  kGoToUnseen,   // the best view, whose utility is low
  kGoToVantage,  // back to a pose of the survey, the last one first
  // What the selection of views passes over.
  kAllowTriedBricks,
  kClearExcluded,
  kCountRecovery,
  // What to wait for.
  kWaitForHand,  // until the bridge says what hangs on the magnet
  kWaitForArm,
  kWaitForIdleArm,
  kWaitAfterRecovery,
  kWaitForPose,
  kWaitForFading,  // of reported failures
  // Why the mission ends. The first reason stands, but kGiveUp replaces it.
  kGiveUp,
  kEndStopped,
  kEndTimeUp,
  kEndHalted,  // as stopped or as time up, by what it was halted for
  kEndHandUnknown,
  kEndAllDealtWith,
  kEndViewsSpent,
  kEndNotRecovered,
  kEndNoPile,
  kEndNoView,
};
constexpr int kNumEffects = 29;
const char* toString(Effect effect);

struct Transition {
  std::optional<State> from;  // nothing: any action
  Trigger trigger;
  Guard guard;
  State to;
  Effect effect{Effect::kNone};
};

/// All there are. Of those that fit, the first whose guard holds is taken; a trigger of operator or clock that none fits
/// changes nothing.
const std::vector<Transition>& transitions();

/// Null: none fits.
const Transition* nextTransition(State from, Trigger trigger, const std::function<bool(Guard)>& holds);

/// The table in Markdown, and as a graph for dot.
std::string transitionsAsMarkdown();
std::string transitionsAsDot();

}  // namespace pick_mission
