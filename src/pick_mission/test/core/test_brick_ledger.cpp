// SPDX-License-Identifier: BSD-3-Clause
#include "pick_mission/brick_ledger.h"

#include <stdexcept>

#include <gmock/gmock.h>

namespace pick_mission {
namespace {

SeenBrick seen(int id, double height_m) {
  SeenBrick brick;
  brick.id = id;
  brick.type = "brick";
  brick.T_map_brick.translation().z() = height_m;
  brick.graspable_faces = {4};
  return brick;
}

TEST(BrickLedger, BestIsTheHighestAndOfEqualOnesThatOfSmallestId) {
  BrickLedger ledger(3, 3);
  EXPECT_FALSE(ledger.best(0));
  ledger.update({seen(7, 0.1), seen(3, 0.3), seen(2, 0.2)});
  EXPECT_EQ(ledger.best(0)->id, 3);
  // Measured to a few millimetres: below one is the same height.
  ledger.update({seen(7, 0.3004), seen(3, 0.3), seen(2, 0.2)});
  EXPECT_EQ(ledger.best(0)->id, 3);
  ledger.update({seen(7, 0.302), seen(3, 0.3), seen(2, 0.2)});
  EXPECT_EQ(ledger.best(0)->id, 7);
}

TEST(BrickLedger, AFaceByWhichAPickFailedComesLast) {
  BrickLedger ledger(3, 3);
  SeenBrick brick = seen(1, 0.1);
  brick.graspable_faces = {4, 0, 2};
  ledger.update({brick});
  ledger.pickFailed(1, "it did not hold", 4);
  ledger.update({brick});
  EXPECT_THAT(ledger.best(0)->graspable_faces, testing::ElementsAre(0, 2, 4));
  ledger.pickFailed(1, "it did not hold", 0);
  ledger.update({brick});
  EXPECT_THAT(ledger.best(0)->graspable_faces, testing::ElementsAre(2, 4, 0)) << "the easiest first among them";
  ledger.pickFailed(1, "no contact");
  EXPECT_EQ(ledger.bricks().at(1).failed_faces.size(), 2U);
}

TEST(BrickLedger, LeavesWhatCannotBeTried) {
  BrickLedger ledger(3, 3);
  SeenBrick duplicate = seen(1, 0.9);
  duplicate.has_duplicate = true;
  SeenBrick out_of_sector = seen(2, 0.8);
  out_of_sector.is_in_sector = false;
  SeenBrick without_face = seen(3, 0.7);
  without_face.graspable_faces.clear();
  ledger.update({duplicate, out_of_sector, without_face, seen(4, 0.1), seen(5, 0.05)});
  EXPECT_EQ(ledger.best(0)->id, 4);
  EXPECT_EQ(ledger.obstacleTo(1, 0), "is not the only one with its id");
  EXPECT_EQ(ledger.obstacleTo(2, 0), "is out of the arm's sector");
  EXPECT_EQ(ledger.obstacleTo(3, 0), "has no face that the magnet can come to");
  EXPECT_EQ(ledger.obstacleTo(4, 0), "");
  ledger.triedInVain(4, 0);
  EXPECT_EQ(ledger.obstacleTo(4, 0), "was tried without success from here");
  EXPECT_EQ(ledger.best(0)->id, 5);
  EXPECT_EQ(ledger.best(1)->id, 4) << "another scene";
  ledger.update({seen(5, 0.05)});
  EXPECT_EQ(ledger.best(1)->id, 5) << "4 is not there any more";
}

TEST(BrickLedger, WhatCarriesAnotherWaits) {
  BrickLedger ledger(1, 3);
  const auto at = [](int id, double x_m, double z_m) {
    SeenBrick brick = seen(id, z_m);
    brick.T_map_brick.translation().x() = x_m;
    brick.size_m = {0.3, 0.2, 0.2};
    return brick;
  };
  const std::vector<SeenBrick> pile{at(1, 0.0, 0.3), at(2, 0.0, 0.1), at(3, 0.9, 0.05)};
  ledger.update(pile);
  ledger.triedInVain(1, 0);
  EXPECT_EQ(ledger.best(0)->id, 3) << "2 is higher, and 1 lies on it";
  EXPECT_EQ(ledger.obstacleTo(2, 0), "carries another");
  EXPECT_EQ(ledger.best(1)->id, 1);
  ledger.pickFailed(1, "without success");
  EXPECT_EQ(ledger.best(1)->id, 3) << "given up, but still there";
  EXPECT_TRUE(ledger.carriesAnother(ledger.bricks().at(2)));
  // Not there any more, whoever took it; or taken by the robot, though an old look still has it.
  ledger.update({pile[1], pile[2]});
  EXPECT_EQ(ledger.best(1)->id, 2);
  ledger.update(pile);
  EXPECT_EQ(ledger.best(1)->id, 3);
  ledger.picked(1);
  EXPECT_EQ(ledger.best(1)->id, 2);
}

TEST(BrickLedger, NearestBrickFirstByTheRules) {
  BrickLedger ledger(3, 3, {BrickOrder::kNearest, 8});
  std::vector<SeenBrick> bricks{seen(1, 0.05), seen(2, 0.25), seen(3, 0.05)};
  for (std::size_t i = 0; i < bricks.size(); ++i) bricks[i].T_map_brick.translation().x() = static_cast<double>(i);
  ledger.update(bricks);
  EXPECT_EQ(ledger.best(0, {-0.1, 0.0})->id, 1) << "2 is higher";
  EXPECT_EQ(ledger.best(0, {1.4, 0.0})->id, 2);
  EXPECT_EQ(ledger.best(0, {1.6, 0.0})->id, 3);
}

TEST(BrickLedger, CarrierIsTakenWhereTheRulesDoNotSpareIt) {
  for (const int wait_views : {2, 0}) {
    BrickLedger ledger(3, 3, {BrickOrder::kNearest, wait_views});
    SeenBrick lower = seen(1, 0.1), upper = seen(2, 0.3);
    lower.size_m = upper.size_m = {0.3, 0.2, 0.2};
    upper.T_map_brick.translation().x() = 0.05;
    ledger.update({lower, upper});
    EXPECT_EQ(ledger.best(0, {-1.0, 0.0})->id, wait_views > 0 ? 2 : 1);
    EXPECT_EQ(ledger.best(0, {-1.0, 0.0}, 1)->id, wait_views > 0 ? 2 : 1);
    EXPECT_EQ(ledger.best(0, {-1.0, 0.0}, 2)->id, 1) << "it has waited";
  }
}

TEST(BrickLedger, TwoBricksOfOneIdAreBothLeftEvenIfNobodySaysSo) {
  BrickLedger ledger(3, 3);
  ledger.update({seen(1, 0.3), seen(1, 0.2), seen(2, 0.1)});
  EXPECT_EQ(ledger.best(0)->id, 2);
}

TEST(BrickLedger, PicksAndPlansAreCountedApart) {
  BrickLedger ledger(2, 3);
  ledger.update({seen(1, 0.3), seen(2, 0.1)});
  ledger.pickFailed(1, "a");
  ledger.planFailed(1, "b");
  ledger.planFailed(1, "b");
  EXPECT_EQ(ledger.best(0)->id, 1);
  EXPECT_EQ(ledger.numExhausted(), 0);
  EXPECT_EQ(ledger.numOpen(), 2);
  ledger.planFailed(1, "c");
  EXPECT_EQ(ledger.best(0)->id, 2);
  ledger.pickFailed(2, "a");
  ledger.pickFailed(2, "d");
  EXPECT_FALSE(ledger.best(0));
  EXPECT_EQ(ledger.numExhausted(), 2);
  EXPECT_EQ(ledger.numOpen(), 0);
  EXPECT_EQ(ledger.bricks().at(1).failures, (std::map<std::string, int>{{"a", 1}, {"b", 2}, {"c", 1}}));
  EXPECT_EQ(ledger.bricks().at(2).last_failure, "d");
}

TEST(BrickLedger, WhenABrickWasTakenAwayPlansCountAnewAndWhatWasGivenUpHasOneAttemptMoreAfterAllOthers) {
  BrickLedger ledger(2, 1);
  ledger.update({seen(1, 0.2), seen(2, 0.3), seen(3, 0.1), seen(4, 0.05)});
  ledger.planFailed(1, "a");
  ledger.pickFailed(2, "b");
  ledger.pickFailed(2, "b");
  EXPECT_EQ(ledger.numExhausted(), 2);
  ledger.picked(3);
  EXPECT_EQ(ledger.numExhausted(), 0);
  EXPECT_EQ(ledger.best(0)->id, 1) << "2 is higher, and was given up before";
  EXPECT_EQ(ledger.bricks().at(1).failures.at("a"), 1);
  ledger.triedInVain(1, 0);
  EXPECT_EQ(ledger.best(0)->id, 4);
  ledger.triedInVain(4, 0);
  EXPECT_EQ(ledger.best(0)->id, 2);
  BrickLedger other(2, 1);
  other.restore(ledger.toJson());
  ledger.pickFailed(2, "c");
  EXPECT_EQ(ledger.numExhausted(), 1);
  EXPECT_FALSE(ledger.best(0));
  EXPECT_EQ(ledger.bricks().at(2).picks_failed, 3);
  other.pickFailed(2, "c");
  EXPECT_EQ(other.numExhausted(), 1) << "as if there had been no restart";
}

TEST(BrickLedger, PickedBrickSeenAgainIsAFailedPickButAnOldLookTellsNothing) {
  BrickLedger ledger(2, 3);
  EXPECT_THAT(ledger.update({seen(1, 0.3)}).found, testing::ElementsAre(1));
  ledger.picked(1);
  EXPECT_EQ(ledger.numPicked(), 1);
  SeenBrick old_look = seen(1, 0.3);
  old_look.is_seen_now = false;
  EXPECT_THAT(ledger.update({old_look}).came_back, testing::IsEmpty());
  EXPECT_EQ(ledger.numPicked(), 1);
  EXPECT_FALSE(ledger.best(0));
  const BrickLedger::Update update = ledger.update({seen(1, 0.05)});
  EXPECT_THAT(update.came_back, testing::ElementsAre(1));
  EXPECT_THAT(update.found, testing::IsEmpty());
  EXPECT_EQ(ledger.numPicked(), 0);
  EXPECT_EQ(ledger.bricks().at(1).picks_failed, 1);
  EXPECT_EQ(ledger.best(0)->id, 1);
  ledger.picked(1);
  ledger.update({seen(1, 0.05)});
  EXPECT_FALSE(ledger.best(0)) << "each return uses an attempt";
}

TEST(BrickLedger, AttemptsSurviveButNotWhatWasSeen) {
  BrickLedger ledger(2, 3);
  ledger.update({seen(1, 0.3), seen(2, 0.1)});
  ledger.picked(2);
  ledger.pickBegun(1);
  ledger.pickFailed(1, "a");
  ledger.planFailed(1, "b");
  BrickLedger again(2, 3);
  again.restore(nlohmann::json::parse(ledger.toJson().dump()));
  EXPECT_EQ(again.toJson(), ledger.toJson());
  EXPECT_EQ(again.numPicked(), 1);
  EXPECT_FALSE(again.best(0));
  EXPECT_THAT(again.update({seen(1, 0.3)}).found, testing::IsEmpty());
  EXPECT_EQ(again.best(0)->id, 1);
  again.pickFailed(1, "a");
  EXPECT_FALSE(again.best(0));
  EXPECT_THROW(again.restore(nlohmann::json::parse(R"([{"id": 1}])")), nlohmann::json::exception);
  EXPECT_EQ(again.numPicked(), 1) << "a state that is none has changed something";
}

TEST(BrickLedger, RefusesUnknownIdsAndNoAttempts) {
  BrickLedger ledger(1, 1);
  EXPECT_THROW(ledger.pickFailed(1, "a"), std::out_of_range);
  EXPECT_THROW(ledger.picked(1), std::out_of_range);
  EXPECT_THROW(BrickLedger(0, 1), std::invalid_argument);
  EXPECT_THROW(BrickLedger(1, 0), std::invalid_argument);
}

}  // namespace
}  // namespace pick_mission
