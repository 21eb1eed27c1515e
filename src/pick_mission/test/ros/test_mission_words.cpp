// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission_ros/mission_words.h"

#include <set>

#include <gmock/gmock.h>
#include <interactive_mapping_msgs/MissionBrick.h>

#include "pick_mission/mission_types.h"

namespace pick_mission_ros {
namespace {

using interactive_mapping_msgs::MissionBrick;
using interactive_mapping_msgs::MissionState;
using pick_mission::State;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

MissionState inState(State state) {
  MissionState message;
  message.state = static_cast<std::uint8_t>(state);
  message.brick = -1;
  return message;
}

TEST(MissionWords, EveryStateHasItsOwn) {
  std::set<std::string> words;
  for (int i = 0; i < MissionState::NUM_STATES; ++i) {
    const std::string state = stateInWords(static_cast<std::uint8_t>(i));
    EXPECT_THAT(state, Not(HasSubstr("unknown"))) << i;
    EXPECT_FALSE(state.empty()) << i;
    words.insert(state);
  }
  EXPECT_EQ(words.size(), static_cast<std::size_t>(MissionState::NUM_STATES));
}

TEST(MissionWords, EveryEndReasonHasItsOwn) {
  std::set<std::string> words;
  for (int i = 0; i < MissionState::NUM_END_REASONS; ++i) {
    const std::string reason = endReasonInWords(static_cast<std::uint8_t>(i));
    EXPECT_THAT(reason, Not(HasSubstr("unknown reason"))) << i;
    words.insert(reason);
  }
  EXPECT_EQ(words.size(), static_cast<std::size_t>(MissionState::NUM_END_REASONS));
}

TEST(MissionWords, NewerValuesAreToldByTheirNumber) {
  EXPECT_EQ(stateInWords(MissionState::NUM_STATES), "unknown state 22");
  EXPECT_EQ(endReasonInWords(MissionState::NUM_END_REASONS), "unknown reason 18");
  EXPECT_EQ(statusInWords(200), "unknown status 200");
}

TEST(MissionWords, NameTheBrickWhereTheStateIsAboutOne) {
  MissionState state = inState(State::kPick);
  EXPECT_EQ(stateInWords(state), "picking");
  state.brick = 7;
  EXPECT_EQ(stateInWords(state), "picking brick 7");
  for (const State about : {State::kPlanPick, State::kPlanStow, State::kStow, State::kLetGo}) {
    state.state = static_cast<std::uint8_t>(about);
    EXPECT_THAT(stateInWords(state), HasSubstr("brick 7")) << toString(about);
  }
  for (const State other : {State::kDrive, State::kEnded, State::kLook, State::kHeld}) {
    state.state = static_cast<std::uint8_t>(other);
    EXPECT_THAT(stateInWords(state), Not(HasSubstr("7"))) << toString(other);
  }
}

// By the core: whatever acts is active; the junctions are left at once.
TEST(MissionWords, ActiveIsWhatTheMachineCallsAnActionOrAJunction) {
  for (int i = 0; i < pick_mission::kNumStates; ++i) {
    const auto state = static_cast<State>(i);
    const bool is_junction = state == State::kBegin || state == State::kChoose;
    EXPECT_EQ(isActive(static_cast<std::uint8_t>(i)), pick_mission::isAction(state) || is_junction) << toString(state);
  }
  EXPECT_FALSE(isActive(MissionState::NUM_STATES));
}

// The words are chosen by the message's values, which are the machine's: a state that is put in between shows here.
TEST(MissionWords, FitTheMachinesStates) {
  EXPECT_EQ(static_cast<int>(MissionState::NUM_STATES), pick_mission::kNumStates);
  EXPECT_EQ(static_cast<int>(MissionState::NUM_END_REASONS), pick_mission::kNumEndReasons);
  EXPECT_THAT(stateInWords(inState(State::kDrive)), StartsWith("driving"));
  EXPECT_THAT(stateInWords(inState(State::kSelect)), StartsWith("selecting"));
  EXPECT_THAT(stateInWords(inState(State::kWait)), StartsWith("waiting"));
  EXPECT_THAT(stateInWords(inState(State::kHeld)), StartsWith("held"));
  EXPECT_EQ(endReasonInWords(static_cast<std::uint8_t>(pick_mission::EndReason::kTimeUp)), "time is up");
  EXPECT_THAT(endReasonInWords(static_cast<std::uint8_t>(pick_mission::EndReason::kNotReady)),
              HasSubstr("did not come"));
}

TEST(MissionWords, StatusesDifferInWordAndColour) {
  std::set<std::string> words;
  for (std::uint8_t a = MissionBrick::OPEN; a <= MissionBrick::AWAY; ++a) {
    words.insert(statusInWords(a));
    for (std::uint8_t b = MissionBrick::OPEN; b < a; ++b) {
      EXPECT_FALSE(colorOfStatus(a) == colorOfStatus(b)) << statusInWords(a) << ", " << statusInWords(b);
    }
  }
  EXPECT_EQ(words.size(), 5U);
}

}  // namespace
}  // namespace pick_mission_ros
