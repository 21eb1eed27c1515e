// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/path_follower.h"

#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

#include "support/plant.h"

namespace base_navigation {
namespace {

using test_support::messageOf;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr double kDt_s = 0.02;  // odometry's 50 Hz

/// The base's place against the path itself, not against the follower's reference.
double distanceTo(const BasePath& path, const Pose2d& pose_map) {
  double nearest_m = std::numeric_limits<double>::infinity();
  for (const BasePath::Sample& sample : path.sample(0.002, 0.0)) {
    nearest_m = std::min(nearest_m, (sample.pose.position() - pose_map.position()).norm());
  }
  return nearest_m;
}

struct Course {
  FollowStatus status{FollowStatus::kRunning};
  double time_s{0.0};
  double largest_across_m{0.0};
  Pose2d end_map;
  double max_linear_m_s{0.0};
  std::vector<Twist2d> commands;

  double off_m(const Pose2d& goal) const { return (end_map.position() - goal.position()).norm(); }
  double off_rad(const Pose2d& goal) const { return std::abs(wrapAngle(end_map.yaw_rad - goal.yaw_rad)); }
};

/// Follows the path with the plant; nothing may leave the limits of speed and acceleration.
Course follow(const BasePath& path, Plant plant, std::uint64_t seed = 1, const PathFollowerConfig& config = {},
              const std::function<double(double)>& speed_factor = {}) {
  const MotionLimits limits = shippedLimits();
  PathFollower follower(config, limits);
  follower.start(path);
  std::mt19937_64 random(seed);
  Course run;
  Twist2d last;
  while (run.status == FollowStatus::kRunning && run.time_s < 200.0) {
    const FollowCommand command =
        follower.update(plant.localized(&random), kDt_s, speed_factor ? speed_factor(run.time_s) : 1.0);
    run.status = command.status;
    EXPECT_LE(command.twist.linear_m_s, limits.forward_m_s + 1e-9);
    EXPECT_GE(command.twist.linear_m_s, -limits.backward_m_s - 1e-9);
    EXPECT_LE(std::abs(command.twist.angular_rad_s), limits.turn_rad_s + 1e-9);
    EXPECT_LE(std::abs(command.twist.linear_m_s - last.linear_m_s), limits.linear_m_s2 * kDt_s + 1e-9);
    EXPECT_LE(std::abs(command.twist.angular_rad_s - last.angular_rad_s), limits.turn_rad_s2 * kDt_s + 1e-9);
    last = command.twist;
    run.commands.push_back(last);
    run.max_linear_m_s = std::max(run.max_linear_m_s, std::abs(last.linear_m_s));
    plant.step(command.twist, kDt_s);
    run.time_s += kDt_s;
    if (static_cast<int>(run.commands.size()) % 5 == 0) {
      run.largest_across_m = std::max(run.largest_across_m, distanceTo(path, plant.poseMap()));
    }
  }
  for (int i = 0; i < 50; ++i) plant.step({}, kDt_s);
  run.end_map = plant.poseMap();
  return run;
}

BasePath pathOf(const Pose2d& start, const std::vector<BaseMotion>& motions) {
  BasePath path;
  path.start = start;
  path.motions = motions;
  return path;
}

constexpr double kRadius_m = 0.35;

/// Curves of the smallest radius planned with, both ways, with and without straight parts between.
std::vector<BasePath> curvedPaths() {
  return {
      pathOf({0.5, -0.2, 0.7}, {{0.5, 0.0}, {kRadius_m * 1.5, 1.5}, {0.6, 0.0}}),
      pathOf({0.0, 0.0, -2.0}, {{kRadius_m * 1.0, 1.0}, {kRadius_m * 1.5, -1.5}, {0.4, 0.0}}),
      pathOf({1.0, 2.0, 3.0}, {{1.5, 0.0}, {kRadius_m * M_PI, -M_PI}, {0.1, 0.0}, {kRadius_m * 0.5, 0.5}, {0.5, 0.0}}),
      pathOf({0.0, 0.0, 0.0}, {{-0.3, 0.0}, {-kRadius_m * 1.2, 1.2}, {-0.2, 0.0}}),
      pathOf({0.0, 0.0, 0.0}, {{-kRadius_m * 0.8, -0.8}, {-kRadius_m * 0.8, 0.8}, {0.6, 0.0}, {kRadius_m * 0.8, 0.8}}),
      pathOf({0.0, 0.0, 1.0}, {{-0.5, 0.0}, {0.0, 2.8}, {1.5, 0.3}, {0.0, -1.0}, {0.4, 0.0}}),
  };
}

TEST(PathFollower, KeepsToCurves) {
  for (const BasePath& path : curvedPaths()) {
    const Course run = follow(path, Plant({}, path.start));
    EXPECT_EQ(run.status, FollowStatus::kReached);
    EXPECT_LE(run.largest_across_m, 0.02);  // the brief's; the padding of planned paths is 0.03
    EXPECT_LE(run.off_m(path.end()), 0.01);
    // Within half of the navigator's tolerance of a goal, for paths that end in a curve: they stop while turning.
    EXPECT_LE(run.off_rad(path.end()), 0.015);
    RecordProperty("largest_across_m", std::to_string(run.largest_across_m));
  }
}

TEST(PathFollower, TakesNotMuchLongerThanThePathIsLong) {
  for (const BasePath& path : curvedPaths()) {
    const Course run = follow(path, Plant({}, path.start));
    // A tenth of the limits is kept in reserve (1 / 0.9 in time); each stretch ends by creeping within settle of its end.
    const double creeping_s = 3.0 * static_cast<double>(stretches(path).size());
    EXPECT_LE(run.time_s, duration(path, shippedLimits()) / 0.9 + creeping_s);
    EXPECT_GE(run.time_s, duration(path, shippedLimits()));
  }
}

TEST(PathFollower, DrivesStraightAtTheSpeedPlannedFor) {
  const BasePath path = pathOf({}, {{6.0, 0.0}});
  const Course run = follow(path, Plant({}, path.start));
  EXPECT_NEAR(run.max_linear_m_s, 0.9 * 0.8, 0.02);
  const BasePath back = pathOf({}, {{-0.6, 0.0}});
  EXPECT_NEAR(follow(back, Plant({}, back.start)).max_linear_m_s, 0.09, 0.011);
}

TEST(PathFollower, ComesOntoAShortApproach) {
  // 0.4 m straight to the goal with the base 3 cm beside it, or turned, at the start.
  const BasePath path = pathOf({0.0, 0.0, 0.5}, {{0.4, 0.0}});
  for (const Pose2d& error :
       {Pose2d{0.0, 0.03, 0.0}, Pose2d{0.0, -0.03, 0.0}, Pose2d{-0.02, 0.02, 0.05}, Pose2d{0.01, -0.02, -0.05}}) {
    const Course run = follow(path, Plant({}, compose(path.start, error)));
    EXPECT_EQ(run.status, FollowStatus::kReached);
    EXPECT_LE(run.off_m(path.end()), 0.01) << error.y_m;
    EXPECT_LE(run.off_rad(path.end()), 0.6 * M_PI / 180.0) << error.y_m;
  }
}

TEST(PathFollower, BearsTheNoiseOfTheLocalization) {
  // Square to each segment within 3 cm and 3 degrees, with 1 cm and 0.5 degrees of noise.
  PlantConfig noisy;
  noisy.localization_noise_m = 0.01;
  noisy.localization_noise_rad = 0.5 * M_PI / 180.0;
  std::uint64_t seed = 1;
  for (const BasePath& path : curvedPaths()) {
    for (int i = 0; i < 3; ++i) {
      const Course run = follow(path, Plant(noisy, path.start), ++seed);
      EXPECT_EQ(run.status, FollowStatus::kReached);
      EXPECT_LE(run.off_m(path.end()), 0.03);
      EXPECT_LE(run.off_rad(path.end()), 3.0 * M_PI / 180.0);
      EXPECT_LE(run.largest_across_m, 0.03);
    }
  }
}

TEST(PathFollower, BearsDrivesThatDoNotDoAsTold) {
  for (const double slip : {0.01, -0.01, 0.1, -0.05}) {
    PlantConfig config;
    config.slip = slip;
    for (const BasePath& path : curvedPaths()) {
      const Course run = follow(path, Plant(config, path.start));
      EXPECT_EQ(run.status, FollowStatus::kReached) << slip;
      EXPECT_LE(run.off_m(path.end()), 0.01) << slip;
      EXPECT_LE(run.largest_across_m, 0.02) << slip;
    }
  }
}

TEST(PathFollower, CorrectionsPointBackToThePathBothWays) {
  // 4 cm off, forwards and backwards, to both sides: the error falls by nine tenths within a metre.
  for (const double direction : {1.0, -1.0}) {
    for (const double across_m : {0.04, -0.04}) {
      for (const double yaw_rad : {0.1, -0.1}) {
        const BasePath path = pathOf({}, {{direction * 1.2, 0.0}});
        const Course run = follow(path, Plant({}, {0.0, across_m, yaw_rad}));
        EXPECT_EQ(run.status, FollowStatus::kReached);
        EXPECT_LE(std::abs(run.end_map.y_m), 0.004);
        EXPECT_LE(std::abs(run.end_map.yaw_rad), 0.01);
      }
    }
  }
}

TEST(PathFollower, ReportsTheErrorSeenFromTheReference) {
  PathFollower follower({}, shippedLimits());
  follower.start(pathOf({1.0, 2.0, 0.5 * M_PI}, {{1.0, 0.0}}));
  const FollowCommand command = follower.update({0.97, 1.99, 0.5 * M_PI + 0.1}, 1e-6);  // left, behind, turned left
  EXPECT_NEAR(command.error_across_m, 0.03, 1e-6);
  EXPECT_NEAR(command.error_along_m, -0.01, 1e-6);
  EXPECT_NEAR(command.error_yaw_rad, 0.1, 1e-6);
}

TEST(PathFollower, StandsBetweenStretches) {
  const BasePath path = pathOf({}, {{0.5, 0.0}, {0.0, 1.0}, {-0.2, 0.0}, {0.3, 0.0}});
  const MotionLimits limits = shippedLimits();
  PathFollower follower({}, limits);
  follower.start(path);
  Plant plant({}, path.start);
  std::size_t last_motion = 0;
  int changes = 0;
  double at_m = 0.0;
  Twist2d last;
  for (int i = 0; i < 3000; ++i) {
    const FollowCommand command = follower.update(plant.poseMap(), kDt_s);
    if (command.motion != last_motion) {
      // Told to stand in the step before the first of the next stretch.
      EXPECT_EQ(last.linear_m_s, 0.0);
      EXPECT_EQ(last.angular_rad_s, 0.0);
      last_motion = command.motion;
      ++changes;
    }
    EXPECT_GE(command.at_m, at_m - 1e-9);
    at_m = command.at_m;
    last = command.twist;
    if (command.status == FollowStatus::kReached) break;
    plant.step(command.twist, kDt_s);
  }
  EXPECT_EQ(changes, 3);
  EXPECT_NEAR(at_m, 1.0, 0.01);  // the last stretch ends within settle of its end, as its lag is foreseen
  EXPECT_FALSE(follower.isActive());
}

TEST(PathFollower, DecidesTurnsByTheirSignEvenBeyondHalfATurn) {
  for (const double turn_rad : {2.0, -2.0, 4.5, -4.5, 0.05}) {
    const BasePath path = pathOf({0.3, 0.2, 1.0}, {{0.0, turn_rad}});
    const Course run = follow(path, Plant({}, path.start));
    double turned_rad = 0.0;
    for (const Twist2d& command : run.commands) turned_rad += command.angular_rad_s * kDt_s;
    EXPECT_NEAR(turned_rad, turn_rad, 0.03);
    EXPECT_LE(run.off_rad(path.end()), 0.006 + 0.002);  // settle and what the lag adds
  }
}

TEST(PathFollower, WaitsForABaseThatIsHeld) {
  const BasePath path = pathOf({}, {{3.0, 0.0}});
  PathFollower follower({}, shippedLimits());
  follower.start(path);
  FollowCommand command;
  for (int i = 0; i < 500; ++i) command = follower.update({}, kDt_s);
  EXPECT_EQ(command.status, FollowStatus::kRunning);
  // A base that is told to move is expected to have moved by its lag.
  const PathFollowerConfig config;
  EXPECT_LE(command.at_m, config.wait_m + config.lag_s * 0.8 + 1e-9);
  EXPECT_GT(command.twist.linear_m_s, 0.05);  // still pulls
}

TEST(PathFollower, SlowsDownAndStopsForTheGuard) {
  const BasePath path = pathOf({}, {{2.0, 0.0}, {kRadius_m * 1.5, 1.5}, {1.0, 0.0}});
  // Nothing for 4 s under way, on the straight part and in the curve.
  for (const double stop_s : {2.0, 6.0, 8.5}) {
    PathFollower follower({}, shippedLimits());
    follower.start(path);
    Plant plant({}, path.start);
    double speed_at_stop_m_s = 0.0;
    FollowCommand command;
    double stood_s = 0.0;
    for (double t = 0.0; t < 60.0 && command.status == FollowStatus::kRunning; t += kDt_s) {
      const bool is_stopped = t >= stop_s && t < stop_s + 8.0;
      const double before_m_s = command.twist.linear_m_s;
      const Pose2d pose = plant.poseMap();
      command = follower.update(pose, kDt_s, is_stopped ? 0.0 : 1.0);
      if (!is_stopped) {
        speed_at_stop_m_s = t < stop_s ? command.twist.linear_m_s : speed_at_stop_m_s;
      } else {
        // Full deceleration from the first step on.
        EXPECT_LE(command.twist.linear_m_s, std::max(0.0, before_m_s - 0.2 * kDt_s) + 1e-9);
        if (t > stop_s + speed_at_stop_m_s / 0.2 + 1.0) {
          EXPECT_EQ(command.twist.linear_m_s, 0.0);
          EXPECT_EQ(command.twist.angular_rad_s, 0.0);
          stood_s += kDt_s;
        }
      }
      plant.step(command.twist, kDt_s);
      EXPECT_LE(distanceTo(path, plant.poseMap()), 0.02) << stop_s << " " << t;
    }
    EXPECT_GT(speed_at_stop_m_s, 0.1);
    EXPECT_GT(stood_s, 1.0);
    EXPECT_EQ(command.status, FollowStatus::kReached);
  }
}

TEST(PathFollower, KeepsToTheShareOfSpeedThatTheGuardLeaves) {
  const BasePath path = pathOf({}, {{3.0, 0.0}});
  const Course run = follow(path, Plant({}, path.start), 1, {}, [](double) { return 0.25; });
  EXPECT_NEAR(run.max_linear_m_s, 0.25 * 0.72, 1e-6);
  EXPECT_EQ(run.status, FollowStatus::kReached);
  const BasePath turn = pathOf({}, {{0.0, 2.0}});
  double fastest_rad_s = 0.0;
  for (const Twist2d& command : follow(turn, Plant({}, turn.start), 1, {}, [](double) { return 0.25; }).commands) {
    fastest_rad_s = std::max(fastest_rad_s, std::abs(command.angular_rad_s));
  }
  EXPECT_NEAR(fastest_rad_s, 0.25 * 0.54, 1e-6);
}

TEST(PathFollower, TellsTheGuardWhatItWants) {
  PathFollower follower({}, shippedLimits());
  EXPECT_THROW(follower.wanted({}), std::logic_error);
  EXPECT_TRUE(follower.ahead().empty());
  follower.start(pathOf({}, {{1.0, 0.0}, {0.35, 1.0}, {0.0, -0.5}, {-0.4, 0.0}}));
  EXPECT_NEAR(follower.wanted({}).linear_m_s, 0.72, 1e-9);
  EXPECT_NEAR(follower.wanted({}).angular_rad_s, 0.0, 1e-9);
  ASSERT_EQ(follower.ahead().size(), 2u);  // of this stretch
  EXPECT_NEAR(follower.ahead()[0].length_m, 1.0, 1e-9);
  EXPECT_NEAR(follower.ahead()[1].turn_rad, 1.0, 1e-9);
  EXPECT_LT(follower.wanted({0.0, 0.05, 0.0}).angular_rad_s, -0.01);  // left of the path: to the right
  // The arc asked about is the one commanded.
  Plant plant({}, {0.0, 0.02, 0.0});
  for (int i = 0; i < 2000 && follower.isActive(); ++i) {
    const Twist2d wanted = follower.wanted(plant.poseMap());
    const FollowCommand command = follower.update(plant.poseMap(), kDt_s);
    if (command.motion == 2 && wanted.angular_rad_s != 0.0) {
      EXPECT_EQ(wanted.linear_m_s, 0.0);
      EXPECT_LT(wanted.angular_rad_s, 0.0);
    }
    EXPECT_TRUE(command.motion != 3 || wanted.linear_m_s <= 0.0);
    plant.step(command.twist, kDt_s);
  }
  EXPECT_FALSE(follower.isActive());
}

TEST(PathFollower, LosesABaseThatIsTakenAway) {
  for (const Pose2d& away : {Pose2d{0.0, 0.16, 0.0}, Pose2d{-0.16, 0.0, 0.0}, Pose2d{0.0, 0.0, 0.52}}) {
    PathFollower follower({}, shippedLimits());
    follower.start(pathOf({}, {{3.0, 0.0}}));
    Plant plant({}, {});
    FollowCommand command;
    for (int i = 0; i < 100; ++i) {
      command = follower.update(plant.poseMap(), kDt_s);
      plant.step(command.twist, kDt_s);
    }
    ASSERT_EQ(command.status, FollowStatus::kRunning);
    const double before_m_s = command.twist.linear_m_s;
    command = follower.update(compose(plant.poseMap(), away), kDt_s);
    EXPECT_EQ(command.status, FollowStatus::kLost);
    EXPECT_NEAR(command.twist.linear_m_s, before_m_s - 0.2 * kDt_s, 1e-9);  // brakes at once
    EXPECT_FALSE(follower.isActive());
    EXPECT_THROW(follower.update({}, kDt_s), std::logic_error);
  }
}

TEST(PathFollower, BrakesAlongTheArc) {
  PathFollower follower({}, shippedLimits());
  follower.start(pathOf({}, {{2.0, 2.0}}));
  Plant plant({}, {});
  for (int i = 0; i < 150; ++i) plant.step(follower.update(plant.poseMap(), kDt_s).twist, kDt_s);
  const Twist2d before = follower.lastCommand();
  ASSERT_GT(before.linear_m_s, 0.2);
  Twist2d last = before;
  int steps = 0;
  while (last.linear_m_s != 0.0 && steps < 1000) {
    const Twist2d next = follower.brake(kDt_s);
    EXPECT_NEAR(next.angular_rad_s * before.linear_m_s, next.linear_m_s * before.angular_rad_s, 1e-9);
    EXPECT_LE(last.linear_m_s - next.linear_m_s, 0.2 * kDt_s + 1e-9);
    EXPECT_LE(std::abs(last.angular_rad_s - next.angular_rad_s), 0.6 * kDt_s + 1e-9);
    last = next;
    ++steps;
  }
  // As quickly as the slower of both limits allows.
  EXPECT_NEAR(steps * kDt_s, std::max(before.linear_m_s / 0.2, std::abs(before.angular_rad_s) / 0.6), 2.0 * kDt_s);
  follower.halt();
  EXPECT_EQ(follower.lastCommand().linear_m_s, 0.0);
}

TEST(PathFollower, GoesOnWhereItWasStopped) {
  PathFollower follower({}, shippedLimits());
  const BasePath path = pathOf({}, {{3.0, 0.0}});
  follower.start(path);
  Plant plant({}, {});
  for (int i = 0; i < 150; ++i) plant.step(follower.update(plant.poseMap(), kDt_s).twist, kDt_s);
  for (int i = 0; i < 250; ++i) plant.step(follower.pause(kDt_s), kDt_s);
  ASSERT_TRUE(plant.stands());
  const Pose2d stopped = plant.poseMap();
  ASSERT_GT(stopped.x_m, 1.0);
  EXPECT_FALSE(follower.resume({stopped.x_m, 0.2, 0.0}));
  EXPECT_FALSE(follower.resume({stopped.x_m, 0.0, 0.4}));
  ASSERT_TRUE(follower.resume(stopped));
  FollowCommand command = follower.update(plant.poseMap(), kDt_s);
  EXPECT_NEAR(command.at_m, stopped.x_m, 0.002);
  while (command.status == FollowStatus::kRunning) {
    plant.step(command.twist, kDt_s);
    command = follower.update(plant.poseMap(), kDt_s);
  }
  EXPECT_EQ(command.status, FollowStatus::kReached);
  EXPECT_NEAR(plant.poseMap().x_m, 3.0, 0.01);
}

TEST(PathFollower, HasReachedThePathThatIsNone) {
  PathFollower follower({}, shippedLimits());
  follower.start(pathOf({1.0, 1.0, 1.0}, {}));
  const FollowCommand command = follower.update({1.0, 1.0, 1.0}, kDt_s);
  EXPECT_EQ(command.status, FollowStatus::kReached);
  EXPECT_EQ(command.twist.linear_m_s, 0.0);
}

TEST(PathFollower, RefusesWhatItCannotFollow) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  PathFollower follower({}, shippedLimits());
  EXPECT_THROW(follower.update({}, kDt_s), std::logic_error);
  EXPECT_THROW(follower.start(pathOf({nan, 0.0, 0.0}, {{1.0, 0.0}})), std::invalid_argument);
  EXPECT_THROW(follower.start(pathOf({}, {{nan, 0.0}})), std::invalid_argument);
  follower.start(pathOf({}, {{1.0, 0.0}}));
  for (const double dt_s : {0.0, -0.1, 0.6, nan}) EXPECT_THROW(follower.update({}, dt_s), std::invalid_argument);
  for (const double factor : {-0.1, 1.1, nan}) EXPECT_THROW(follower.update({}, kDt_s, factor), std::invalid_argument);
  EXPECT_THROW(follower.update({nan, 0.0, 0.0}, kDt_s), std::invalid_argument);

  PathFollowerConfig config;
  config.gain_along_1_s = -1.0;
  config.wait_m = 0.5;
  MotionLimits limits = shippedLimits();
  limits.turn_rad_s = 0.0;
  EXPECT_THAT(messageOf<std::invalid_argument>([&] {
                PathFollower{config, limits};
              }),
              AllOf(HasSubstr("gain_along_1_s = -1 1/s, must be in [0.1, 20] 1/s"),
                    HasSubstr("wait_m = 0.5 m, must be in [0.01, 0.15] m"), HasSubstr("turn_rad_s = 0 rad/s")));
}

}  // namespace
}  // namespace base_navigation
