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
  kPileLeft,        // the brick is away from the pile
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
  kUnloaded,       // the container is empty
  // Of the machine itself.
  kAtOnce,    // junctions
  kEntering,  // what goes before each action
};
inline constexpr interactive_mapping::Names<Trigger> kTriggerNames = {
    {"done", Trigger::kDone},
    {"retry here", Trigger::kRetryHere},
    {"next brick", Trigger::kNextBrick},
    {"other view", Trigger::kOtherView},
    {"look from afar", Trigger::kVantage},
    {"low utility", Trigger::kLowUtility},
    {"no pile", Trigger::kNoPile},
    {"let go again", Trigger::kLetGoAgain},
    {"pile left", Trigger::kPileLeft},
    {"wait first", Trigger::kWaitFirst},
    {"wait while busy", Trigger::kArmBusy},
    {"recover", Trigger::kRecover},
    {"held by operator", Trigger::kHeldByOperator},
    {"give up", Trigger::kGiveUp},
    {"start", Trigger::kStart},
    {"pause", Trigger::kPause},
    {"resume", Trigger::kResume},
    {"hold", Trigger::kHold},
    {"stop", Trigger::kStop},
    {"time is up", Trigger::kTimeUp},
    {"takes too long", Trigger::kActionTimeout},
    {"halted", Trigger::kHalted},
    {"unloaded", Trigger::kUnloaded},
    {"at once", Trigger::kAtOnce},
    {"entering", Trigger::kEntering},
};
constexpr int kNumTriggers = static_cast<int>(kTriggerNames.size());
constexpr const char* toString(Trigger trigger) {
  return interactive_mapping::nameOf(trigger, kTriggerNames);
}

/// What must hold for a transition to be taken.
enum class Guard {
  kAlways,
  kHandFull,
  kStowBeforeEnd,  // the same, and nothing has been given up before: else it would be tried without end
  kHandUnknown,
  kHandUnknownTooLong,
  kBegunBefore,  // by a process that is no more
  kEnding,       // the mission is over but for the brick in the hand
  kTimeUp,
  kPauseWanted,
  kLooksAhead,   // the next brick may be looked for while this one is carried away
  kCarries,      // while it runs
  kPickDue,      // the same, and the action needs the arm, or a pause is wanted
  kNextPlanned,  // the pick of the next brick
  kArmNotReady,  // the action needs an empty hand, or the arm out of view or folded, and it is not so
  kViewClear,    // the arm is out of the camera's view
  kDriveDue,     // somewhere was chosen to drive to
  kReportLeft,   // a failure not yet reported to the selection
  kUnloadDue,    // no place in the container is left, or the mission is over and some are used; nothing was given up
  kAtDepot,
  kSurveyLeft,
  kAllDealtWith,  // as many bricks as there are have been picked or have used their attempts
  kChoiceDue,     // a view is to be selected before the next pick
  kBrickHere,     // one to be tried from here
  kStays,         // the selected view is where the robot stands
  kStaysToWait,   // ... where there is none to be tried until the brick that is carried away is stowed
  kViewsSpent,    // too many views in a row without a pick or a new brick
  kMayRecover,    // not too often in a row; no protective stop, or the configuration lets the program unlock it
  kKeepsAway,     // the selection excludes poses near bricks tried without success
  kSomeExcluded,  // places are excluded from the selection
  kUnseenWorth,   // something unseen is left, and going there has not been tried too often
  kWorthWaiting,  // bricks have attempts left, and failures may fade
  kVantageLeft,   // not been back to a place of the survey too often
  kBricksLeft,    // the same, and bricks are known, there or not, that are neither picked nor given up
  kMayBreakOff,   // nothing moves or hangs on the arm
  kForHold,       // why the running action was halted
  kForResume,
  kForEnd,
};
inline constexpr interactive_mapping::Names<Guard> kGuardNames = {
    {"", Guard::kAlways},
    {"brick in the hand", Guard::kHandFull},
    {"brick in the hand, nothing given up before", Guard::kStowBeforeEnd},
    {"hand unknown", Guard::kHandUnknown},
    {"hand unknown too long", Guard::kHandUnknownTooLong},
    {"started by an earlier process", Guard::kBegunBefore},
    {"mission over", Guard::kEnding},
    {"time is up", Guard::kTimeUp},
    {"pause wanted", Guard::kPauseWanted},
    {"a place is free after this brick, no pause wanted", Guard::kLooksAhead},
    {"a brick is being carried away", Guard::kCarries},
    {"a brick is being carried away; needs the arm, or pause wanted", Guard::kPickDue},
    {"next pick planned", Guard::kNextPlanned},
    {"needs empty hand, or arm out of view or folded, and is not so", Guard::kArmNotReady},
    {"arm out of the camera's view", Guard::kViewClear},
    {"drive due", Guard::kDriveDue},
    {"failure not reported yet", Guard::kReportLeft},
    {"container full or in the way, or mission over and container not empty", Guard::kUnloadDue},
    {"at the depot", Guard::kAtDepot},
    {"survey not finished", Guard::kSurveyLeft},
    {"every brick picked or exhausted", Guard::kAllDealtWith},
    {"a pick or a failure since the last selection", Guard::kChoiceDue},
    {"brick to be tried from here", Guard::kBrickHere},
    {"best where the robot stands", Guard::kStays},
    {"best where the robot stands, no brick to be tried from here, one is being carried away", Guard::kStaysToWait},
    {"too many fruitless views", Guard::kViewsSpent},
    {"not recovered too often, no protective stop or may unlock it", Guard::kMayRecover},
    {"keeps away from bricks tried without success", Guard::kKeepsAway},
    {"places are excluded", Guard::kSomeExcluded},
    {"unseen ground, not driven to too often", Guard::kUnseenWorth},
    {"bricks with attempts left, not waited too often", Guard::kWorthWaiting},
    {"survey pose, not returned to too often", Guard::kVantageLeft},
    {"bricks neither picked nor given up, survey pose not returned to too often", Guard::kBricksLeft},
    {"hand empty, arm at rest", Guard::kMayBreakOff},
    {"for hold", Guard::kForHold},
    {"for hold, resumed since", Guard::kForResume},
    {"for stop or time", Guard::kForEnd},
};
constexpr int kNumGuards = static_cast<int>(kGuardNames.size());
constexpr const char* toString(Guard guard) {
  return interactive_mapping::nameOf(guard, kGuardNames);
}

