// SPDX-License-Identifier: BSD-3-Clause
#include "simulated_world/clock_gate.h"

#include <stdexcept>

#include <gtest/gtest.h>

namespace simulated_world {
namespace {

constexpr std::int64_t kSecond = 1000000000;

ClockGate mapGate(double cost_s = 0.0) {
  return ClockGate({{"/map/update", ClockEvent::kImage, cost_s, "", ""}}, {});
}

TEST(ClockGate, RunsWhileNothingIsDue) {
  ClockGate gate = mapGate();
  EXPECT_EQ(gate.limit(), ClockGate::kNoLimit);
  gate.published(ClockEvent::kOdometry, kSecond);
  EXPECT_EQ(gate.limit(), ClockGate::kNoLimit) << "nobody answers odometry";
  EXPECT_EQ(gate.awaited(), "");
  EXPECT_TRUE(gate.waitingFor().empty());
}

TEST(ClockGate, StopsAtAnImageUntilTheMapHasIt) {
  ClockGate gate = mapGate();
  gate.published(ClockEvent::kImage, kSecond);
  EXPECT_EQ(gate.limit(), kSecond);
  ASSERT_EQ(gate.waitingFor().size(), 1U);
  EXPECT_NE(gate.waitingFor()[0].find("/map/update"), std::string::npos);
  EXPECT_EQ(gate.awaited(), "/map/update");
  gate.answered(0, kSecond - 1);
  EXPECT_EQ(gate.limit(), kSecond) << "an answer to an earlier image";
  gate.answered(0, kSecond);
  EXPECT_EQ(gate.limit(), ClockGate::kNoLimit);
}

TEST(ClockGate, AnswerThatWasThereFirstCounts) {
  ClockGate gate = mapGate();
  gate.answered(0, 2 * kSecond);
  gate.published(ClockEvent::kImage, kSecond);
  EXPECT_EQ(gate.limit(), ClockGate::kNoLimit);
}

TEST(ClockGate, EarliestOpenImageHoldsTheClock) {
  ClockGate gate = mapGate(0.5);
  gate.published(ClockEvent::kImage, kSecond);
  gate.published(ClockEvent::kImage, kSecond + kSecond / 4);
  EXPECT_EQ(gate.limit(), kSecond + kSecond / 2) << "the answer is charged half a second";
  gate.answered(0, kSecond);
  EXPECT_EQ(gate.limit(), kSecond + kSecond / 4 + kSecond / 2);
}

TEST(ClockGate, ComputationIsChargedItsCost) {
  ClockGate gate({}, {{"/plan", 2.0}});
  gate.goalOpened("/plan", "a", kSecond);
  EXPECT_EQ(gate.limit(), 3 * kSecond);
  gate.goalOpened("/other", "x", 0);
  EXPECT_EQ(gate.awaited(), "/plan");
  EXPECT_EQ(gate.limit(), 3 * kSecond) << "actions without a rule take their time as they find it";
  gate.goalClosed("/plan", "a");
  EXPECT_EQ(gate.limit(), ClockGate::kNoLimit);
}

TEST(ClockGate, ResultMayOvertakeItsGoal) {
  ClockGate gate({}, {{"/plan", 0.0}});
  gate.goalClosed("/plan", "a");
  gate.goalOpened("/plan", "a", kSecond);
  EXPECT_EQ(gate.limit(), ClockGate::kNoLimit);
  gate.goalOpened("/plan", "b", kSecond);
  EXPECT_EQ(gate.limit(), kSecond);
}

TEST(ClockGate, FollowerAnswersOnlyWhileItDrives) {
  ClockGate gate({{"/follower/state", ClockEvent::kOdometry, 0.0, "/move_base", ""}}, {});
  gate.published(ClockEvent::kOdometry, kSecond);
  EXPECT_EQ(gate.limit(), ClockGate::kNoLimit);
  gate.goalOpened("/move_base", "a", kSecond);
  gate.published(ClockEvent::kOdometry, 2 * kSecond);
  EXPECT_EQ(gate.limit(), 2 * kSecond);
  gate.goalClosed("/move_base", "a");
  EXPECT_EQ(gate.limit(), ClockGate::kNoLimit) << "it will not answer any more";
}

TEST(ClockGate, GivesUpOnWhatIsDueAndSaysWhat) {
  ClockGate gate({{"/map/update", ClockEvent::kImage, 0.0, "", ""}, {"/late", ClockEvent::kScan, 0.0, "", ""}},
                 {{"/plan", 0.0}});
  gate.published(ClockEvent::kImage, kSecond);
  gate.goalOpened("/plan", "a", kSecond);
  gate.published(ClockEvent::kScan, 2 * kSecond);
  const std::vector<std::string> given_up = gate.giveUp();
  EXPECT_EQ(given_up.size(), 2U);
  EXPECT_EQ(gate.limit(), 2 * kSecond) << "what is due later stays";
}

TEST(ClockGate, RefusesImpossibleRules) {
  EXPECT_THROW(ClockGate({{"", ClockEvent::kImage, 0.0, "", ""}}, {}), std::invalid_argument);
  EXPECT_THROW(ClockGate({}, {{"/plan", -1.0}}), std::invalid_argument);
  EXPECT_THROW(ClockGate({{"/t", ClockEvent::kImage, 61.0, "", ""}}, {}), std::invalid_argument);
}

}  // namespace
}  // namespace simulated_world
