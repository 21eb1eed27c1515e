// SPDX-License-Identifier: BSD-3-Clause
#include "mission.h"

#include <algorithm>
#include <utility>

#include "wording.h"

namespace pick_mission {
namespace {

/// Why the mission ends if no view is to be had.
EndReason reasonOfLeftovers(const Mission& mission) {
  const BrickLedger& ledger = mission.memory.ledger;
  if (ledger.numLeft() > 0 || numNeverFound(mission) > 0) return EndReason::kNothingWorthGoing;
  return ledger.numExhausted() > 0 ? EndReason::kBricksExhausted : EndReason::kNoBrickLeft;
}

void setEnd(Memory& memory, EndReason reason, const std::string& message) {
  memory.is_ending = true;
  memory.end_reason = reason;
  memory.end_message = message;
}

void applyEnd(Effect effect, const Cause& cause, Mission& mission) {
  Memory& memory = mission.memory;
  const std::string action = std::string(toString(mission.state)) + ": ";
  if (effect == Effect::kGiveUp) {
    setEnd(memory, cause.end, std::string(toString(cause.action)) + ": " + cause.event + "; " + cause.reason);
  }
  // A mission whose bricks are only to be unloaded yet can still be stopped.
  const bool is_stop =
      effect == Effect::kEndStopped || (effect == Effect::kEndHalted && mission.halt_for == HaltFor::kStop);
  if (memory.is_ending && !(is_stop && isOverOfItself(memory))) return;
  const bool has_exhausted = memory.ledger.numExhausted() > 0;
  switch (effect) {
    case Effect::kEndHalted:
      return applyEnd(mission.halt_for == HaltFor::kTimeUp ? Effect::kEndTimeUp : Effect::kEndStopped, cause, mission);
    case Effect::kEndStopped:
      return setEnd(memory, EndReason::kStopped, "by the operator");
    case Effect::kEndTimeUp:
      return setEnd(memory, EndReason::kTimeUp, "after " + std::to_string(memory.used_s) + " s");
    case Effect::kEndHandUnknown:
      return setEnd(memory, EndReason::kBrickInHand,
                    "the arm's bridge does not report whether the magnet holds something");
    case Effect::kEndAllDealtWith:
      return setEnd(memory, has_exhausted ? EndReason::kBricksExhausted : EndReason::kNoBrickLeft,
                    "all " + std::to_string(mission.config.bricks_total) + " bricks");
    case Effect::kEndViewsSpent:
      return setEnd(
          memory, memory.ledger.numLeft() == 0 && has_exhausted ? EndReason::kBricksExhausted : EndReason::kNoProgress,
          std::to_string(memory.fruitless_views) + " views in a row without a pick or a new brick" +
              leftInWords(mission));
    case Effect::kEndNotRecovered:
      return setEnd(memory, mission.is_protective_stop ? EndReason::kNeedsPerson : EndReason::kRecoveryFailed,
                    action + withMessage(cause.event, cause.reason));
    case Effect::kEndNoPile:
    case Effect::kEndNoView: {
      EndReason reason = reasonOfLeftovers(mission);
      // With something standing there that is no known brick, it is not known that none is left.
      if (effect == Effect::kEndNoView && reason == EndReason::kNoBrickLeft) reason = EndReason::kNothingWorthGoing;
      return setEnd(memory, reason, action + withMessage(cause.event, cause.reason) + leftInWords(mission));
    }
    default:
      return;
  }
}

}  // namespace

void apply(Effect effect, const Cause& cause, Mission& mission) {
  const MissionConfig& config = mission.config;
  Memory& memory = mission.memory;
  const auto haltFor = [&](HaltFor why) { mission.halt_for = why; };
  const auto goTo = [&](const Pose2d& T_map_base, DriveFor why) {
    mission.goal = {why, T_map_base};
    mission.is_drive_due = true;
  };
  const auto waitFor = [&](const command::Wait& wait) { mission.wait = wait; };
  switch (effect) {
    case Effect::kNone:
      return;
    case Effect::kForgetTries:
      return forgetTries(mission, cause.T_map_base);
    case Effect::kHaltForHold:
      return haltFor(HaltFor::kHold);
    case Effect::kHaltForStop:
      return haltFor(HaltFor::kStop);
    case Effect::kHaltForTimeUp:
      return haltFor(HaltFor::kTimeUp);
    case Effect::kHaltForTimeout:
      return haltFor(HaltFor::kTimeout);
    case Effect::kGoToDepot:
      return goTo(base_navigation::compose(*memory.start_pose, config.depot.pose()), DriveFor::kDepot);
    case Effect::kGoToSurveyPose:
      return goTo(surveyPose(mission, memory.survey_index), DriveFor::kSurvey);
    case Effect::kGoToUnseen:
      ++memory.low_utility_views;
      [[fallthrough]];
    case Effect::kGoToView:
      return goTo(*mission.selection.T_map_base, DriveFor::kView);
    case Effect::kStayHere:
      mission.is_place_chosen = mission.is_view_untried = true;
      return;
    case Effect::kGoToVantage: {
      // The last one first: it is the nearest to the pile.
      const std::size_t back = static_cast<std::size_t>(memory.vantage_drives++) % numSurveyPoses(mission);
      return goTo(surveyPose(mission, numSurveyPoses(mission) - 1 - back), DriveFor::kVantage);
    }
    case Effect::kLookAhead:
      mission.carrying = std::exchange(mission.running, std::nullopt);
      mission.carrying->is_looked_ahead = true;
      mission.is_place_chosen = false;
      ++memory.scene;
      return;
    case Effect::kAwaitPickWithPlan:
      mission.is_next_planned = true;
      [[fallthrough]];
    case Effect::kAwaitPick:
      return takeUpPick(mission);
    case Effect::kAllowTriedBricks:
      mission.approaches_tried_bricks = true;
      return;
    case Effect::kClearExcluded:
      memory.excluded.clear();
      return tryAgainFromHere(mission);
    case Effect::kCountRecovery:
      ++mission.recoveries;
      return;
    case Effect::kWaitForHand:
      ++mission.unknown_hand_waits;
      [[fallthrough]];
    case Effect::kWaitForArm:
      return waitFor({config.time.ready_timeout_s, WaitUntil::kArmReady});
    case Effect::kWaitForIdleArm:
      return waitFor({config.time.ready_timeout_s, WaitUntil::kArmIdle});
    case Effect::kWaitAfterRecovery:
      return waitFor({config.time.recover_wait_s, WaitUntil::kArmReady});
    case Effect::kWaitForPose:
      // Whatever it is that is late: without a pose nothing comes of asking for it again.
      return waitFor({std::max(config.time.ready_timeout_s, config.time.retry_wait_s), WaitUntil::kPlaceKnown,
                      config.time.retry_wait_s});
    case Effect::kWaitForFading:
      ++memory.fade_waits;
      tryAgainFromHere(mission);
      return waitFor({config.views.fade_wait_s, WaitUntil::kLimit});
    default:
      return applyEnd(effect, cause, mission);
  }
}

}  // namespace pick_mission
