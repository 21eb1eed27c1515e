// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/base_planner.h"

#include <ctime>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <thread>

#include <gmock/gmock.h>

#include "support/path_oracle.h"
#include "support/pile_scene.h"

namespace base_navigation {
namespace {

using interactive_mapping::problemsOf;
using testing::HasSubstr;

// Poses between two looks of the planner's last check are within an eighth of a cell of one of them.
const double kPadding_m = BasePlannerConfig().padding_m;
constexpr double kBetweenLooks_m = 0.05 / 8;

std::shared_ptr<const NavigationGrid> share(NavigationGrid grid) {
  return std::make_shared<const NavigationGrid>(std::move(grid));
}

/// `width_m` x `height_m` of free ground from the origin on.
NavigationGrid freeGround(double width_m, double height_m) {
  return makeGrid(static_cast<int>(std::lround(width_m / 0.05)), static_cast<int>(std::lround(height_m / 0.05)),
                  SpaceState::kFree);
}

BasePlanner planner(const BasePlannerConfig& config = {}) {
  return BasePlanner(config, kBaseLimits, kBaseFootprint);
}

void expectSolved(const BasePlan& plan, const Pose2d& start, const Pose2d& goal) {
  ASSERT_EQ(plan.status, BasePlanStatus::kSolved) << plan.message;
  EXPECT_TRUE(plan.message.empty());
  EXPECT_EQ(plan.path.start.x_m, start.x_m);
  EXPECT_EQ(plan.path.start.y_m, start.y_m);
  EXPECT_EQ(plan.path.start.yaw_rad, start.yaw_rad);
  const Pose2d end = plan.path.end();
  EXPECT_LT((end.position() - goal.position()).norm(), 1e-3);  // as promised
  EXPECT_LT(std::abs(wrapAngle(end.yaw_rad - goal.yaw_rad)), 1e-3);
  EXPECT_NEAR(plan.duration_s, duration(plan.path, kBaseLimits), 1e-9);
  for (const BaseMotion& motion : plan.path.motions) {
    if (motion.isTurn()) continue;
    EXPECT_LE(std::abs(motion.turn_rad / motion.length_m), 1.0 / BasePlannerConfig{}.turn_radius_m + 1e-9);
  }
}

bool reverses(const BasePath& path) {
  return std::any_of(path.motions.begin(), path.motions.end(), [](const BaseMotion& m) { return m.length_m < 0.0; });
}

TEST(BasePlanner, StraightAheadIsOneStraightLine) {
  const Pose2d start{1.0, 2.0, 0.0};
  const Pose2d goal{4.0, 2.0, 0.0};
  const BasePlan plan = planner().plan(share(freeGround(6, 4)), start, goal);
  expectSolved(plan, start, goal);
  if (HasFatalFailure()) return;
  ASSERT_EQ(plan.path.motions.size(), 1u);
  EXPECT_NEAR(plan.path.motions[0].length_m, 3.0, 1e-9);
  EXPECT_EQ(plan.iterations, 0);
}

TEST(BasePlanner, ALittleBackIsDrivenBackwards) {
  const Pose2d start{3.0, 2.0, 0.5};
  const Pose2d goal = moveAlongArc(start, -0.3, 0.0);
  const BasePlan plan = planner().plan(share(freeGround(6, 4)), start, goal);
  expectSolved(plan, start, goal);
  if (HasFatalFailure()) return;
  ASSERT_EQ(plan.path.motions.size(), 1u);
  EXPECT_NEAR(plan.path.motions[0].length_m, -0.3, 1e-9);
}

TEST(BasePlanner, AlreadyThereIsAnEmptyPath) {
  const Pose2d start{3.0, 2.0, 0.5};
  const BasePlan plan = planner().plan(share(freeGround(6, 4)), start, {3.015, 2.0, 0.52});
  EXPECT_EQ(plan.status, BasePlanStatus::kSolved);
  EXPECT_TRUE(plan.path.motions.empty());
  EXPECT_EQ(plan.duration_s, 0.0);
}

TEST(BasePlanner, TurnsRoundOnTheSpotInTheOpen) {
  const Pose2d start{1.5, 2.0, 0.0};
  const Pose2d goal{4.5, 2.0, M_PI};
  const BasePlan plan = planner().plan(share(freeGround(6, 4)), start, goal);
  expectSolved(plan, start, goal);
  if (HasFatalFailure()) return;
  EXPECT_FALSE(reverses(plan.path));  // at 0.1 m/s it would be slower than any way round
  // There with two half turns and one straight line, and back by the approach: what a roboticist would do at worst.
  const BasePath simple{start, {{3.4 - 0.0, 0.0}, {0.0, M_PI}, {0.4, 0.0}}};
  EXPECT_LE(plan.duration_s, duration(simple, kBaseLimits) + 1e-6);
}

TEST(BasePlanner, LeavesAPileStraightBackUntilItCanTurn) {
  NavigationGrid grid = freeGround(10, 10);
  fillRectangle(&grid, 5.35, 3.0, 7.0, 7.0, SpaceState::kOccupied);
  const auto shared = share(grid);
  // The circle of the padded footprint; steps of 5 cm.
  const double radius_m = circumscribedRadius(padPolygon(kBaseFootprint, kPadding_m));
  for (const double gap_m : {0.01, 0.024, 0.054}) {
    const Pose2d start{5.35 - 0.296 - gap_m, 5.0, 0.0};
    const double expected_m = std::ceil((radius_m - 0.296 - gap_m) / 0.05) * 0.05;
    for (const Pose2d& goal : {Pose2d{4.9, 6.0, 0.0}, Pose2d{2.0, 2.0, 2.0}, Pose2d{8.0, 8.5, 0.0}}) {
      if (!PathOracle(grid, kBaseFootprint).isFree(goal.x_m, goal.y_m, goal.yaw_rad, 0.0)) continue;
      const BasePlan plan = planner().plan(shared, start, goal);
      expectSolved(plan, start, goal);
      if (HasFatalFailure()) return;
      ASSERT_GE(plan.path.motions.size(), 2u);
      EXPECT_NEAR(plan.path.motions[0].length_m, -expected_m, 1e-9) << gap_m;
      EXPECT_EQ(plan.path.motions[0].turn_rad, 0.0);
      EXPECT_EQ(PathOracle(grid, kBaseFootprint).complain(plan.path, kPadding_m - kBetweenLooks_m, expected_m, 0.4),
                "");
    }
  }
}

TEST(BasePlanner, LeavesAWallBehindItStraightAhead) {
  NavigationGrid grid = freeGround(10, 10);
  fillRectangle(&grid, 0.0, 0.0, 2.0, 10.0, SpaceState::kOccupied);
  const Pose2d start{2.0 + 0.527 + 0.012, 5.0, 0.0};  // nearer than the padding
  const Pose2d goal{2.7, 8.0, 0.5 * M_PI};
  const BasePlan plan = planner().plan(share(grid), start, goal);
  expectSolved(plan, start, goal);
  if (HasFatalFailure()) return;
  EXPECT_FALSE(reverses(plan.path));
  EXPECT_EQ(plan.path.motions[0].turn_rad, 0.0);
  EXPECT_GE(plan.path.motions[0].length_m, 0.1);  // the circle needs 0.106 m more than there is
  EXPECT_EQ(PathOracle(grid, kBaseFootprint).complain(plan.path, kPadding_m - kBetweenLooks_m, 0.05, 0.4), "");
}

TEST(BasePlanner, ArrivesStraightAndSquare) {
  const PileScene scene = pileScene();
  for (std::size_t i = 0; i < scene.standing_map.size(); i += 3) {
    const Pose2d start{-6.0, 5.0, 1.0};
    const BasePlan plan = planner().plan(scene.grid, start, scene.standing_map[i]);
    expectSolved(plan, start, scene.standing_map[i]);
    if (HasFatalFailure()) return;
    EXPECT_GE(plan.path.motions.back().length_m, 0.4 - 1e-9);
    EXPECT_EQ(plan.path.motions.back().turn_rad, 0.0);
    EXPECT_FALSE(reverses(plan.path));
  }
}

TEST(BasePlanner, TakesAShorterApproachWhereThereIsNoRoom) {
  NavigationGrid grid = freeGround(8, 6);
  fillRectangle(&grid, 5.35, 0.0, 5.5, 6.0, SpaceState::kOccupied);   // ahead of the goal
  fillRectangle(&grid, 4.05, 1.0, 4.20, 6.0, SpaceState::kOccupied);  // and behind: 1.15 m between
  const Pose2d goal{5.0, 5.0, 0.0};                                   // footprint from 4.473 to 5.296
  const Pose2d start{4.78, 1.2 - 0.55, 0.5 * M_PI};
  const BasePlan plan = planner().plan(share(grid), start, goal);
  // It is too narrow to turn square to the wall: 1.15 m, and the padded footprint is 1.1 m across its corners.
  EXPECT_NE(plan.status, BasePlanStatus::kNoApproach) << plan.message;
  fillRectangle(&grid, 4.2, 1.0, 4.40, 6.0, SpaceState::kOccupied);  // 7 cm behind the goal's footprint
  const BasePlan none = planner().plan(share(grid), start, goal);
  EXPECT_EQ(none.status, BasePlanStatus::kNoApproach);
  EXPECT_THAT(none.message, HasSubstr("occupied ground at (4.3"));
}

TEST(BasePlanner, EntersADeadEndBackwardsIfItMustFaceOut) {
  NavigationGrid grid = freeGround(8, 6);
  fillRectangle(&grid, 5.0, 0.0, 8.0, 2.5, SpaceState::kOccupied);
  fillRectangle(&grid, 5.0, 3.5, 8.0, 6.0, SpaceState::kOccupied);  // 1 m wide: 1.1 m is needed to turn
  const Pose2d start{2.0, 3.3, 0.0};
  const Pose2d goal{6.0, 3.0, M_PI};
  const BasePlan plan = planner().plan(share(grid), start, goal);
  expectSolved(plan, start, goal);
  if (HasFatalFailure()) return;
  EXPECT_TRUE(reverses(plan.path));
  EXPECT_EQ(PathOracle(grid, kBaseFootprint).complain(plan.path, kPadding_m - kBetweenLooks_m, 0.0, 0.4), "");
}

TEST(BasePlanner, CannotTurnRoundInANarrowCorridor) {
  NavigationGrid grid = freeGround(8, 1);
  BasePlannerConfig config;
  config.max_iterations = 600;
  const Pose2d start{2.0, 0.5, 0.0};
  const Pose2d goal{5.0, 0.5, M_PI};
  const BasePlan plan = planner(config).plan(share(grid), start, goal);
  EXPECT_EQ(plan.status, BasePlanStatus::kIterations);
  EXPECT_THAT(plan.message, HasSubstr("within 6"));
  EXPECT_TRUE(plan.path.motions.empty());
  EXPECT_LE(plan.iterations, 600);
}

TEST(BasePlanner, PassesAGateTooNarrowToTurnIn) {
  NavigationGrid grid = freeGround(8, 8);
  fillRectangle(&grid, 3.8, 0.0, 4.2, 1.2, SpaceState::kUnknown);
  fillRectangle(&grid, 3.8, 2.0, 4.2, 8.0, SpaceState::kUnknown);  // 0.8 m wide, the padded footprint 0.652 m
  const Pose2d start{1.0, 7.0, 0.5 * M_PI};
  const Pose2d goal{7.0, 7.0, 0.5 * M_PI};
  const BasePlan plan = planner().plan(share(grid), start, goal);
  expectSolved(plan, start, goal);
  if (HasFatalFailure()) return;
  EXPECT_EQ(PathOracle(grid, kBaseFootprint).complain(plan.path, kPadding_m - kBetweenLooks_m, 0.0, 0.4), "");
}

TEST(BasePlanner, SaysWhyThereIsNoPath) {
  const Pose2d start{1.5, 2.0, 0.0};
  const Pose2d goal{6.0, 2.0, 0.3};
  const NavigationGrid open = freeGround(8, 4);
  NavigationGrid grid = open;
  grid.state[grid.index(30, 44)] = SpaceState::kOccupied;  // (1.525, 2.225): under the robot
  BasePlan plan = planner().plan(share(grid), start, goal);
  EXPECT_EQ(plan.status, BasePlanStatus::kStartOccupied);
  EXPECT_THAT(plan.message, HasSubstr("occupied ground at (1.5"));
  grid.state[grid.index(30, 44)] = SpaceState::kUnknown;
  plan = planner().plan(share(grid), start, goal);
  EXPECT_EQ(plan.status, BasePlanStatus::kStartUnknown);
  EXPECT_THAT(plan.message, HasSubstr("unknown ground at (1.5"));

  grid = open;
  grid.state[grid.index(120, 40)] = SpaceState::kOccupied;
  plan = planner().plan(share(grid), start, goal);
  EXPECT_EQ(plan.status, BasePlanStatus::kGoalOccupied);
  EXPECT_THAT(plan.message, HasSubstr("occupied ground at (6.0"));
  grid.state[grid.index(120, 40)] = SpaceState::kUnknown;
  EXPECT_EQ(planner().plan(share(grid), start, goal).status, BasePlanStatus::kGoalUnknown);
  EXPECT_EQ(planner().plan(share(open), start, {60.0, 2.0, 0.0}).status, BasePlanStatus::kGoalUnknown);

  grid = open;
  fillRectangle(&grid, 3.8, 0.0, 4.0, 4.0, SpaceState::kOccupied);
  plan = planner().plan(share(grid), start, goal);
  EXPECT_EQ(plan.status, BasePlanStatus::kNoPath);
  EXPECT_THAT(plan.message, HasSubstr("ends at (3.5"));
  EXPECT_EQ(plan.iterations, 0);

  // Boxed in on all sides by less than the padding.
  grid = makeGrid(160, 80, SpaceState::kOccupied);
  fillRectangle(&grid, 0.951, 1.69, 1.81, 2.31, SpaceState::kFree);
  fillRectangle(&grid, 4.0, 0.0, 8.0, 4.0, SpaceState::kFree);
  plan = planner().plan(share(grid), start, goal);
  EXPECT_EQ(plan.status, BasePlanStatus::kStartOccupied) << plan.message;
  EXPECT_THAT(plan.message, HasSubstr("cannot drive straight back or ahead"));
}

TEST(BasePlanner, RechecksWithThePaddingsOfThePlan) {
  const Pose2d start{1.0, 2.0, 0.0};
  const Pose2d goal{6.0, 2.0, 0.0};
  const NavigationGrid open = freeGround(8, 4);
  const BasePlan plan = planner().plan(share(open), start, goal);
  ASSERT_EQ(plan.status, BasePlanStatus::kSolved);
  EXPECT_EQ(plan.tight_start_m, 0.0);
  EXPECT_NEAR(plan.tight_end_m, BasePlannerConfig().approach_m, 1e-9);
  const auto recheck = [&](double x_m, double y_m, double from_m = 0.0) {
    NavigationGrid grid = open;
    const Eigen::Vector2i cell = grid.cellOf({x_m, y_m});
    grid.state[grid.index(cell.x(), cell.y())] = SpaceState::kOccupied;
    return planner().recheck(plan, from_m, share(grid));
  };
  EXPECT_TRUE(recheck(3.0, 3.0).isFree());
  // The cell from 2.30 to 2.35 m is 4 mm off the footprint: within the padding, not within that of the approach, which
  // begins at 5.6 m, where the front has come to 5.896 m.
  const FootprintVerdict beside = recheck(3.02, 2.32);
  ASSERT_FALSE(beside.isFree());
  // First met with the front, 3.00 - 0.296 - 0.06 - 1.0 m, between looks of at most 12.5 mm.
  EXPECT_NEAR(beside.at_m, 1.644 + 0.00625, 0.00626);
  EXPECT_NEAR((beside.where_map - Eigen::Vector2d(3.025, 2.325)).norm(), 0.0, 1e-9);
  EXPECT_TRUE(recheck(6.12, 2.32).isFree());  // the padded front does not come to 6.10 m but on the approach
  EXPECT_FALSE(recheck(6.12, 2.28).isFree());
  EXPECT_FALSE(recheck(3.02, 2.32, 2.6).isFree());
  EXPECT_TRUE(recheck(3.02, 2.32, 2.7).isFree());  // its rear, 0.587 m behind, has passed 3.05 m
  EXPECT_TRUE(planner().recheck(BasePlan(), 0.0, share(open)).isFree());
}

TEST(BasePlanner, RefusesBadArguments) {
  const auto grid = share(freeGround(6, 4));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  const Pose2d good{2.0, 2.0, 0.0};
  EXPECT_THROW(planner().plan(nullptr, good, good), std::invalid_argument);
  for (const double bad : {nan, infinity, -infinity}) {
    for (const Pose2d& pose : {Pose2d{bad, 2.0, 0.0}, Pose2d{2.0, bad, 0.0}, Pose2d{2.0, 2.0, bad}}) {
      EXPECT_THROW(planner().plan(grid, pose, good), std::invalid_argument);
      EXPECT_THROW(planner().plan(grid, good, pose), std::invalid_argument);
    }
  }
  NavigationGrid torn = *grid;
  torn.state.pop_back();
  EXPECT_THROW(planner().plan(share(torn), good, good), std::invalid_argument);
  EXPECT_THROW(planner().recheck(BasePlan(), 0.0, nullptr), std::invalid_argument);
  EXPECT_THROW(planner().recheck(BasePlan(), 0.0, share(torn)), std::invalid_argument);
  EXPECT_THROW(planner().recheck(BasePlan(), nan, grid), std::invalid_argument);
  EXPECT_NE(planner().plan(share(NavigationGrid{}), good, {3.0, 2.0, 0.0}).status, BasePlanStatus::kSolved);
}

TEST(BasePlanner, ListsEveryImpossibleValue) {
  EXPECT_TRUE(problemsOf(BasePlannerConfig()).empty());
  BasePlannerConfig config;
  config.padding_m = -0.1;
  config.approach_m = std::numeric_limits<double>::quiet_NaN();
  config.max_iterations = 0;
  EXPECT_EQ(problemsOf(config).size(), 3u);
  EXPECT_THROW(planner(config), std::invalid_argument);
  config = {};
  config.goal_padding_m = 0.1;  // more than on the way
  EXPECT_EQ(problemsOf(config).size(), 1u);
  EXPECT_THROW(BasePlanner({}, MotionLimits{}, kBaseFootprint), std::invalid_argument);
  EXPECT_THROW(BasePlanner({}, kBaseLimits, {{0.1, 0.1}, {0.2, 0.3}}), std::invalid_argument);
}

/// Of this thread: the machine may be busy with other things.
double processorSeconds() {
  timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

TEST(BasePlanner, EndsSoonAfterItIsCancelled) {
  // A search that goes on for long: a gate wide enough for the inscribed circle, not for the padded footprint.
  NavigationGrid grid = freeGround(20, 20);
  fillRectangle(&grid, 12.0, 0.0, 20.0, 9.5, SpaceState::kOccupied);
  fillRectangle(&grid, 12.0, 10.4, 20.0, 20.0, SpaceState::kOccupied);
  fillRectangle(&grid, 12.0, 9.0, 12.2, 9.8, SpaceState::kOccupied);
  const auto shared = share(grid);
  for (const int asked_until : {0, 1, 5, 20, 100, 400, 2000}) {
    int asked = 0;
    double cancelled_at_s = 0.0;
    double last_s = processorSeconds();
    double longest_s = 0.0;
    const BasePlan plan = planner().plan(shared, {2.0, 2.0, 0.0}, {16.0, 9.95, M_PI}, [&] {
      const double now_s = processorSeconds();
      longest_s = std::max(longest_s, now_s - last_s);
      last_s = now_s;
      if (asked++ < asked_until) return false;
      cancelled_at_s = now_s;
      return true;
    });
    EXPECT_EQ(plan.status, BasePlanStatus::kCancelled) << asked_until;
    EXPECT_TRUE(plan.path.motions.empty());
    EXPECT_LT(processorSeconds() - cancelled_at_s, 0.1);
    EXPECT_LT(longest_s, 0.1);
  }
}

bool isSame(const BasePlan& a, const BasePlan& b) {
  if (a.status != b.status || a.path.motions.size() != b.path.motions.size() || a.iterations != b.iterations)
    return false;
  for (std::size_t i = 0; i < a.path.motions.size(); ++i) {
    if (a.path.motions[i].length_m != b.path.motions[i].length_m) return false;
    if (a.path.motions[i].turn_rad != b.path.motions[i].turn_rad) return false;
  }
  return true;
}

TEST(BasePlanner, SameRequestSamePathInAnyThread) {
  NavigationGrid grid = freeGround(8, 8);
  fillRectangle(&grid, 3.8, 0.0, 4.2, 1.2, SpaceState::kUnknown);
  fillRectangle(&grid, 3.8, 2.0, 4.2, 8.0, SpaceState::kUnknown);
  const auto shared = share(grid);
  const auto ask = [&] { return planner().plan(shared, {1.0, 7.0, 0.5 * M_PI}, {7.0, 7.0, 0.5 * M_PI}); };
  const BasePlan first = ask();
  EXPECT_GT(first.iterations, 0);  // chance has a part in it
  EXPECT_TRUE(isSame(first, ask()));
  BasePlan parallel[2];
  std::thread other([&] { parallel[0] = ask(); });
  parallel[1] = ask();
  other.join();
  EXPECT_TRUE(isSame(first, parallel[0]));
  EXPECT_TRUE(isSame(first, parallel[1]));
}

}  // namespace
}  // namespace base_navigation
