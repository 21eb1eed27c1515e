// SPDX-License-Identifier: BSD-3-Clause
#include "mission.h"

namespace pick_mission {
namespace {

/// Has to come to its end, for it moves the arm or a brick hangs on it.
bool movesArm(State action) {
  return handlesBrick(action) || action == State::kClear || action == State::kPlanStow || action == State::kRecover;
}

bool needsClearView(State action) {
  return action == State::kLook || action == State::kDetect || action == State::kPlanPick || action == State::kPick ||
         action == State::kSelect;
}

/// Looks for the next brick, or tells of the last one.
bool mayGoBesidePick(State action) {
  return action != State::kPick && (needsClearView(action) || action == State::kReport);
}

bool isArmReady(State action, const Mission& mission) {
  if (mission.carrying) return true;  // it is leaving the view
  if (needsClearView(action)) return mission.hand == Hand::kEmpty && mission.arm != ArmIs::kAnywhere;
  if (action == State::kDrive) return mission.hand == Hand::kEmpty && mission.arm == ArmIs::kFolded;
  if (action == State::kPlanClear || action == State::kClear) return mission.hand == Hand::kEmpty;
  if (action == State::kPlanStow || action == State::kStow) return mission.hand == Hand::kHolding;
  if (action == State::kLetGo) return mission.hand != Hand::kEmpty;
  return true;
}

/// With the one that is being picked, all are.
bool isLastBrick(const Mission& mission) {
  const BrickLedger& ledger = mission.memory.ledger;
  return mission.config.bricks_total >= 0 &&
         numPicked(mission.memory) + ledger.numExhausted() + 1 >= mission.config.bricks_total;
}

}  // namespace

bool handlesBrick(State action) {
  return action == State::kPick || action == State::kStow || action == State::kLetGo;
}

bool isOverOfItself(const Memory& memory) {
  return memory.is_ending && memory.end_reason <= EndReason::kNoProgress;
}

// One case for each guard, in one place.
bool holds(Guard guard, const Mission& mission) {
  const MissionConfig& config = mission.config;
  const Memory& memory = mission.memory;
  switch (guard) {
    case Guard::kAlways:
      return true;
    case Guard::kHandFull:
      return mission.hand == Hand::kHolding;
    case Guard::kStowBeforeEnd:
      return mission.hand == Hand::kHolding && !memory.is_ending;
    case Guard::kHandUnknown:
      return mission.hand == Hand::kUnknown;
    case Guard::kHandUnknownTooLong:
      return mission.hand == Hand::kUnknown && mission.unknown_hand_waits >= config.attempts.max_failures_in_a_row;
    case Guard::kBegunBefore:
      return memory.start_pose.has_value();
    case Guard::kEnding:
      return memory.is_ending;
    case Guard::kTimeUp:
      // A brick that is carried away is stowed before.
      return memory.used_s >= config.time.limit_s && !mission.carrying;
    case Guard::kPauseWanted:
      return mission.is_pause_wanted;
    case Guard::kLooksAhead:
      return config.look.while_carrying && !mission.running->is_looked_ahead && !mission.is_pause_wanted &&
             !memory.is_ending && memory.places_used + 1 < capacityOf(config) && memory.used_s < config.time.limit_s &&
             !isLastBrick(mission);
    case Guard::kCarries:
      return mission.carrying.has_value();
    case Guard::kPickDue:
      return mission.carrying && (mission.is_pause_wanted || !mayGoBesidePick(mission.state));
    case Guard::kNextPlanned:
      return mission.is_next_planned && memory.used_s < config.time.limit_s;
    case Guard::kArmNotReady:
      return !isArmReady(mission.state, mission);
    case Guard::kViewClear:
      return mission.arm != ArmIs::kAnywhere;
    case Guard::kDriveDue:
      return mission.is_drive_due;
    case Guard::kReportLeft:
      return !memory.reports.empty();
    case Guard::kUnloadDue:
      return memory.places_used > 0 &&
             (memory.is_ending ? isOverOfItself(memory) : memory.places_used >= capacityOf(config));
    case Guard::kAtDepot:
      return mission.goal.why == DriveFor::kDepot;
    case Guard::kSurveyLeft:
      return memory.survey_index < numSurveyPoses(mission);
    case Guard::kAllDealtWith:
      return config.bricks_total >= 0 && numPicked(memory) + memory.ledger.numExhausted() >= config.bricks_total;
    case Guard::kChoiceDue:
      return config.views.choose_after_each_pick && !mission.is_place_chosen;
    case Guard::kStays:
      return mission.selection.stays;
    case Guard::kStaysToWait:
      return mission.selection.stays && mission.carrying && !holds(Guard::kBrickHere, mission);
    case Guard::kBrickHere:
      return mission.pick_failures_here < config.attempts.max_pick_failures_per_view &&
             mission.plan_failures_here < config.attempts.max_plan_failures_per_view && memory.nextBrick().has_value();
    case Guard::kViewsSpent:
      return !mission.carrying && memory.fruitless_views >= config.views.max_fruitless;
    case Guard::kMayRecover:
      return mission.recoveries < config.attempts.max_recoveries_in_a_row &&
             (!mission.is_protective_stop || config.unlocks_protective_stop);
    case Guard::kKeepsAway:
      return !zonesToKeepAwayFrom(mission).empty();
    case Guard::kSomeExcluded:
      return !memory.excluded.empty();
    case Guard::kUnseenWorth:
      return mission.selection.has_unseen && mission.selection.T_map_base && !mission.selection.stays &&
             memory.low_utility_views < config.views.max_low_utility;
    case Guard::kWorthWaiting:
      return memory.ledger.numOpen() > 0 && memory.fade_waits < config.views.max_fade_waits;
    case Guard::kVantageLeft:
      return numSurveyPoses(mission) > 0 && memory.vantage_drives < config.views.max_vantage_drives;
    case Guard::kBricksLeft:
      return holds(Guard::kVantageLeft, mission) && memory.ledger.numLeft() > 0;
    case Guard::kMayBreakOff:
      return mission.hand == Hand::kEmpty && !movesArm(mission.state);
    case Guard::kForHold:
      return mission.halt_for == HaltFor::kHold;
    case Guard::kForResume:
      return mission.halt_for == HaltFor::kResume;
    case Guard::kForEnd:
      return mission.halt_for == HaltFor::kStop || mission.halt_for == HaltFor::kTimeUp;
  }
  return false;
}

}  // namespace pick_mission
