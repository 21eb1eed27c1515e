// SPDX-License-Identifier: BSD-3-Clause
// A thousand random grids: what the planner returns, judged by code of its own.
#include <algorithm>
#include <cmath>
#include <map>
#include <random>

#include <gmock/gmock.h>

#include "base_navigation/base_planner.h"
#include "base_navigation/distance_field.h"
#include "support/path_oracle.h"
#include "support/pile_scene.h"

namespace base_navigation {
namespace {

constexpr double kSide_m = 8.0;

struct Problem {
  NavigationGrid grid;
  Pose2d start;
  Pose2d goal;
};

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double uniform(double lower, double upper) {
    return lower + (upper - lower) * static_cast<double>(engine_() >> 11) * 0x1.0p-53;
  }
  Pose2d pose() { return {uniform(0.7, kSide_m - 0.7), uniform(0.7, kSide_m - 0.7), uniform(-M_PI, M_PI)}; }

 private:
  std::mt19937_64 engine_;
};

void paint(Random* random, SpaceState state, int blobs, NavigationGrid* grid) {
  for (int i = 0; i < blobs; ++i) {
    const Eigen::Vector2d middle(random->uniform(0, kSide_m), random->uniform(0, kSide_m));
    const double size_m = random->uniform(0.05, 0.6);
    if (random->uniform(0, 1) < 0.5) {
      fillDisc(grid, middle, size_m, state);
    } else {
      const double other_m = random->uniform(0.05, 1.5);
      fillRectangle(grid, middle.x() - size_m, middle.y() - other_m, middle.x() + size_m, middle.y() + other_m, state);
    }
  }
}

Problem randomProblem(std::uint64_t seed) {
  Random random(seed);
  Problem problem;
  problem.grid = makeGrid(160, 160, SpaceState::kFree);
  paint(&random, SpaceState::kOccupied, static_cast<int>(random.uniform(3, 14)), &problem.grid);
  paint(&random, SpaceState::kUnknown, static_cast<int>(random.uniform(0, 6)), &problem.grid);
  problem.start = random.pose();
  // Most goals are free: otherwise most problems were over at once.
  const PathOracle oracle(problem.grid, kBaseFootprint);
  for (int attempt = 0; attempt < 8; ++attempt) {
    problem.goal = random.pose();
    if (oracle.isFree(problem.goal.x_m, problem.goal.y_m, problem.goal.yaw_rad, 0.0)) break;
  }
  if (random.uniform(0, 1) < 0.9) {  // where the robot stands is free, as GridFusion has it
    for (int row = 0; row < 160; ++row) {
      for (int column = 0; column < 160; ++column) {
        const Eigen::Vector2d p = transform(inverse(problem.start), problem.grid.centerOf(column, row));
        if (std::abs(p.y()) > 0.37 || p.x() > 0.37 || p.x() < -0.6) continue;
        problem.grid.state[problem.grid.index(column, row)] = SpaceState::kFree;
      }
    }
  }
  return problem;
}

/// Straight back from the start until the circle is free, and straight back from the goal: pairs of places between which
/// turning on the spot and driving is a way, if Dijkstra finds one. None: not known to have one.
bool hasWideWay(const Problem& problem, const BasePlannerConfig& config) {
  const PathOracle oracle(problem.grid, kBaseFootprint);
  const double radius_m = circumscribedRadius(padPolygon(kBaseFootprint, config.padding_m)) + 1e-6;
  Pose2d begin = problem.start;
  bool is_out = false;
  for (int i = 0; i <= 20 && !is_out; ++i) {
    begin = moveAlongArc(problem.start, -0.05 * i, 0.0);
    // A micrometre and a bit more than asked for, and every 5 mm: never where the planner might not go.
    for (int k = 0; k <= 10; ++k) {
      const Pose2d way = moveAlongArc(problem.start, -0.05 * i + 0.005 * k * (i > 0), 0.0);
      if (!oracle.isFree(way.x_m, way.y_m, way.yaw_rad, 0.05)) return false;
    }
    is_out = oracle.isDiscFree(begin.position(), radius_m);
  }
  if (!is_out) return false;
  for (int k = 0; k <= 80; ++k) {
    const Pose2d way = moveAlongArc(problem.goal, -0.005 * k, 0.0);
    if (!oracle.isFree(way.x_m, way.y_m, way.yaw_rad, 1e-6)) return false;
  }
  const Pose2d end = moveAlongArc(problem.goal, -config.approach_m, 0.0);
  if (!oracle.isDiscFree(end.position(), radius_m)) return false;
  const DistanceField field(problem.grid, begin.position(), radius_m);
  return std::isfinite(field.distance(end.position()));
}

TEST(BasePlannerRandom, NoPathTouchesWhatIsNotFreeOnAThousandGrids) {
  BasePlannerConfig config;
  config.max_iterations = 300;  // fewer than by default, for a thousand problems
  config.shortcut_rounds = 25;
  const BasePlanner planner(config, kBaseLimits, kBaseFootprint);
  std::map<BasePlanStatus, int> counts;
  int wide = 0;
  for (std::uint64_t seed = 1; seed <= 1000; ++seed) {
    const Problem problem = randomProblem(seed);
    const BasePlan plan = planner.plan(std::make_shared<NavigationGrid>(problem.grid), problem.start, problem.goal);
    ++counts[plan.status];
    SCOPED_TRACE("seed " + std::to_string(seed) + ": " + toString(plan.status) + " " + plan.message);
    if (hasWideWay(problem, config)) {
      ++wide;
      EXPECT_EQ(plan.status, BasePlanStatus::kSolved);
    }
    EXPECT_EQ(plan.message.empty(), plan.status == BasePlanStatus::kSolved);
    const PathOracle oracle(problem.grid, kBaseFootprint);
    const bool start_free = oracle.isFree(problem.start.x_m, problem.start.y_m, problem.start.yaw_rad, 0.0);
    const bool goal_free = oracle.isFree(problem.goal.x_m, problem.goal.y_m, problem.goal.yaw_rad, 0.0);
    if (plan.status != BasePlanStatus::kSolved) {
      EXPECT_TRUE(plan.path.motions.empty());
      if (!start_free) {
        EXPECT_TRUE(plan.status == BasePlanStatus::kStartOccupied || plan.status == BasePlanStatus::kStartUnknown);
      } else if (!goal_free) {
        EXPECT_TRUE(plan.status == BasePlanStatus::kGoalOccupied || plan.status == BasePlanStatus::kGoalUnknown);
      }
      continue;
    }
    EXPECT_TRUE(start_free && goal_free);
    ASSERT_FALSE(plan.path.motions.empty());
    // A way out of less room than the padding is straight, the first motion at most; and so is the approach.
    const BaseMotion& first = plan.path.motions.front();
    EXPECT_LE(plan.tight_start_m, config.max_back_off_m + 1e-9);
    EXPECT_LE(plan.tight_start_m, first.turn_rad == 0.0 ? std::abs(first.length_m) + 1e-9 : 0.0);
    EXPECT_LE(plan.tight_end_m, config.approach_m + 1e-9);
    EXPECT_TRUE(planner.recheck(plan, 0.0, std::make_shared<NavigationGrid>(problem.grid)).isFree());
    // Poses between two looks of the planner's last check are within an eighth of a cell of one of them.
    const double padding_m = config.padding_m - 0.05 / 8;
    EXPECT_EQ(oracle.complain(plan.path, padding_m, plan.tight_start_m, plan.tight_end_m), "");
    EXPECT_LT((plan.path.end().position() - problem.goal.position()).norm(), 1e-3);
    EXPECT_LT(std::abs(wrapAngle(plan.path.end().yaw_rad - problem.goal.yaw_rad)), 1e-3);
    EXPECT_EQ(plan.path.motions.back().turn_rad, 0.0);
    EXPECT_GE(std::abs(plan.path.motions.back().length_m), config.min_approach_m - 1e-9);
    for (const BaseMotion& motion : plan.path.motions) {
      if (motion.isTurn()) continue;
      EXPECT_LE(std::abs(motion.turn_rad) * config.turn_radius_m, std::abs(motion.length_m) * (1 + 1e-9));
    }
    if (HasFailure()) break;
  }
  for (const auto& [status, count] : counts) RecordProperty(toString(status), count);
  RecordProperty("wide", wide);
  // The problems are worth something: many are solved, many have room, and many do not.
  EXPECT_GT(counts[BasePlanStatus::kSolved], 300);
  EXPECT_GT(wide, 100);
  EXPECT_GT(counts[BasePlanStatus::kNoPath] + counts[BasePlanStatus::kIterations], 50);
}

TEST(BasePlannerRandom, RecheckFindsWhateverIsPutOnAPlanAndNothingElse) {
  BasePlannerConfig config;
  config.max_iterations = 300;
  config.shortcut_rounds = 25;
  const BasePlanner planner(config, kBaseLimits, kBaseFootprint);
  constexpr double kCell_m = 0.05;
  // Between two looks nothing moves farther than a quarter of a cell: every pose is within half of that of a look.
  constexpr double kBeside_m = 0.125 * kCell_m;
  int on_way = 0;
  int in_padding = 0;
  int behind = 0;
  for (std::uint64_t seed = 1; seed <= 120; ++seed) {
    const Problem problem = randomProblem(seed);
    const BasePlan plan = planner.plan(std::make_shared<NavigationGrid>(problem.grid), problem.start, problem.goal);
    if (plan.status != BasePlanStatus::kSolved) continue;
    const double length_m = plan.path.length();
    Random random(5000 + seed);
    const std::vector<BasePath::Sample> dense = plan.path.sample(0.005, circumscribedRadius(kBaseFootprint));
    for (int k = 0; k < 8; ++k) {
      SCOPED_TRACE("seed " + std::to_string(seed) + ", obstacle " + std::to_string(k));
      const BasePath::Sample& sample = dense[static_cast<std::size_t>(random.uniform(0, 1) * (dense.size() - 1))];
      // A place under the footprint, or under its padding where that is planned with.
      const bool has_padding =
          sample.at_m > plan.tight_start_m + 0.02 && sample.at_m < length_m - plan.tight_end_m - 0.02;
      const double grown_m = (has_padding ? config.padding_m : config.goal_padding_m) - kBeside_m - 1e-6;
      Eigen::Vector2d p(random.uniform(-0.527 - grown_m, 0.296 + grown_m), random.uniform(-0.296, 0.296));
      if (has_padding && k % 2 == 0) {  // in the padding itself, beside
        p.y() = std::copysign(0.296 + random.uniform(0.0, grown_m), p.y());
        ++in_padding;
      } else {
        p.y() *= (0.296 + std::min(0.0, grown_m)) / 0.296;
        ++on_way;
      }
      const auto painted = std::make_shared<NavigationGrid>(problem.grid);
      const Eigen::Vector2i cell = painted->cellOf(transform(sample.pose, p));
      SpaceState& state = painted->state[painted->index(cell.x(), cell.y())];
      ASSERT_EQ(state, SpaceState::kFree);
      state = k % 3 == 0 ? SpaceState::kUnknown : SpaceState::kOccupied;
      const FootprintVerdict found = planner.recheck(plan, 0.0, painted);
      EXPECT_EQ(found.state, state);
      EXPECT_EQ(painted->cellOf(found.where_map), cell);
      EXPECT_LE(found.at_m, sample.at_m + kBeside_m + 1e-6);
      EXPECT_EQ(planner.recheck(plan, found.at_m, painted).at_m, found.at_m);

      // From where the oracle sees it no more, corners and the space between looks apart, it is left behind.
      NavigationGrid alone = makeGrid(160, 160, SpaceState::kFree);
      alone.state[alone.index(cell.x(), cell.y())] = SpaceState::kOccupied;
      const PathOracle oracle(alone, kBaseFootprint);
      std::size_t last = 0;
      for (std::size_t i = dense.size(); i-- > 0 && last == 0;) {
        const Pose2d& pose = dense[i].pose;
        if (!oracle.isFree(pose.x_m, pose.y_m, pose.yaw_rad, std::sqrt(2.0) * config.padding_m + 0.005)) last = i;
      }
      if (dense[last].at_m + 0.01 >= length_m) continue;
      ++behind;
      EXPECT_TRUE(planner.recheck(plan, dense[last].at_m + 0.01, painted).isFree());
    }
    if (HasFailure()) break;
  }
  EXPECT_GT(on_way, 100);
  EXPECT_GT(in_padding, 50);
  EXPECT_GT(behind, 100);
}

TEST(BasePlannerRandom, SearchesNothingWhereThereIsRoomToTurnAllTheWay) {
  BasePlannerConfig config;
  config.max_iterations = 1;  // chance finds nothing
  config.shortcut_rounds = 5;
  const BasePlanner planner(config, kBaseLimits, kBaseFootprint);
  int wide = 0;
  for (std::uint64_t seed = 1; seed <= 150; ++seed) {
    const Problem problem = randomProblem(seed);
    if (!hasWideWay(problem, config)) continue;
    ++wide;
    const BasePlan plan = planner.plan(std::make_shared<NavigationGrid>(problem.grid), problem.start, problem.goal);
    EXPECT_EQ(plan.status, BasePlanStatus::kSolved) << "seed " << seed << ": " << plan.message;
  }
  EXPECT_GT(wide, 30);
}

}  // namespace
}  // namespace base_navigation
