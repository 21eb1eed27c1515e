// SPDX-License-Identifier: BSD-3-Clause
#include "rviz/mission_view_model.h"

#include <cmath>
#include <limits>
#include <set>

#include <gmock/gmock.h>
#include <interactive_mapping_msgs/MissionBrick.h>
#include <interactive_mapping_msgs/MissionFailure.h>
#include <interactive_mapping_msgs/NbvSegment.h>

namespace pick_mission_rviz {
namespace {

using interactive_mapping_msgs::MissionBrick;
using interactive_mapping_msgs::MissionFailure;
using interactive_mapping_msgs::MissionState;
using interactive_mapping_msgs::NbvSegment;
using testing::ElementsAre;
using testing::Field;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::SizeIs;

const char kNode[] = "/pick_mission";
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

MissionState stateOf(std::uint8_t value) {
  MissionState state;
  state.header.stamp = ros::Time(1000.0);
  state.since = ros::Time(988.0);
  state.state = value;
  state.brick = -1;
  state.bricks_total = -1;
  state.used_s = 600.0;
  state.limit_s = 2400.0;
  return state;
}

MissionView fresh(const MissionState& state) {
  return makeView(&state, 0.5, kNode);
}

MissionBrick brick(int id, std::uint8_t status) {
  MissionBrick out;
  out.id = id;
  out.type = "brick";
  out.status = status;
  return out;
}

/// As WCAG 2.1 defines it, written anew.
double contrast(const Rgb& a, const Rgb& b) {
  const auto luminance = [](const Rgb& rgb) {
    double sum = 0.0;
    for (const auto& [byte, weight] : {std::pair{rgb.r, 0.2126}, {rgb.g, 0.7152}, {rgb.b, 0.0722}}) {
      const double c = byte / 255.0;
      sum += weight * (c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4));
    }
    return sum;
  };
  const double one = luminance(a);
  const double other = luminance(b);
  return (std::max(one, other) + 0.05) / (std::min(one, other) + 0.05);
}

// WCAG 2.1, level AA, for letters of normal size.
constexpr double kLeastContrast = 4.5;

/// "start pause resume stop hold", those that may be pressed.
std::string buttonsOf(const MissionView& view) {
  std::string out;
  if (view.can_start) out += "start ";
  if (view.can_pause) out += "pause ";
  if (view.can_resume) out += "resume ";
  if (view.can_stop) out += "stop ";
  if (view.can_hold) out += "hold";
  return out;
}

TEST(MissionView, ButtonsAreThoseThatMakeSense) {
  MissionState idle = stateOf(MissionState::IDLE);
  EXPECT_EQ(buttonsOf(fresh(idle)), "start resume stop hold") << "interrupted: it can go on or be ended";
  idle.used_s = 0.0;
  EXPECT_EQ(buttonsOf(fresh(idle)), "start resume hold") << "not begun; it releases a hold that was given before";
  EXPECT_EQ(buttonsOf(fresh(stateOf(MissionState::PAUSED))), "resume stop hold");
  EXPECT_EQ(buttonsOf(fresh(stateOf(MissionState::HELD))), "resume stop hold");
  EXPECT_EQ(buttonsOf(fresh(stateOf(MissionState::HALTING))), "resume stop hold");
  EXPECT_EQ(buttonsOf(fresh(stateOf(MissionState::ENDED))), "start resume hold") << "the same after it";
  for (std::uint8_t value = MissionState::BEGIN; value < MissionState::NUM_STATES; ++value) {
    MissionState state = stateOf(value);
    EXPECT_EQ(buttonsOf(fresh(state)), "pause stop hold") << fresh(state).title;
    state.is_pause_wanted = true;
    EXPECT_EQ(buttonsOf(fresh(state)), "resume stop hold") << "a pause that is wanted can be taken back";
  }
  EXPECT_EQ(buttonsOf(fresh(stateOf(MissionState::NUM_STATES))), "stop hold") << "of a newer node";
}

TEST(MissionView, HoldCanAlwaysBePressed) {
  for (int value = 0; value < 256; ++value) {
    const MissionState state = stateOf(static_cast<std::uint8_t>(value));
    for (const double age_s : {0.0, 2.9, 3.1, 1e6}) EXPECT_TRUE(makeView(&state, age_s, kNode).can_hold);
  }
  EXPECT_TRUE(makeView(nullptr, 0.0, kNode).can_hold);
  EXPECT_TRUE(makeView(nullptr, 1e6, kNode).can_hold);
}

TEST(MissionView, TellsStateAndHowLong) {
  MissionState state = stateOf(MissionState::PICK);
  state.brick = 7;
  MissionView view = fresh(state);
  EXPECT_TRUE(view.is_live);
  EXPECT_EQ(view.title, "Picking brick 7");
  EXPECT_EQ(view.since, "for 12 s");
  EXPECT_EQ(view.note, "");
  EXPECT_EQ(view.time, "10 min 00 s of 40 min 00 s");
  EXPECT_DOUBLE_EQ(view.time_share, 0.25);
  state.is_pause_wanted = true;
  EXPECT_THAT(fresh(state).note, HasSubstr("Pauses when"));
}

TEST(MissionView, TimeStaysWithinItsBar) {
  MissionState state = stateOf(MissionState::PICK);
  for (const auto& [used_s, limit_s, share] : {std::tuple{5000.0, 2400.0, 1.0},
                                               {-1.0, 2400.0, 0.0},
                                               {600.0, 0.0, 0.0},
                                               {kNaN, 2400.0, 0.0},
                                               {600.0, kNaN, 0.0}}) {
    state.used_s = used_s;
    state.limit_s = limit_s;
    EXPECT_EQ(fresh(state).time_share, share) << used_s << " of " << limit_s;
  }
}

TEST(MissionView, WithoutWordForThreeSecondsItSaysSoAndOnlyHoldIsLeft) {
  const MissionState state = stateOf(MissionState::DRIVE);
  EXPECT_TRUE(makeView(&state, 2.99, kNode).is_live);
  const MissionView view = makeView(&state, 3.0, kNode);
  EXPECT_FALSE(view.is_live);
  EXPECT_EQ(buttonsOf(view), "hold");
  EXPECT_EQ(view.title, "No message for 3 s");
  EXPECT_THAT(view.note, HasSubstr("/pick_mission has ended, or the clock is stopped"));
  EXPECT_THAT(view.note, HasSubstr("driving to the next view")) << "what it did last";
  EXPECT_EQ(view.since, "") << "nobody knows";
  EXPECT_THAT(view.bars, SizeIs(7)) << "what was known stays, greyed out";
}

TEST(MissionView, BeforeTheFirstStateItWaitsAndThenAsks) {
  const MissionView view = makeView(nullptr, 0.0, kNode);
  EXPECT_FALSE(view.is_live);
  EXPECT_EQ(buttonsOf(view), "hold");
  EXPECT_THAT(view.note, HasSubstr("Waiting for the first message of /pick_mission"));
  EXPECT_THAT(makeView(nullptr, 3.0, kNode).note, HasSubstr("is it running"));
  EXPECT_THAT(view.bars, SizeIs(7));
}

TEST(MissionView, WhyItEndedIsToldAndWhetherThatIsGood) {
  MissionState state = stateOf(MissionState::ENDED);
  state.end_reason = MissionState::NO_BRICK_LEFT;
  const MissionView good = fresh(state);
  EXPECT_EQ(good.note, "No brick is left.");
  state.end_reason = MissionState::PLANNING_FAILED;
  state.end_message = "plan_pick: no map; 5 times in a row";
  const MissionView bad = fresh(state);
  EXPECT_EQ(bad.note, "Planning failed again and again.\nPlan_pick: no map; 5 times in a row");
  EXPECT_FALSE(good.fill == bad.fill);
  state.end_message = "pick: STALE_STATE; 5 times in a row";
  EXPECT_THAT(fresh(state).note, HasSubstr("clock:=lockstep"));
}

TEST(MissionView, LettersCanBeReadOnEveryColour) {
  for (int value = 0; value <= MissionState::NUM_STATES; ++value) {
    const MissionState state = stateOf(static_cast<std::uint8_t>(value));
    for (const double age_s : {0.0, 10.0}) {
      const MissionView view = makeView(&state, age_s, kNode);
      EXPECT_GE(contrast(view.fill, view.ink), kLeastContrast) << view.title;
    }
  }
  const MissionView none = makeView(nullptr, 0.0, kNode);
  EXPECT_GE(contrast(none.fill, none.ink), kLeastContrast);
  MissionState state = stateOf(MissionState::PICK);
  for (std::uint8_t status = 0; status < 7; ++status) state.bricks.push_back(brick(status, status));
  const MissionView view = fresh(state);
  ASSERT_THAT(view.bricks, SizeIs(7));
  for (const MissionView::Brick& cell : view.bricks) {
    EXPECT_GE(contrast(cell.fill, cell.ink), kLeastContrast) << cell.hint;
  }
}

TEST(MissionView, BricksHaveTheirColourAndAreCounted) {
  MissionState state = stateOf(MissionState::PICK);
  state.bricks = {brick(0, MissionBrick::PICKED), brick(1, MissionBrick::PICKED), brick(2, MissionBrick::OPEN),
                  brick(4, MissionBrick::CURRENT), brick(9, MissionBrick::EXHAUSTED)};
  state.bricks[4].picks_begun = 3;
  state.bricks[4].picks_failed = 3;
  state.bricks[4].plans_failed = 1;
  state.bricks[4].last_failure = "NO_CONTACT";
  state.bricks_picked = 2;
  state.picks_begun = 6;
  state.views = 1;
  MissionView view = fresh(state);
  ASSERT_THAT(view.bricks, SizeIs(5));
  EXPECT_EQ(view.bricks[3].id, 4);
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_TRUE(view.bricks[i].fill == pick_mission_ros::colorOfStatus(state.bricks[i].status)) << i;
  }
  EXPECT_EQ(view.bricks[4].hint,
            "brick 9 (brick): exhausted\n3 picks begun, 3 failed; 1 plan failed\nlast failure: NO_CONTACT");
  EXPECT_THAT(view.counts,
              ElementsAre(Field(&MissionView::Count::text, "2 picked"), Field(&MissionView::Count::text, "1 in work"),
                          Field(&MissionView::Count::text, "1 open"), Field(&MissionView::Count::text, "1 exhausted")));
  EXPECT_EQ(view.bricks_text, "2 picked, 6 picks begun, 1 view");
  state.bricks_total = 12;
  EXPECT_EQ(fresh(state).bricks_text, "2 of 12 picked, 6 picks begun, 1 view");
}

