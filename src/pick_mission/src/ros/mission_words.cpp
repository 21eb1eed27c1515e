// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission_ros/mission_words.h"

#include <interactive_mapping_enums/mission_state.h>
#include <interactive_mapping_msgs/MissionBrick.h>

namespace pick_mission_ros {

using interactive_mapping::EndReason;
using interactive_mapping_msgs::MissionBrick;
using interactive_mapping_msgs::MissionState;
using State = interactive_mapping::MissionState;

std::string stateInWords(std::uint8_t state) {
  switch (static_cast<State>(state)) {
    case State::kIdle:
      return "waiting for start";
    case State::kPaused:
      return "paused";
    case State::kHeld:
      return "held";
    case State::kHalting:
      return "coming to a halt";
    case State::kEnded:
      return "ended";
    case State::kBegin:
      return "beginning from scratch";
    case State::kChoose:
      return "choosing what is next";
    case State::kPlanClear:
      return "planning the arm out of the view";
    case State::kClear:
      return "moving the arm out of the view";
    case State::kLook:
      return "looking: new images into the map";
    case State::kDetect:
      return "detecting bricks";
    case State::kReport:
      return "reporting a failure";
    case State::kPlanPick:
      return "planning a pick";
    case State::kPick:
      return "picking";
    case State::kPlanStow:
      return "planning to stow";
    case State::kStow:
      return "stowing";
    case State::kLetGo:
      return "letting go";
    case State::kSelect:
      return "selecting the next view";
    case State::kDrive:
      return "driving to the next view";
    case State::kRecover:
      return "recovering the arm";
    case State::kWait:
      return "waiting";
    case State::kUnload:
      return "at the depot: unload the container";
  }
  return "unknown state " + std::to_string(state);
}

std::string stateInWords(const MissionState& state) {
  std::string words = stateInWords(state.state);
  if (state.brick < 0) return words;
  const std::string brick = "brick " + std::to_string(state.brick);
  switch (state.state) {
    case MissionState::PLAN_PICK:
      return "planning to pick " + brick;
    case MissionState::PLAN_STOW:
      return "planning to stow " + brick;
    case MissionState::PICK:
    case MissionState::STOW:
      return words + " " + brick;
    case MissionState::LET_GO:
      return "letting " + brick + " go";
    default:
      return words;
  }
}

std::string endReasonInWords(std::uint8_t reason) {
  switch (static_cast<EndReason>(reason)) {
    case EndReason::kNotEnded:
      return "not ended";
    case EndReason::kNoBrickLeft:
      return "no brick is left";
    case EndReason::kBricksExhausted:
      return "the remaining bricks have used their attempts";
    case EndReason::kNothingWorthGoing:
      return "no pose has enough utility";
    case EndReason::kNoProgress:
      return "view after view without progress";
    case EndReason::kTimeUp:
      return "time is up";
    case EndReason::kStopped:
      return "stopped by the operator";
    case EndReason::kNeedsPerson:
      return "a person must check the robot";
    case EndReason::kBrickInHand:
      return "a held brick cannot be stowed, or it is not known whether one is held";
    case EndReason::kPlanningFailed:
      return "planning failed again and again";
    case EndReason::kArmFailed:
      return "the arm failed again and again";
    case EndReason::kPicksFailed:
      return "picks failed again and again";
    case EndReason::kLooksFailed:
      return "the map gets no images";
    case EndReason::kDetectionFailed:
      return "the detection failed again and again";
    case EndReason::kSelectionFailed:
      return "the selection of views failed again and again";
    case EndReason::kDrivesFailed:
      return "driving failed again and again";
    case EndReason::kRecoveryFailed:
      return "the arm could not be recovered";
    case EndReason::kNotReady:
      return "what was waited for did not come";
  }
  return "unknown reason " + std::to_string(reason);
}

std::string statusInWords(std::uint8_t status) {
  switch (status) {
    case MissionBrick::OPEN:
      return "open";
    case MissionBrick::CURRENT:
      return "in work";
    case MissionBrick::PICKED:
      return "picked";
    case MissionBrick::EXHAUSTED:
      return "exhausted";
    case MissionBrick::AWAY:
      return "away";
    default:
      return "unknown status " + std::to_string(status);
  }
}

bool isActive(std::uint8_t state) {
  switch (state) {
    case MissionState::IDLE:
    case MissionState::PAUSED:
    case MissionState::HELD:
    case MissionState::HALTING:
    case MissionState::ENDED:
    case MissionState::UNLOAD:
      return false;
    default:
      return state < MissionState::NUM_STATES;
  }
}

bool operator==(const Rgb& a, const Rgb& b) {
  return a.r == b.r && a.g == b.g && a.b == b.b;
}

Rgb colorOfStatus(std::uint8_t status) {
  switch (status) {
    case MissionBrick::OPEN:
      return {144, 202, 249};
    case MissionBrick::CURRENT:
      return {255, 193, 7};
    case MissionBrick::PICKED:
      return {27, 94, 32};
    case MissionBrick::EXHAUSTED:
      return {198, 40, 40};
    case MissionBrick::AWAY:
      return {176, 176, 176};
    default:
      return {255, 0, 255};  // meant to be noticed
  }
}

}  // namespace pick_mission_ros
