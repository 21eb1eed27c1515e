// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/base_path.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>

namespace base_navigation {
namespace {

// The limits of the simulated base.
const MotionLimits kLimits{0.8, 0.1, 0.6, 0.2, 0.6, 1.0};

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double uniform(double lower, double upper) {
    return lower + (upper - lower) * static_cast<double>(engine_() >> 11) * 0x1.0p-53;
  }

 private:
  std::mt19937_64 engine_;
};

BasePath randomPath(Random* random, int motions) {
  BasePath path;
  path.start = {random->uniform(-3, 3), random->uniform(-3, 3), random->uniform(-3, 3)};
  for (int i = 0; i < motions; ++i) {
    const double kind = random->uniform(0, 3);
    const double length_m = random->uniform(0.05, 1.5) * (random->uniform(0, 1) < 0.7 ? 1 : -1);
    const double turn_rad = random->uniform(-2, 2);
    if (kind < 1) {
      path.motions.push_back({length_m, 0.0});
    } else if (kind < 2) {
      path.motions.push_back({0.0, turn_rad});
    } else {
      path.motions.push_back({length_m, turn_rad});
    }
  }
  return path;
}

void expectSamePose(const Pose2d& a, const Pose2d& b, double tolerance) {
  EXPECT_NEAR(a.x_m, b.x_m, tolerance);
  EXPECT_NEAR(a.y_m, b.y_m, tolerance);
  EXPECT_NEAR(wrapAngle(a.yaw_rad - b.yaw_rad), 0.0, tolerance);
}

/// Time by stepping along the stretch: v dv/ds <= a from both ends, what has the lower speed holds.
double integratedDuration(const BasePath& path, const MotionLimits& limits) {
  constexpr int kSteps = 4000;  // per motion
  double time_s = 0.0;
  std::vector<double> ds, cap, rate;  // of the steps between two stops
  const auto drive = [&] {
    std::vector<double> v_squared(ds.size() + 1, 0.0);
    for (std::size_t k = 1; k < v_squared.size(); ++k) {
      const double next = k < ds.size() ? std::min(cap[k - 1], cap[k]) : 0.0;
      v_squared[k] = std::min(next * next, v_squared[k - 1] + 2 * rate[k - 1] * ds[k - 1]);
    }
    for (std::size_t k = ds.size(); k-- > 0;) {
      v_squared[k] = std::min(v_squared[k], v_squared[k + 1] + 2 * rate[k] * ds[k]);
    }
    for (std::size_t k = 0; k < ds.size(); ++k) {
      time_s += 2 * ds[k] / (std::sqrt(v_squared[k]) + std::sqrt(v_squared[k + 1]));
    }
    ds.clear();
    cap.clear();
    rate.clear();
  };
  for (std::size_t i = 0; i < path.motions.size(); ++i) {
    const BaseMotion& motion = path.motions[i];
    const bool is_turn = motion.length_m == 0.0;
    if (i > 0) {
      const BaseMotion& before = path.motions[i - 1];
      if (is_turn || before.length_m == 0.0 || motion.length_m * before.length_m < 0.0) drive();
    }
    for (int k = 0; k < kSteps; ++k) {
      const double curvature = is_turn ? 0.0 : std::abs(motion.turn_rad / motion.length_m);
      const double along = motion.length_m > 0.0 ? limits.forward_m_s : limits.backward_m_s;
      ds.push_back(std::abs(is_turn ? motion.turn_rad : motion.length_m) / kSteps);
      cap.push_back(is_turn ? limits.turn_rad_s : std::min(along, limits.turn_rad_s / std::max(curvature, 1e-9)));
      rate.push_back(is_turn ? limits.turn_rad_s2
                             : std::min(limits.linear_m_s2, limits.turn_rad_s2 / std::max(curvature, 1e-9)));
    }
  }
  drive();
  return time_s;
}

TEST(BasePath, PosesAreTheIntegralOfTheMotions) {
  Random random(1);
  for (int trial = 0; trial < 20; ++trial) {
    const BasePath path = randomPath(&random, 6);
    Pose2d slow = path.start;
    for (std::size_t i = 0; i < path.motions.size(); ++i) {
      constexpr int kSteps = 4000;  // midpoint rule: its error falls with the square of the step
      for (int k = 0; k < kSteps; ++k) {
        if (k == kSteps / 4) expectSamePose(path.pose(i, 0.25), slow, 1e-5);
        const double middle_rad = slow.yaw_rad + 0.5 * path.motions[i].turn_rad / kSteps;
        slow.x_m += path.motions[i].length_m / kSteps * std::cos(middle_rad);
        slow.y_m += path.motions[i].length_m / kSteps * std::sin(middle_rad);
        slow.yaw_rad += path.motions[i].turn_rad / kSteps;
      }
      expectSamePose(path.pose(i, 1.0), slow, 1e-5);
    }
    expectSamePose(path.end(), slow, 1e-5);
  }
}

TEST(BasePath, LengthAndTurnCountEveryMotionUnsigned) {
  const BasePath path{{}, {{-0.5, 0.0}, {0.0, -1.0}, {1.0, 0.5}, {0.25, -0.25}}};
  EXPECT_DOUBLE_EQ(path.length(), 1.75);
  EXPECT_DOUBLE_EQ(path.turn(), 1.75);
  EXPECT_DOUBLE_EQ(BasePath{}.length(), 0.0);
  EXPECT_THROW(path.pose(4, 0.0), std::invalid_argument);
}

TEST(BasePath, SamplesMoveNoPointOfTheBaseFartherThanTheStep) {
  Random random(2);
  for (int trial = 0; trial < 50; ++trial) {
    const BasePath path = randomPath(&random, 5);
    const double step_m = random.uniform(0.01, 0.2);
    const double radius_m = random.uniform(0.0, 0.8);
    const std::vector<BasePath::Sample> samples = path.sample(step_m, radius_m);
    double most_m = 0.0;
    for (std::size_t k = 0; k + 1 < samples.size(); ++k) {
      for (int spoke = 0; spoke < 24; ++spoke) {
        const Eigen::Vector2d point =
            radius_m * Eigen::Vector2d(std::cos(spoke * M_PI / 12), std::sin(spoke * M_PI / 12));
        most_m = std::max(most_m, (transform(samples[k + 1].pose, point) - transform(samples[k].pose, point)).norm());
      }
    }
    EXPECT_LE(most_m, step_m * (1 + 1e-9));
    // No waste either: steps of each motion are within one of the fewest for a straight line or turn.
    double moved_m = 0.0;
    for (const BaseMotion& motion : path.motions) {
      moved_m += std::abs(motion.length_m) + std::abs(motion.turn_rad) * radius_m;
    }
    EXPECT_LE(samples.size(), moved_m / step_m + static_cast<double>(path.motions.size()) + 1);
  }
}

TEST(BasePath, SamplesTellWhereTheyAre) {
  Random random(3);
  const BasePath path = randomPath(&random, 8);
  const std::vector<BasePath::Sample> samples = path.sample(0.05, 0.6);
  expectSamePose(samples.front().pose, path.start, 0.0);
  expectSamePose(samples.back().pose, path.end(), 1e-12);
  EXPECT_NEAR(samples.back().at_m, path.length(), 1e-12);
  std::size_t joints = 0;
  for (std::size_t k = 0; k < samples.size(); ++k) {
    expectSamePose(samples[k].pose, path.pose(samples[k].motion, samples[k].along), 1e-12);
    double before_m = 0.0;
    for (std::size_t i = 0; i < samples[k].motion; ++i) before_m += std::abs(path.motions[i].length_m);
    EXPECT_NEAR(samples[k].at_m, before_m + samples[k].along * std::abs(path.motions[samples[k].motion].length_m),
                1e-12);
    joints += samples[k].along == 1.0;
  }
  EXPECT_EQ(joints, path.motions.size());
  ASSERT_EQ(BasePath{}.sample(0.1, 0.1).size(), 1u);
}

TEST(BasePath, SampleRefusesTheImpossible) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const BasePath path{{}, {{1.0, 0.0}}};
  EXPECT_THROW(path.sample(0.0, 0.5), std::invalid_argument);
  EXPECT_THROW(path.sample(nan, 0.5), std::invalid_argument);
  EXPECT_THROW(path.sample(0.1, -0.5), std::invalid_argument);
  EXPECT_THROW(path.sample(0.1, nan), std::invalid_argument);
  const BasePath bad{{}, {{nan, 0.0}}};
  EXPECT_THROW(bad.sample(0.1, 0.5), std::invalid_argument);
}