TEST(MissionView, TheHandIsNotGuessed) {
  MissionState state = stateOf(MissionState::STOW);
  state.hand = MissionState::EMPTY;
  EXPECT_EQ(fresh(state).hand, "empty");
  state.hand = MissionState::HOLDING;
  EXPECT_THAT(fresh(state).hand, HasSubstr("something unknown"));
  state.bricks = {brick(3, MissionBrick::OPEN), brick(5, MissionBrick::CURRENT)};
  EXPECT_EQ(fresh(state).hand, "brick 5");
  state.hand = MissionState::UNKNOWN;
  EXPECT_THAT(fresh(state).hand, HasSubstr("reports nothing"));
}

TEST(MissionView, EachBarHasItsOwnFieldOfTheView) {
  MissionState state = stateOf(MissionState::DRIVE);
  NbvSegment segment;
  segment.manipulability_factor = 0.1;
  segment.pick_order_factor = 0.2;
  segment.travel_factor = 0.3;
  segment.uncertainty_factor = 0.4;
  segment.frontier_factor = 0.5;
  segment.failure_penalty = 0.6;
  segment.utility = 0.7;
  // Attributes, in their own units: not to be mistaken for factors.
  segment.manipulability = segment.height = segment.distance = segment.uncertainty = segment.frontier = 0.9;
  segment.information = 0.95;
  segment.standing.position.x = -1.25;
  segment.standing.position.y = 0.5;
  state.view = {segment};
  const MissionView view = fresh(state);
  const std::vector<std::pair<std::string, double>> expected = {
      {"manipulability", 0.1}, {"pick order", 0.2},      {"travel", 0.3}, {"uncertainty", 0.4},
      {"frontier", 0.5},       {"failure penalty", 0.6}, {"utility", 0.7}};
  ASSERT_THAT(view.bars, SizeIs(expected.size()));
  for (std::size_t i = 0; i < expected.size(); ++i) {
    EXPECT_EQ(view.bars[i].name, expected[i].first);
    EXPECT_DOUBLE_EQ(view.bars[i].share, expected[i].second);
    EXPECT_NEAR(std::stod(view.bars[i].value), expected[i].second, 1e-9) << "two decimals are enough for these";
    EXPECT_FALSE(view.bars[i].is_off);
  }
  EXPECT_EQ(view.view_text, "at -1.25, 0.50 m");
}

