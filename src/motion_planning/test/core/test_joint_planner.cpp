// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning/joint_planner.h"

#include <atomic>
#include <chrono>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <thread>

#include <gmock/gmock.h>

namespace motion_planning {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

/// Zero but for two joints.
ArmVector at(double a, double b) {
  ArmVector q = ArmVector::Zero();
  q[0] = a;
  q[1] = b;
  return q;
}

JointSpace spaceWith(std::function<bool(const ArmVector&)> is_valid) {
  JointSpace space;
  space.lower_rad.setConstant(-2.0);
  space.upper_rad.setConstant(2.0);
  space.is_valid = std::move(is_valid);
  return space;
}

/// A wall across joint 0, 0.1 rad thick, open where joint 1 is in [1.0, 1.6] and joint 2 in [-0.5, 0.5].
bool wallWithHole(const ArmVector& q) {
  if (std::abs(q[0]) > 0.05) return true;
  return q[1] > 1.0 && q[1] < 1.6 && std::abs(q[2]) < 0.5;
}

double lengthOf(const JointPath& path) {
  double length = 0.0;
  for (std::size_t i = 0; i + 1 < path.size(); ++i) length += (path[i + 1] - path[i]).norm();
  return length;
}

/// Whether no state is beyond the limits or deeper in the wall than half a step, looking ten times as densely as the
/// planner. Shallower is what lies between two states that were checked: a corner may be cut by that.
bool passesTheHole(const JointPath& path, const JointPlannerConfig& config) {
  const double depth = 0.5 * config.check_step_rad + 1e-9;
  for (std::size_t i = 0; i + 1 < path.size(); ++i) {
    const ArmVector way = path[i + 1] - path[i];
    const int parts = 1 + static_cast<int>(10.0 * way.lpNorm<Eigen::Infinity>() / config.check_step_rad);
    for (int k = 0; k <= parts; ++k) {
      const ArmVector q = path[i] + way * (static_cast<double>(k) / parts);
      if (q.cwiseAbs().maxCoeff() > 2.0) return false;
      const bool in_hole = q[1] > 1.0 - depth && q[1] < 1.6 + depth && std::abs(q[2]) < 0.5 + depth;
      if (std::abs(q[0]) < 0.05 - depth && !in_hole) return false;
    }
  }
  return true;
}

TEST(JointPlanner, StraightLineWhenNothingIsInTheWay) {
  const JointSpace space = spaceWith([](const ArmVector&) { return true; });
  const JointPlanResult result = planJointPath(space, at(-1, 0), {at(1, 0.5)}, {});
  EXPECT_EQ(result.status, JointPlanStatus::kSolved);
  EXPECT_EQ(result.path, (JointPath{at(-1, 0), at(1, 0.5)}));
  EXPECT_EQ(result.iterations, 0);
  // 2 rad in steps of 0.035 rad: 58 parts, 57 states between, and both ends.
  EXPECT_EQ(result.states_checked, 59u);
}

TEST(JointPlanner, FindsTheHoleInAWall) {
  const JointSpace space = spaceWith(wallWithHole);
  double sum = 0.0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    JointPlannerConfig config;
    config.seed = seed;
    const JointPlanResult result = planJointPath(space, at(-1, -1), {at(1, -1)}, config);
    ASSERT_EQ(result.status, JointPlanStatus::kSolved) << seed;
    EXPECT_EQ(result.path.front(), at(-1, -1));
    EXPECT_EQ(result.path.back(), at(1, -1));
    EXPECT_TRUE(passesTheHole(result.path, config)) << seed;
    EXPECT_GT(result.iterations, 0);
    // Shortest: over the hole's lower edge, which may be cut by half a step.
    EXPECT_GE(lengthOf(result.path), 2.0 * std::hypot(0.95, 2.0 - config.check_step_rad) + 0.1);
    sum += lengthOf(result.path) / (2.0 * std::hypot(0.95, 2.0) + 0.1);
  }
  // Shortened by chance, not optimal: on the average a fifth longer than the shortest.
  EXPECT_LE(sum / 40.0, 1.2);
}

