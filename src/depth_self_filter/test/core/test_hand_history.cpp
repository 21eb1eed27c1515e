// SPDX-License-Identifier: BSD-3-Clause
#include "depth_self_filter/hand_history.h"

#include <gtest/gtest.h>

namespace depth_self_filter {
namespace {

HandHistory::Change taken(double since_s, double edge_m) {
  HandHistory::Change change;
  change.since_s = since_s;
  change.brick = HeldBrick{"ur5e_tool0", Eigen::Isometry3d::Identity(), {edge_m, 0.2, 0.2}};
  return change;
}

HandHistory::Change empty(double since_s) {
  HandHistory::Change change;
  change.since_s = since_s;
  return change;
}

TEST(HandHistory, KnowsWhatWasHeldWhen) {
  HandHistory hand;
  EXPECT_FALSE(hand.at(5.0).brick);
  EXPECT_TRUE(hand.at(5.0).is_clear);
  hand.add(empty(0.0));  // the latched "nothing"
  hand.add(taken(10.0, 0.3));
  hand.add(empty(20.0));
  hand.add(taken(30.0, 0.25));
  EXPECT_FALSE(hand.at(9.9).brick);
  ASSERT_TRUE(hand.at(10.0).brick);
  EXPECT_EQ(hand.at(19.9).brick->size_m.x(), 0.3);
  EXPECT_FALSE(hand.at(20.0).brick);
  EXPECT_EQ(hand.at(99.0).brick->size_m.x(), 0.25);
}

TEST(HandHistory, WhoJoinsLateTakesWhatIsHeldForWhatWasHeld) {
  HandHistory hand;
  hand.add(taken(10.0, 0.3));
  EXPECT_TRUE(hand.at(9.0).brick);
}

TEST(HandHistory, WhatIsNotClearStaysSoUntilItIs) {
  HandHistory hand;
  HandHistory::Change unclear = empty(10.0);
  unclear.is_clear = false;
  hand.add(empty(0.0));
  hand.add(unclear);
  EXPECT_TRUE(hand.at(9.0).is_clear);
  EXPECT_FALSE(hand.at(11.0).is_clear);
  hand.add(taken(12.0, 0.3));
  EXPECT_FALSE(hand.at(11.0).is_clear);
  EXPECT_TRUE(hand.at(12.0).is_clear);
}

TEST(HandHistory, ARestartReplacesWhatIsYetToCome) {
  HandHistory hand;
  hand.add(taken(100.0, 0.3));
  hand.add(empty(10.0));
  EXPECT_FALSE(hand.at(200.0).brick);
}

TEST(HandHistory, RemembersTheLastChangesAndNoMore) {
  HandHistory hand;
  for (int i = 0; i < 1000; ++i) hand.add(i % 2 == 0 ? taken(i, 0.3) : empty(i));
  EXPECT_TRUE(hand.at(998.0).brick);
  EXPECT_FALSE(hand.at(999.0).brick);
  EXPECT_TRUE(hand.at(990.5).brick);
}

}  // namespace
}  // namespace depth_self_filter