TEST(BasePath, TidyJoinsWhatIsOneAndDropsWhatIsNothing) {
  BasePath path{{1, 2, 0.5},
                {{1.0, 0.5},
                 {2.0, 1.0},          // one curve
                 {0.00005, 0.00005},  // nothing
                 {0.5, 0.25},         // the same curve again
                 {0.5, 0.0},
                 {-0.5, 0.0},  // there and back is driven
                 {0.0, 1.0},
                 {0.0, 0.5},
                 {0.0, -0.2},  // a turn
                 {0.3, 0.1},
                 {0.3, 0.2}}};  // two curves
  path.tidy();
  ASSERT_EQ(path.motions.size(), 6u);
  EXPECT_DOUBLE_EQ(path.motions[0].length_m, 3.5);
  EXPECT_DOUBLE_EQ(path.motions[0].turn_rad, 1.75);
  EXPECT_DOUBLE_EQ(path.motions[3].turn_rad, 1.3);
  BasePath turned_back{{}, {{1.0, 0.0}, {0.0, 0.7}, {0.0, -0.7}, {1.0, 0.0}}};
  turned_back.tidy();
  ASSERT_EQ(turned_back.motions.size(), 1u);
  EXPECT_DOUBLE_EQ(turned_back.motions[0].length_m, 2.0);
  BasePath crumbs{{}, std::vector<BaseMotion>(1000, {0.00005, 0.00001})};  // 5 cm in all
  crumbs.tidy();
  ASSERT_EQ(crumbs.motions.size(), 1u);
  EXPECT_NEAR(crumbs.length(), 0.05, 1e-12);
}