TEST(MissionView, BarsStayWithinTheirLengthAndTellWhatIsNoNumber) {
  MissionState state = stateOf(MissionState::DRIVE);
  NbvSegment segment;
  segment.manipulability_factor = 1.7;
  segment.pick_order_factor = -0.3;
  segment.travel_factor = kNaN;
  segment.utility = std::numeric_limits<double>::infinity();
  state.view = {segment};
  const MissionView view = fresh(state);
  EXPECT_EQ(view.bars[0].share, 1.0);
  EXPECT_EQ(view.bars[0].value, "1.70");
  EXPECT_EQ(view.bars[1].share, 0.0);
  EXPECT_EQ(view.bars[2].share, 0.0);
  EXPECT_EQ(view.bars[2].value, "-");
  EXPECT_EQ(view.bars[6].share, 0.0);
  EXPECT_EQ(view.bars[6].value, "-");
}

TEST(MissionView, AFactorThatIsLeftOutIsMarked) {
  MissionState state = stateOf(MissionState::DRIVE);
  state.view.resize(1);
  const std::vector<std::string> keys = {"manipulability", "pick_order", "travel", "uncertainty", "frontier"};
  for (std::size_t off = 0; off < keys.size(); ++off) {
    state.removed_factor = keys[off];
    const MissionView view = fresh(state);
    for (std::size_t i = 0; i < view.bars.size(); ++i) EXPECT_EQ(view.bars[i].is_off, i == off) << keys[off] << i;
    EXPECT_THAT(view.bars[off].name, HasSubstr("(off)"));
    EXPECT_THAT(view.run, HasSubstr("without " + keys[off]));
  }
}

