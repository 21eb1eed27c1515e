// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission_ros/mission_words.h"

#include <interactive_mapping_msgs/MissionBrick.h>

namespace pick_mission_ros {

using interactive_mapping_msgs::MissionBrick;
using interactive_mapping_msgs::MissionState;

std::string stateInWords(std::uint8_t state) {
  static_assert(MissionState::NUM_STATES == 21, "every state has its words here");
  switch (state) {
    case MissionState::IDLE:
      return "waiting for start";
    case MissionState::PAUSED:
      return "paused";
    case MissionState::HELD:
      return "held";
    case MissionState::HALTING:
      return "coming to a halt";
    case MissionState::ENDED:
      return "ended";
    case MissionState::BEGIN:
      return "beginning anew";
    case MissionState::CHOOSE:
      return "choosing what is next";
    case MissionState::PLAN_CLEAR:
      return "planning the arm out of the view";
    case MissionState::CLEAR:
      return "moving the arm out of the view";
    case MissionState::LOOK:
      return "looking: new images into the map";
    case MissionState::DETECT:
      return "detecting bricks";
    case MissionState::REPORT:
      return "reporting a failure";
    case MissionState::PLAN_PICK:
      return "planning a pick";
    case MissionState::PICK:
      return "picking";
    case MissionState::PLAN_STOW:
      return "planning to stow";
    case MissionState::STOW:
      return "stowing";
    case MissionState::LET_GO:
      return "letting go";
    case MissionState::SELECT:
      return "selecting the next view";
    case MissionState::DRIVE:
      return "driving to the next view";
    case MissionState::RECOVER:
      return "recovering the arm";
    case MissionState::WAIT:
      return "waiting";
    default:
      return "unknown state " + std::to_string(state);
  }
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
  static_assert(MissionState::NUM_END_REASONS == 18, "every end reason has its words here");
  switch (reason) {
    case MissionState::NOT_ENDED:
      return "not ended";
    case MissionState::NO_BRICK_LEFT:
      return "no brick is left";
    case MissionState::BRICKS_EXHAUSTED:
      return "what is left has used its attempts";
    case MissionState::NOTHING_WORTH_GOING:
      return "no place is worth going to";
    case MissionState::NO_PROGRESS:
      return "view after view without progress";
    case MissionState::TIME_UP:
      return "time is up";
    case MissionState::STOPPED:
      return "stopped by the operator";
    case MissionState::NEEDS_PERSON:
      return "a person has to look at the robot";
    case MissionState::BRICK_IN_HAND:
      return "a brick in the hand cannot be stowed, or nobody knows whether one is held";
    case MissionState::PLANNING_FAILED:
      return "planning failed again and again";
    case MissionState::ARM_FAILED:
      return "the arm failed again and again";
    case MissionState::PICKS_FAILED:
      return "picks failed again and again";
    case MissionState::LOOKS_FAILED:
      return "the map gets no images";
    case MissionState::DETECTION_FAILED:
      return "the detection failed again and again";
    case MissionState::SELECTION_FAILED:
      return "the selection of views failed again and again";
    case MissionState::DRIVES_FAILED:
      return "driving failed again and again";
    case MissionState::RECOVERY_FAILED:
      return "the arm could not be recovered";
    case MissionState::NOT_READY:
      return "what was waited for did not come";
    default:
      return "unknown reason " + std::to_string(reason);
  }
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