TEST(BasePath, TidyMovesNothing) {
  Random random(4);
  for (int trial = 0; trial < 50; ++trial) {
    BasePath path = randomPath(&random, 5);
    BasePath cut{path.start, {}};
    for (const BaseMotion& motion : path.motions) {
      for (const double part : {0.3, 0.2, 0.5}) cut.motions.push_back({part * motion.length_m, part * motion.turn_rad});
    }
    cut.tidy();
    EXPECT_LE(cut.motions.size(), path.motions.size());
    expectSamePose(cut.end(), path.end(), 1e-9);
    path.tidy();
    EXPECT_EQ(cut.motions.size(), path.motions.size());
  }
}

TEST(BasePath, StretchesEndWhereTheBaseStands) {
  const BasePath path{{}, {{1.0, 0.0}, {1.0, 0.5}, {-0.5, 0.1}, {-0.5, 0.0}, {0.0, -0.4}, {0.0, 0.3}, {2.0, -0.2}}};
  const std::vector<Stretch> parts = stretches(path);
  ASSERT_EQ(parts.size(), 5u);
  const std::vector<std::size_t> begins = {0, 2, 4, 5, 6};
  const std::vector<double> lengths_m = {2.0, 1.0, 0.0, 0.0, 2.0};
  const std::vector<double> turns_rad = {0.5, 0.1, -0.4, 0.3, -0.2};
  for (std::size_t i = 0; i < parts.size(); ++i) {
    EXPECT_EQ(parts[i].begin, begins[i]);
    EXPECT_EQ(parts[i].end, i + 1 < parts.size() ? begins[i + 1] : path.motions.size());
    EXPECT_DOUBLE_EQ(parts[i].length_m, lengths_m[i]);
    EXPECT_DOUBLE_EQ(parts[i].turn_rad, turns_rad[i]);
    EXPECT_EQ(parts[i].is_turn, i == 2 || i == 3);
    if (!parts[i].is_turn) {
      EXPECT_EQ(parts[i].is_forward, i != 1);
    }
  }
  EXPECT_TRUE(stretches(BasePath{}).empty());
}