TEST(MissionView, WithoutAViewTheBarsAreEmpty) {
  const MissionView view = fresh(stateOf(MissionState::BEGIN));
  EXPECT_EQ(view.view_text, "none selected yet");
  ASSERT_THAT(view.bars, SizeIs(7));
  for (const MissionView::Bar& bar : view.bars) {
    EXPECT_EQ(bar.share, 0.0);
    EXPECT_EQ(bar.value, "-");
  }
}

TEST(MissionView, FailuresTellWhenWhatAndWhatFollowed) {
  MissionState state = stateOf(MissionState::LOOK);
  EXPECT_EQ(fresh(state).failures_text, "none");
  MissionFailure failure;
  failure.stamp = ros::Time(925.0);
  failure.state = MissionState::PLAN_PICK;
  failure.event = "no path found";
  failure.reason = "no path found from here";
  state.last_failures = {failure, failure};
  state.last_failures[1].stamp = ros::Time(2000.0);  // of before a clock that was set back
  state.failures = 14;
  const MissionView view = fresh(state);
  EXPECT_EQ(view.failures_text, "14 in all");
  ASSERT_THAT(view.failures, SizeIs(2));
  EXPECT_EQ(view.failures[0].when, "1 min 15 s ago");
  EXPECT_EQ(view.failures[0].what, "planning a pick: no path found");
  EXPECT_EQ(view.failures[0].then, "no path found from here");
  EXPECT_TRUE(view.failures[0].hint.empty());
  EXPECT_EQ(view.failures[1].when, "0 s ago");
}

