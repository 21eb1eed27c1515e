// SPDX-License-Identifier: BSD-3-Clause
// Missions in random worlds with random failures of everything: each ends, with a reason that the world agrees with.
#include <random>

#include <gmock/gmock.h>

#include "support/toy_world.h"

namespace toy {
namespace {

constexpr int kNumMissions = 1000;

/// Ends a mission at once wherever it comes, so that with many of them nothing else would be tried.
bool endsAtOnce(State action, const Result& result) {
  return reactTo(action, result).next == Trigger::kGiveUp;
}

bool isProtectiveStop(const Result& result) {
  const auto* arm = std::get_if<ArmResult>(&result);
  return arm != nullptr && arm->status == ArmStatus::kProtectiveStop;
}

ToyWorld randomWorld(unsigned seed) {
  std::mt19937 random(seed);
  const auto draw = [&](int lo, int hi) { return std::uniform_int_distribution<int>(lo, hi)(random); };
  std::vector<ToyBrick> bricks;
  int id = 0;
  for (int view = 0; view < kNumViews; ++view) {
    const int height = draw(0, 3);
    for (int layer = 0; layer < height; ++layer) {
      ToyBrick brick{id++, view, layer};
      brick.has_no_plate = draw(0, 19) == 0;
      brick.is_out_of_reach = draw(0, 19) == 0;
      bricks.push_back(brick);
    }
  }
  return ToyWorld(std::move(bricks), seed);
}

class RandomMissions : public testing::TestWithParam<double> {};

// Long: what has to hold after each step of a mission.
TEST_P(RandomMissions, EndWithEveryBrickPickedOrTheReasonWhyNot) {
  const double failure_share = GetParam();
  std::map<EndReason, int> ends;
  for (unsigned seed = 0; seed < kNumMissions / 4; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    MissionConfig config = surveying();
    config.unlocks_protective_stop = seed % 2 == 0;
    config.views.choose_after_each_pick = seed % 4 < 2;
    config.look.while_carrying = seed % 8 < 4;
    config.time.limit_s = seed % 5 == 0 ? 600.0 : 20000.0;
    ToyWorld world = randomWorld(seed);
    const int total = static_cast<int>(world.bricks.size());
    if (seed % 3 == 0) config.bricks_total = total;
    ToyMission run(config, std::move(world));
    std::mt19937 random(seed + 1000u);
    run.inject = [&](State action, int) -> std::optional<Result> {
      if (std::uniform_real_distribution<>(0.0, 1.0)(random) >= failure_share) return std::nullopt;
      run.world.holds_when_pick_fails = random() % 4 == 0;
      const std::vector<Result> results = possibleResults(action);
      const Result result = results[1 + random() % (results.size() - 1)];
      // In bounds: one in fifty of them.
      if ((endsAtOnce(action, result) || isProtectiveStop(result)) && random() % 50 != 0) return std::nullopt;
      const auto* selection = std::get_if<SelectionResult>(&result);
      if (selection != nullptr && selection->status == SelectionStatus::kLowUtility) {
        return SelectionResult{SelectionStatus::kLowUtility, viewPose(static_cast<int>(random() % kNumViews)), true};
      }
      // That nothing is left, it does not say while something is.
      if (selection != nullptr && selection->status == SelectionStatus::kNoPile) return std::nullopt;
      return result;
    };
    run.start();
    ASSERT_TRUE(run.toEnd()) << tail(run);
    while (run.machine.state() == State::kHeld) {
      run.tell(event::Resume{});  // the operator that held
      ASSERT_TRUE(run.toEnd()) << tail(run);
    }
    ASSERT_TRUE(run.isOver()) << "nothing runs and it has not ended\n" << tail(run);
    ASSERT_FALSE(HasFailure()) << tail(run);

    const EndReason reason = run.machine.endReason();
    ++ends[reason];
    const MissionCounts counts = run.machine.counts();
    EXPECT_EQ(counts.bricks_picked, run.world.stowed) << tail(run);
    for (const auto& [id, failures] : run.world.blamed) {
      // One more for each other brick that was taken away.
      EXPECT_LE(failures, config.attempts.max_picks_per_brick + counts.bricks_picked) << "brick " << id;
      EXPECT_EQ(failures, run.machine.bricks().bricks().at(id).picks_failed) << "brick " << id;
    }
    for (const auto& [id, record] : run.machine.bricks().bricks()) {
      EXPECT_LE(record.plans_failed, config.attempts.max_plans_per_brick);
      EXPECT_LE(record.picks_failed - record.attempts_back, config.attempts.max_picks_per_brick);
      EXPECT_EQ(record.picks_begun, run.world.picks[id]);
    }
    EXPECT_FALSE(run.machine.endMessage().empty());
    if (reason <= EndReason::kNoProgress && run.machine.usedTime() < config.time.limit_s) {
      EXPECT_TRUE(run.world.used.empty()) << "not unloaded\n" << tail(run);
    }
    switch (reason) {
      case EndReason::kNoBrickLeft:
        EXPECT_EQ(run.world.numLeft(), 0) << tail(run);
        break;
      case EndReason::kBricksExhausted:
        // Each that is known is picked or has used its attempts.
        EXPECT_GT(counts.bricks_exhausted, 0) << tail(run);
        if (config.bricks_total < 0) {
          EXPECT_EQ(counts.bricks_open, 0) << tail(run);
        } else {
          EXPECT_EQ(counts.bricks_picked + counts.bricks_exhausted, total) << tail(run);
        }
        break;
      case EndReason::kTimeUp:
        EXPECT_GE(run.machine.usedTime(), config.time.limit_s);
        break;
      case EndReason::kNothingWorthGoing:
      case EndReason::kNoProgress:
        EXPECT_GT(run.world.numLeft(), 0) << tail(run);
        break;
      case EndReason::kNotEnded:
      case EndReason::kStopped:
        ADD_FAILURE() << tail(run);
        break;
      default:
        EXPECT_GT(counts.failures, 0) << tail(run);
        break;
    }
    if (reason != EndReason::kBrickInHand && reason != EndReason::kNeedsPerson &&
        reason != EndReason::kRecoveryFailed && reason != EndReason::kArmFailed && reason != EndReason::kNotReady &&
        reason != EndReason::kPlanningFailed) {
      EXPECT_FALSE(run.world.hand) << "ended with a brick in the hand\n" << tail(run);
    }
    ASSERT_FALSE(HasFailure()) << tail(run);
  }
  std::string text;
  for (const auto& [reason, count] : ends) text += std::string(toString(reason)) + " " + std::to_string(count) + ", ";
  RecordProperty("ends", text);
  std::cout << text << "\n";
  if (failure_share == 0.0) {
    // Then only the bricks themselves and the clock are reasons.
    for (const auto& [reason, count] : ends) {
      EXPECT_TRUE(reason == EndReason::kNoBrickLeft || reason == EndReason::kBricksExhausted ||
                  reason == EndReason::kTimeUp || reason == EndReason::kNothingWorthGoing ||
                  reason == EndReason::kNoProgress)
          << toString(reason);
    }
  }
  EXPECT_GE(ends.size(), 3u) << "the worlds try too little";
}

INSTANTIATE_TEST_SUITE_P(FailureShares, RandomMissions, testing::Values(0.0, 0.03, 0.15, 0.5));

}  // namespace
}  // namespace toy