TEST(BasePathDuration, OfOneMotionIsTheTrapezoids) {
  // 4 s up to 0.8 m/s and 4 s down take 1.6 m each.
  EXPECT_NEAR(duration({{}, {{5.2, 0.0}}}, kLimits), 4 + 4 + (5.2 - 3.2) / 0.8, 1e-12);
  EXPECT_NEAR(duration({{}, {{0.2, 0.0}}}, kLimits), 2 * std::sqrt(0.2 / 0.2), 1e-12);  // never at full speed
  EXPECT_NEAR(duration({{}, {{-1.05, 0.0}}}, kLimits), 0.5 + 0.5 + 1.0 / 0.1, 1e-12);
  EXPECT_NEAR(duration({{}, {{0.0, -2.4}}}, kLimits), 1 + 1 + (2.4 - 0.6) / 0.6, 1e-12);
  // Radius 0.5 m: at 0.3 m/s it turns at 0.6 rad/s; 1.5 s and 0.225 m up and down.
  EXPECT_NEAR(duration({{}, {{1.45, -2.9}}}, kLimits), 3 + 1.0 / 0.3, 1e-12);
  EXPECT_EQ(duration(BasePath{}, kLimits), 0.0);
}

TEST(BasePathDuration, AgreesWithSteppingAlongThePath) {
  Random random(5);
  for (int trial = 0; trial < 60; ++trial) {
    const BasePath path = randomPath(&random, 1 + trial % 7);
    MotionLimits limits = kLimits;
    if (trial % 3 == 1) limits = {0.3, 0.3, 1.2, 0.4, 0.2};  // turning faster and faster limits curves, too
    const double slow_s = integratedDuration(path, limits);
    // Constant acceleration within a step is exact but where a speed limit is met inside of it.
    EXPECT_NEAR(duration(path, limits), slow_s, 2e-4 * slow_s);
  }
}

TEST(BasePathDuration, CuttingMotionsCostsNothing) {
  Random random(6);
  for (int trial = 0; trial < 20; ++trial) {
    BasePath path = randomPath(&random, 4);
    path.tidy();
    BasePath cut{path.start, {}};
    for (const BaseMotion& motion : path.motions) {
      if (motion.isTurn()) {
        cut.motions.push_back(motion);
        continue;
      }
      for (const double part : {0.1, 0.6, 0.3}) cut.motions.push_back({part * motion.length_m, part * motion.turn_rad});
    }
    EXPECT_NEAR(duration(cut, kLimits), duration(path, kLimits), 1e-9);
  }
}

TEST(MotionLimits, ListsEveryImpossibleValue) {
  EXPECT_TRUE(kLimits.validate().empty());
  EXPECT_EQ(MotionLimits{}.validate().size(), 6u);
  MotionLimits limits = kLimits;
  limits.turn_rad_s = std::numeric_limits<double>::quiet_NaN();
  ASSERT_EQ(limits.validate().size(), 1u);
  EXPECT_THAT(limits.validate()[0], testing::HasSubstr("turn_rad_s = nan rad/s, must be in"));
}

}  // namespace
}  // namespace base_navigation