TEST(MissionView, WhatAFailureHasInBracketsIsItsHint) {
  MissionState state = stateOf(MissionState::LOOK);
  state.last_failures.resize(1);
  state.last_failures[0].reason = "the straight way is not free (face +z of brick 19 (self 216); one more)";
  const MissionView view = fresh(state);
  ASSERT_THAT(view.failures, SizeIs(1));
  EXPECT_EQ(view.failures[0].then, "the straight way is not free");
  EXPECT_EQ(view.failures[0].hint, state.last_failures[0].reason);
}

TEST(MissionView, TellsWhichRunItIs) {
  MissionState state = stateOf(MissionState::LOOK);
  EXPECT_EQ(fresh(state).run, "strategy by default");
  state.scene = "brick_pile";
  state.strategy = "gpis";
  state.run_folder = "results/1";
  EXPECT_EQ(fresh(state).run, "scene brick_pile, strategy gpis, log in results/1");
}

TEST(DurationInWords, HasTheUnitsThatMatter) {
  EXPECT_EQ(durationInWords(-3.0), "0 s");
  EXPECT_EQ(durationInWords(0.0), "0 s");
  EXPECT_EQ(durationInWords(59.99), "59 s");
  EXPECT_EQ(durationInWords(60.0), "1 min 00 s");
  EXPECT_EQ(durationInWords(185.2), "3 min 05 s");
  EXPECT_EQ(durationInWords(3599.9), "59 min 59 s");
  EXPECT_EQ(durationInWords(3600.0), "1 h 00 min");
  EXPECT_EQ(durationInWords(2 * 3600.0 + 7 * 60.0 + 59.0), "2 h 07 min");
  EXPECT_EQ(durationInWords(kNaN), "-");
  EXPECT_EQ(durationInWords(std::numeric_limits<double>::infinity()), "-");
}

TEST(AnswerInWords, TellsWhatCameOfIt) {
  EXPECT_EQ(answerInWords(Request::kStart, {Answer::Kind::kAnswered, true, ""}, kNode), "Start: done.");
  EXPECT_EQ(answerInWords(Request::kPause, {Answer::Kind::kAnswered, true, "when it ends."}, kNode),
            "Pause: when it ends.");
  EXPECT_EQ(answerInWords(Request::kResume, {Answer::Kind::kAnswered, false, "nothing is interrupted"}, kNode),
            "Resume was refused: nothing is interrupted.");
  EXPECT_EQ(answerInWords(Request::kStop, {Answer::Kind::kNoService, false, ""}, kNode),
            "Stop failed: there is no service /pick_mission/stop; is the node running?");
  EXPECT_THAT(answerInWords(Request::kStop, {Answer::Kind::kBroken, false, ""}, kNode),
              HasSubstr("ended before it answered"));
}

// Whoever pressed it believes that the robot stands.
TEST(AnswerInWords, AHoldThatFailedWarns) {
  const char* const warning = "emergency stop";
  EXPECT_THAT(answerInWords(Request::kHold, {Answer::Kind::kAnswered, true, ""}, kNode), Not(HasSubstr(warning)));
  for (const Answer& answer : {Answer{Answer::Kind::kAnswered, false, "no"},
                               Answer{Answer::Kind::kNoService, false, ""}, Answer{Answer::Kind::kBroken, false, ""}}) {
    EXPECT_THAT(answerInWords(Request::kHold, answer, kNode), HasSubstr(warning));
    EXPECT_THAT(answerInWords(Request::kStart, answer, kNode), Not(HasSubstr(warning)));
  }
  EXPECT_EQ(waitingInWords(Request::kHold, 1.0, kNode), "Hold ...");
  EXPECT_THAT(waitingInWords(Request::kHold, 3.0, kNode), HasSubstr(warning));
  EXPECT_EQ(waitingInWords(Request::kStart, 4.0, kNode), "Start: no answer of /pick_mission/start for 4 s.");
}

TEST(ServiceOf, EachRequestHasItsOwn) {
  std::set<std::string> names;
  for (std::size_t i = 0; i < kNumRequests; ++i) names.insert(serviceOf(static_cast<Request>(i)));
  EXPECT_THAT(names, ElementsAre("hold", "pause", "resume", "start", "stop"));
}

}  // namespace
}  // namespace pick_mission_rviz