TEST(JointPlanner, ShorteningNeverLengthens) {
  const JointSpace space = spaceWith(wallWithHole);
  double raw_sum = 0.0;
  double short_sum = 0.0;
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    JointPlannerConfig config;
    config.seed = seed;
    const JointPlanResult shortened = planJointPath(space, at(-1, -1), {at(1, -1)}, config);
    config.shortcut_rounds = 0;
    config.smooth_rounds = 0;
    const JointPlanResult raw = planJointPath(space, at(-1, -1), {at(1, -1)}, config);
    ASSERT_EQ(raw.status, JointPlanStatus::kSolved);
    EXPECT_EQ(raw.iterations, shortened.iterations);  // the same trees
    EXPECT_LE(lengthOf(shortened.path), lengthOf(raw.path) * (1.0 + 1e-12)) << seed;
    raw_sum += lengthOf(raw.path);
    short_sum += lengthOf(shortened.path);
  }
  EXPECT_LT(short_sum, 0.9 * raw_sum);
}

TEST(JointPlanner, GivesUpAfterExactlyMaxIterationsWhereThereIsNoWay) {
  const JointSpace space = spaceWith([](const ArmVector& q) { return std::abs(q[0]) > 0.05; });
  for (const int iterations : {1, 7, 500}) {
    JointPlannerConfig config;
    config.max_iterations = iterations;
    const JointPlanResult result = planJointPath(space, at(-1, 0), {at(1, 0)}, config);
    EXPECT_EQ(result.status, JointPlanStatus::kIterations);
    EXPECT_EQ(result.iterations, iterations);
    EXPECT_THAT(result.path, IsEmpty());
  }
}