/// What a transition does besides leading to its state. What a result says is recorded before (results.cpp).
enum class Effect {
  kNone,
  kForgetTries,  // made from this pose: robot and pile may have been moved by people
  // Why the running action is cancelled.
  kHaltForHold,
  kHaltForStop,
  kHaltForTimeUp,
  kHaltForTimeout,
  // Where to drive.
  kGoToDepot,
  kGoToSurveyPose,
  kGoToView,
  kGoToUnseen,   // the best view, whose utility is low
  kGoToVantage,  // back to a pose of the survey, the last one first
  kStayHere,
  // Of a pick that carries its brick away.
  kLookAhead,
  kAwaitPick,
  kAwaitPickWithPlan,  // of the next one
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
inline constexpr interactive_mapping::Names<Effect> kEffectNames = {
    {"", Effect::kNone},
    {"forget what was tried from here", Effect::kForgetTries},
    {"cancel, for hold", Effect::kHaltForHold},
    {"cancel, for stop", Effect::kHaltForStop},
    {"cancel, for time", Effect::kHaltForTimeUp},
    {"cancel, as no answer", Effect::kHaltForTimeout},
    {"goal: depot", Effect::kGoToDepot},
    {"goal: next survey place", Effect::kGoToSurveyPose},
    {"goal: selected view", Effect::kGoToView},
    {"goal: best view, count it", Effect::kGoToUnseen},
    {"goal: survey place, count it", Effect::kGoToVantage},
    {"pick from here", Effect::kStayHere},
    {"the pick runs beside", Effect::kLookAhead},
    {"await the running pick", Effect::kAwaitPick},
    {"await the running pick, keep the plan", Effect::kAwaitPickWithPlan},
    {"allow poses near bricks tried without success", Effect::kAllowTriedBricks},
    {"clear excluded places", Effect::kClearExcluded},
    {"count recovery", Effect::kCountRecovery},
    {"count, until arm is ready", Effect::kWaitForHand},
    {"until arm is ready", Effect::kWaitForArm},
    {"until arm is idle", Effect::kWaitForIdleArm},
    {"recovery wait, until arm is ready", Effect::kWaitAfterRecovery},
    {"until pose is known", Effect::kWaitForPose},
    {"count, for failures to fade", Effect::kWaitForFading},
    {"end reason of the failure", Effect::kGiveUp},
    {"end: stopped", Effect::kEndStopped},
    {"end: time_up", Effect::kEndTimeUp},
    {"end: stopped or time_up", Effect::kEndHalted},
    {"end: brick_in_hand", Effect::kEndHandUnknown},
    {"end: no_brick_left or bricks_exhausted", Effect::kEndAllDealtWith},
    {"end: no_progress or bricks_exhausted", Effect::kEndViewsSpent},
    {"end: recovery_failed or needs_person", Effect::kEndNotRecovered},
    {"end: no_brick_left, bricks_exhausted or nothing_worth_going", Effect::kEndNoPile},
    {"end: nothing_worth_going or bricks_exhausted", Effect::kEndNoView},
};
constexpr int kNumEffects = static_cast<int>(kEffectNames.size());
constexpr const char* toString(Effect effect) {
  return interactive_mapping::nameOf(effect, kEffectNames);
}

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

/// The table in Markdown.
std::string transitionsAsMarkdown();

}  // namespace pick_mission