TEST(JointPlanner, SameArgumentsSamePathAlsoBesideOtherPlanners) {
  const JointSpace space = spaceWith(wallWithHole);
  const auto plan = [&](std::uint64_t seed) {
    JointPlannerConfig config;
    config.seed = seed;
    return planJointPath(space, at(-1, -1), {at(1, -1), at(1.5, 0)}, config);
  };
  const JointPlanResult first = plan(7);
  std::atomic<bool> same{true};
  std::vector<std::thread> threads;
  for (int thread = 0; thread < 3; ++thread) {
    threads.emplace_back([&, thread] {
      for (int n = 0; n < 10; ++n) {
        if (thread == 2) {
          plan(100 + static_cast<std::uint64_t>(n));  // others that draw numbers meanwhile
          continue;
        }
        const JointPlanResult again = plan(7);
        if (again.path != first.path || again.iterations != first.iterations ||
            again.states_checked != first.states_checked || again.goal != first.goal) {
          same = false;
        }
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_TRUE(same);
  EXPECT_NE(plan(8).path, first.path);
}

TEST(JointPlanner, NearestGoalThatCanBeReachedStraight) {
  const JointSpace space = spaceWith(wallWithHole);
  const JointPlanResult result =
      planJointPath(space, at(-1, 0), {at(-1, 1.9), at(-0.5, 0), at(-1.2, 0.9), at(0.1, 0)}, {});
  EXPECT_EQ(result.status, JointPlanStatus::kSolved);
  EXPECT_EQ(result.goal, 1u);
}

TEST(JointPlanner, GoesToTheOnlyGoalThatIsConnected) {
  // Joint 0 beyond 1.2 is cut off.
  const JointSpace space = spaceWith([](const ArmVector& q) { return wallWithHole(q) && std::abs(q[0] - 1.2) > 0.05; });
  const JointPlanResult result = planJointPath(space, at(-1, -1), {at(1.5, -1), at(1.6, 0), at(0.8, -1)}, {});
  ASSERT_EQ(result.status, JointPlanStatus::kSolved);
  EXPECT_EQ(result.goal, 2u);
  EXPECT_EQ(result.path.back(), at(0.8, -1));
}

TEST(JointPlanner, SaysWhetherStartOrGoalIsInvalid) {
  const JointSpace space = spaceWith(wallWithHole);
  EXPECT_EQ(planJointPath(space, at(0, 0), {at(1, 0)}, {}).status, JointPlanStatus::kStartInvalid);
  EXPECT_EQ(planJointPath(space, at(-3, 0), {at(1, 0)}, {}).status, JointPlanStatus::kStartInvalid);  // limits
  EXPECT_EQ(planJointPath(space, at(1, 0), {at(0, 0), at(3, 0)}, {}).status, JointPlanStatus::kGoalInvalid);
  // One bad goal among good ones is left out.
  const JointPlanResult result = planJointPath(space, at(1, 0), {at(0, 0), at(1.5, 0)}, {});
  EXPECT_EQ(result.status, JointPlanStatus::kSolved);
  EXPECT_EQ(result.goal, 1u);
}

TEST(JointPlanner, StartIsTheGoal) {
  const JointPlanResult result = planJointPath(spaceWith(wallWithHole), at(1, 0), {at(1, 0)}, {});
  EXPECT_EQ(result.status, JointPlanStatus::kSolved);
  EXPECT_EQ(result.path.front(), result.path.back());
}

TEST(JointPlanner, CancelledWithin100MillisecondsOfSlowChecks) {
  using Clock = std::chrono::steady_clock;
  // Spins for a millisecond: what a check costs in a full scene, with room.
  const JointSpace space = spaceWith([](const ArmVector& q) {
    const Clock::time_point end = Clock::now() + std::chrono::milliseconds(1);
    while (Clock::now() < end) {
    }
    return std::abs(q[0]) > 0.05;
  });
  const Clock::time_point start = Clock::now();
  const auto is_cancelled = [&] { return Clock::now() - start > std::chrono::milliseconds(150); };
  const JointPlanResult result = planJointPath(space, at(-1, 0), {at(1, 0)}, {}, is_cancelled);
  const double late_s = std::chrono::duration<double>(Clock::now() - start).count() - 0.15;
  EXPECT_EQ(result.status, JointPlanStatus::kCancelled);
  EXPECT_THAT(result.path, IsEmpty());
  EXPECT_GE(late_s, 0.0);
  EXPECT_LT(late_s, 0.1);
}

TEST(JointPlanner, CancelledAtAnyMomentIsCancelledAndNothingElse) {
  const JointSpace space = spaceWith(wallWithHole);
  const std::size_t all = planJointPath(space, at(-1, -1), {at(1, -1)}, {}).states_checked;
  for (std::size_t after = 0; after < all; after += 1 + all / 50) {
    std::size_t asked = 0;
    const JointPlanResult result = planJointPath(space, at(-1, -1), {at(1, -1)}, {}, [&] { return asked++ >= after; });
    EXPECT_EQ(result.status, JointPlanStatus::kCancelled) << after;
    EXPECT_THAT(result.path, IsEmpty());
    EXPECT_LE(result.states_checked, after);
  }
}

TEST(JointPlanner, DrawsFromTheGivenSamplerAlone) {
  JointSpace space = spaceWith(wallWithHole);
  space.sample = [](const std::function<double()>& uniform01) {
    const double a = -2.0 + 4.0 * uniform01();
    return at(a, -2.0 + 4.0 * uniform01());
  };
  const JointPlanResult result = planJointPath(space, at(-1, -1), {at(1, -1)}, {});
  ASSERT_EQ(result.status, JointPlanStatus::kSolved);
  ASSERT_GT(result.path.size(), 2u);
  for (const ArmVector& q : result.path) EXPECT_EQ(q.tail<4>(), at(0, 0).tail<4>());
}

TEST(JointPlanner, SamplesStayInTheWindow) {
  JointSpace space = spaceWith([](const ArmVector& q) {
    EXPECT_LE(q.cwiseAbs().maxCoeff(), 1.5 + 1e-12);
    return wallWithHole(q);
  });
  JointPlannerConfig config;
  config.joint_window_rad = 0.5;  // the hole is not in it
  config.max_iterations = 200;
  EXPECT_EQ(planJointPath(space, at(-1, -1), {at(1, -1)}, config).status, JointPlanStatus::kIterations);
  space.sample = [](const std::function<double()>& uniform01) {
    return ArmVector(ArmVector::Constant(-2.0 + 4.0 * uniform01()));
  };
  EXPECT_EQ(planJointPath(space, at(-1, -1), {at(1, -1)}, config).status, JointPlanStatus::kIterations);
}

TEST(JointPlanner, RefusesBadArguments) {
  const JointSpace space = spaceWith(wallWithHole);
  const ArmVector bad = ArmVector::Constant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_THROW(planJointPath(space, bad, {at(1, 0)}, {}), std::invalid_argument);
  EXPECT_THROW(planJointPath(space, at(1, 0), {bad}, {}), std::invalid_argument);
  EXPECT_THROW(planJointPath(space, at(1, 0), {}, {}), std::invalid_argument);
  EXPECT_THROW(planJointPath({}, at(1, 0), {at(1, 0)}, {}), std::invalid_argument);
  JointSpace unbounded = space;
  unbounded.upper_rad[3] = std::numeric_limits<double>::infinity();
  EXPECT_THROW(planJointPath(unbounded, at(1, 0), {at(1, 0)}, {}), std::invalid_argument);
  JointPlannerConfig config;
  config.joint_window_rad = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(planJointPath(space, at(1, 0), {at(1, 0)}, config), std::invalid_argument);
}

}  // namespace
}  // namespace motion_planning
