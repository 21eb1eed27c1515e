// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/obstacle_guard.h"

#include <algorithm>
#include <cmath>
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
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

ObstacleGuard guard(const ObstacleGuardConfig& config = {}) {
  return {config, shippedLimits(), shippedFootprint()};
}

/// One echo from this place, in base_link, where the scanner stands too.
Scan scanOf(const Eigen::Vector2d& p_base) {
  Scan scan;
  scan.range_min_m = 0.001;
  scan.range_max_m = 50.0;
  scan.min_angle_rad = std::atan2(p_base.y(), p_base.x());
  scan.ranges_m = {static_cast<float>(p_base.norm())};
  return scan;
}

/// One echo that is enough to stop.
ObstacleGuardConfig anyEcho(double margin_m = 0.04) {
  ObstacleGuardConfig config;
  config.min_echoes = 1;
  config.margin_m = margin_m;
  config.look_ahead_m = 4.0;
  config.look_ahead_rad = 3.0;
  return config;
}

/// Time at the wanted twist until the point is inside the polygon, found by steps of `step_s`.
double timeToMeet(const Polygon& polygon, const Twist2d& twist, const Eigen::Vector2d& p, double end_s, double step_s) {
  for (double t = 0.0; t <= end_s; t += step_s) {
    const Pose2d pose = moveAlongArc({}, twist.linear_m_s * t, twist.angular_rad_s * t);
    if (isInside(polygon, transform(inverse(pose), p))) return t;
  }
  return kInfinity;
}

std::vector<Twist2d> someTwists() {
  return {{0.5, 0.0},  {0.1, 0.0},  {-0.1, 0.0},  {0.0, 0.5},  {0.0, -0.3},  {0.4, 0.3},   {0.2, -0.57},
          {0.8, 0.05}, {-0.1, 0.2}, {0.02, -0.5}, {0.5, 1e-4}, {0.5, 1e-12}, {-0.05, -0.4}};
}

TEST(ObstacleGuard, MeetsAnEchoWhenThePaddedFootprintDoes) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> place(-1.2, 1.2);
  const ObstacleGuardConfig config = anyEcho();
  const ObstacleGuard asked = guard(config);
  const Polygon padded = padPolygon(shippedFootprint(), config.margin_m);
  int met = 0;
  int free = 0;
  for (const Twist2d& twist : someTwists()) {
    const double end_s =
        std::min(twist.linear_m_s != 0.0 ? config.look_ahead_m / std::abs(twist.linear_m_s) : kInfinity,
                 twist.angular_rad_s != 0.0 ? config.look_ahead_rad / std::abs(twist.angular_rad_s) : kInfinity);
    const double speed = std::abs(twist.linear_m_s) + std::abs(twist.angular_rad_s);
    const double step_s = 0.0005 / speed;
    for (int i = 0; i < 80; ++i) {
      Eigen::Vector2d p(place(random), place(random));
      if (isInside(padded, p)) continue;
      const Scan scan = scanOf(p);
      p = scan.echo(0);  // as its float tells
      const GuardVerdict verdict = asked.check(twist, scan);
      const double truth_s = timeToMeet(padded, twist, p, end_s, step_s);
      const double told_s = twist.linear_m_s != 0.0 ? verdict.free_m / std::abs(twist.linear_m_s)
                                                    : verdict.free_rad / std::abs(twist.angular_rad_s);
      const std::string where = std::to_string(twist.linear_m_s) + " " + std::to_string(twist.angular_rad_s) + " at " +
                                std::to_string(p.x()) + " " + std::to_string(p.y());
      if (std::isfinite(truth_s)) {
        // Steps find the contact at most a step late, and where a corner is brushed for less than a step not at all.
        ASSERT_TRUE(verdict.obstacle_base.has_value()) << where;
        ASSERT_LE(told_s, truth_s + 1e-6) << where;
        ++met;
        if (told_s >= truth_s - step_s - 1e-6) continue;
      } else if (!verdict.obstacle_base) {
        ++free;
        continue;
      }
      // Then it must be such a corner: with a footprint that is 1 mm larger the steps see the same time.
      const Polygon larger = padPolygon(shippedFootprint(), config.margin_m + 0.001);
      const double larger_s = timeToMeet(larger, twist, p, end_s, step_s);
      ASSERT_LE(larger_s, told_s + step_s) << where;
    }
  }
  EXPECT_GT(met, 100);
  EXPECT_GT(free, 100);
}

TEST(ObstacleGuard, LooksAlongTheWayAhead) {
  const std::vector<std::vector<BaseMotion>> ways = {
      {{0.3, 0.0}, {0.35 * 1.2, 1.2}, {0.8, 0.0}},
      {{0.35 * 0.8, -0.8}, {0.35 * 0.8, 0.8}, {0.5, 0.1}},
      {{-0.4, 0.0}, {-0.5, 0.7}},
      {{0.0, 1.3}},
      {{0.0, -2.4}},
  };
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> place(-1.3, 1.3);
  const ObstacleGuardConfig config = anyEcho();
  const ObstacleGuard asked = guard(config);
  const Polygon padded = padPolygon(shippedFootprint(), config.margin_m);
  int met = 0;
  for (const std::vector<BaseMotion>& way : ways) {
    const bool is_turn = way.front().isTurn();
    BasePath path;
    path.motions = way;
    const auto samples = path.sample(0.0005, 0.6);
    for (int i = 0; i < 150; ++i) {
      Eigen::Vector2d p(place(random), place(random));
      if (isInside(padded, p)) continue;
      const Scan scan = scanOf(p);
      p = scan.echo(0);
      double truth = kInfinity;
      for (const BasePath::Sample& sample : samples) {
        if (!isInside(padded, transform(inverse(sample.pose), p))) continue;
        truth = is_turn ? sample.along * std::abs(way.front().turn_rad) : sample.at_m;
        break;
      }
      const Twist2d wanted = is_turn ? Twist2d{0.0, std::copysign(0.5, way.front().turn_rad)}
                                     : Twist2d{std::copysign(0.3, way.front().length_m), 0.0};
      const GuardVerdict verdict = asked.check(wanted, way, scan);
      const double told = is_turn ? verdict.free_rad : verdict.free_m;
      if (std::isfinite(truth)) {
        ASSERT_TRUE(verdict.obstacle_base.has_value()) << p.transpose();
        EXPECT_LE(told, truth + 1e-6) << p.transpose();
        // A sample is 0.5 mm of the fastest corner; a corner that brushes the echo for less is not sampled.
        if (told > truth - 0.001) ++met;
        EXPECT_GT(told, truth - 0.05) << p.transpose();
      }
    }
    EXPECT_NEAR(asked.check({0.0, 0.0}, way, Scan{}).free_m, is_turn ? config.look_ahead_m : path.length(), 1e-9);
  }
  EXPECT_GT(met, 60);
}

/// Angle turned on the spot until `num_echoes` beams side by side are inside the footprint padded by the margin and
/// `more_m`, by steps of `step_rad`. Which beams are met is decided by their depth, the padding at which the rectangle's
/// boundary goes through them; those in the margin from the start are met when they come nearer than they are.
double turnedUntilMet(const Scan& scan, const Pose2d& T_scan_base, double turn_rad, double step_rad, double margin_m,
                      double more_m, std::size_t num_echoes) {
  const auto depth = [](const Eigen::Vector2d& p) {
    return std::max({p.x() - 0.296, -0.527 - p.x(), std::abs(p.y()) - 0.296});
  };
  std::vector<double> met(scan.ranges_m.size(), kInfinity);
  for (std::size_t beam = 0; beam < met.size(); ++beam) {
    if (!scan.isEcho(beam)) continue;
    const Eigen::Vector2d p_scan = scan.echo(beam);
    if (depth(p_scan) <= 0.0) continue;
    const Eigen::Vector2d p = transform(inverse(T_scan_base), p_scan);
    if (p.norm() > 0.8) continue;  // beyond every corner
    const double allowed_m = std::min(margin_m, depth(p) - 1e-6) + more_m;
    for (double turned_rad = 0.0; turned_rad <= std::abs(turn_rad) + 1e-12; turned_rad += step_rad) {
      if (depth(transform({0.0, 0.0, -std::copysign(turned_rad, turn_rad)}, p)) > allowed_m) continue;
      met[beam] = turned_rad;
      break;
    }
  }
  double soonest_rad = kInfinity;
  for (std::size_t begin = 0; begin + num_echoes <= met.size(); ++begin) {
    soonest_rad = std::min(soonest_rad, *std::max_element(met.begin() + begin, met.begin() + begin + num_echoes));
  }
  return soonest_rad;
}

TEST(ObstacleGuard, TurnsOnTheSpotAsFarAsRotatingInSmallSteps) {
  constexpr double kStep_rad = 5e-4;
  std::mt19937_64 random(6);
  std::uniform_real_distribution<double> share(-1.0, 1.0);
  int met = 0;
  int free = 0;
  int exact = 0;
  int in_margin = 0;
  for (int world_index = 0; world_index < 150; ++world_index) {
    ObstacleGuardConfig config = anyEcho();
    config.min_echoes = 1 + world_index % 4;
    // Rough ground for the scanner: small boxes round the footprint, some within the margin, walls, and noise.
    PolygonWorld world;
    while (world.size() < 8) {
      const Polygon one = box(0.9 * share(random), 0.8 * share(random), 0.15 + 0.1 * share(random),
                              0.3 + 0.25 * share(random), M_PI * share(random));
      if (gap(one, shippedFootprint()) > 0.001) world.push_back(one);
    }
    const Scan scan = PlantScanner{0.004}.scan(world, {}, &random);
    const Pose2d T_scan_base{0.01 * share(random), 0.01 * share(random), 0.05 * share(random)};
    const double turn_rad = 2.9 * share(random);
    const double asked_rad_s = std::copysign(0.5, turn_rad);
    const GuardVerdict verdict = guard(config).check({0.0, asked_rad_s}, {{0.0, turn_rad}}, scan, T_scan_base);
    const auto brute = [&](double more_m) {
      return turnedUntilMet(scan, T_scan_base, turn_rad, kStep_rad, config.margin_m, more_m,
                            static_cast<std::size_t>(config.min_echoes));
    };
    SCOPED_TRACE("world " + std::to_string(world_index));
    const double truth_rad = brute(0.0);
    const double told_rad = verdict.obstacle_base ? verdict.free_rad : kInfinity;
    // Steps find a contact at most one late; what is in the margin and comes nearer is met at once, which steps find when
    // it has come nearer by 1 um.
    EXPECT_LE(told_rad, truth_rad + 1e-6);
    EXPECT_EQ(verdict.speed_factor == 0.0, told_rad == 0.0);
    if (std::isfinite(truth_rad)) {
      ++met;
      in_margin += truth_rad < 2.0 * kStep_rad;
    }
    if (told_rad >= truth_rad - kStep_rad - 1e-6) {
      ++exact;
      free += !std::isfinite(truth_rad);
      continue;
    }
    // Else a corner brushed past between two steps: with 0.1 mm more, steps see it. A corner 0.7 m away that moves 0.35 mm
    // in a step rises over its chord by less than that.
    EXPECT_LE(brute(1e-4), told_rad + kStep_rad);
  }
  EXPECT_GT(met, 60);
  EXPECT_GT(free, 15);
  EXPECT_GT(in_margin, 5);
  EXPECT_GT(exact, 140);
}

TEST(ObstacleGuard, StopsWithinWhatIsFreeFromTheSpeedThatItAllows) {
  // v latency + v^2 / (2 share a) = free, along straight lines, arcs and turns.
  const ObstacleGuardConfig config = anyEcho();
  const ObstacleGuard asked = guard(config);
  double last_factor = 0.0;
  for (double free_m = 0.001; free_m < 3.0; free_m += 0.001) {
    const GuardVerdict verdict = asked.check({0.8, 0.0}, scanOf({0.296 + config.margin_m + free_m, 0.0}));
    ASSERT_NEAR(verdict.free_m, free_m, 1e-6);  // ranges are floats
    const double v = 0.8 * verdict.speed_factor;
    const double stopping_m = v * config.latency_s + v * v / (2.0 * config.braking_share * 0.2);
    if (verdict.speed_factor < 1.0) {
      ASSERT_NEAR(stopping_m, verdict.free_m, 1e-9);
    } else {
      ASSERT_LE(stopping_m, verdict.free_m + 1e-9);
    }
    ASSERT_GE(verdict.speed_factor, last_factor - 1e-6);                       // monotone
    ASSERT_LE(verdict.speed_factor - last_factor, 0.001 / 0.25 / 0.8 + 1e-5);  // its slope is at most 1 / latency
    last_factor = verdict.speed_factor;
  }
  EXPECT_EQ(last_factor, 1.0);

  const GuardVerdict turning = asked.check({0.0, 0.6}, scanOf({0.0, 0.38}));
  ASSERT_LT(turning.speed_factor, 1.0);
  const double w = 0.6 * turning.speed_factor;
  EXPECT_NEAR(w * config.latency_s + w * w / (2.0 * config.braking_share * 0.6), turning.free_rad, 1e-9);

  // On an arc of 0.1 m the turning brakes less than the wheels could: 0.42 rad/s2 * 0.1 m < 0.14 m/s2.
  const GuardVerdict tight = asked.check({0.05, 0.5}, scanOf({0.1, 0.37}));
  ASSERT_LT(tight.speed_factor, 1.0);
  const double u = 0.5 * tight.speed_factor;
  EXPECT_NEAR(u * config.latency_s + u * u / (2.0 * config.braking_share * 0.6), tight.free_rad, 1e-9);
}

TEST(ObstacleGuard, LooksNoFartherThanToldTo) {
  ObstacleGuardConfig config = anyEcho();
  config.look_ahead_m = 3.0;
  config.look_ahead_rad = 1.0;
  const ObstacleGuard asked = guard(config);
  const std::vector<BaseMotion> way = {{2.0, 0.0}, {2.0, 0.0}, {2.0, 0.0}};
  const double front_m = 0.296 + config.margin_m;
  const GuardVerdict beyond = asked.check({0.5, 0.0}, way, scanOf({front_m + 3.01, 0.0}));
  EXPECT_FALSE(beyond.obstacle_base.has_value());
  EXPECT_NEAR(beyond.free_m, 3.0, 1e-12);
  const GuardVerdict within = asked.check({0.5, 0.0}, way, scanOf({front_m + 2.99, 0.0}));
  EXPECT_TRUE(within.obstacle_base.has_value());
  EXPECT_NEAR(within.free_m, 2.99, 1e-6);  // ranges are floats
  EXPECT_NEAR(asked.check({0.0, 0.5}, {{0.0, 2.5}}, Scan{}).free_rad, 1.0, 1e-12);
}

TEST(ObstacleGuard, LetsWhatIsInTheMarginBeLeftOnly) {
  const ObstacleGuard asked = guard(anyEcho());
  const Scan front = scanOf({0.316, 0.0});  // 2 cm before the bumper
  EXPECT_EQ(asked.check({0.1, 0.0}, front).speed_factor, 0.0);
  EXPECT_EQ(asked.check({0.1, 0.3}, front).speed_factor, 0.0);
  EXPECT_EQ(asked.check({-0.1, 0.0}, front).speed_factor, 1.0);
  const Scan left = scanOf({0.25, 0.316});  // 2 cm beside, before the axle: turning left brings it nearer
  EXPECT_EQ(asked.check({0.0, 0.2}, left).speed_factor, 0.0);
  EXPECT_EQ(asked.check({0.0, -0.2}, left).speed_factor, 1.0);
  EXPECT_EQ(asked.check({0.1, 0.0}, left).speed_factor, 1.0);  // along it
  EXPECT_EQ(asked.check({0.1, 0.01}, left).speed_factor, 0.0);
  EXPECT_EQ(asked.check({0.1, -0.01}, left).speed_factor, 1.0);
  const Scan behind_left = scanOf({-0.25, 0.316});  // behind the axle the other way round
  EXPECT_EQ(asked.check({0.0, -0.2}, behind_left).speed_factor, 0.0);
  EXPECT_EQ(asked.check({0.0, 0.2}, behind_left).speed_factor, 1.0);
  // First away, and then, on the other side of the turn, into the footprint: not for ever.
  const GuardVerdict round = asked.check({0.0, 0.5}, behind_left);
  EXPECT_GT(round.speed_factor, 0.0);
  EXPECT_EQ(asked.check({0.0, 0.0}, front).speed_factor, 1.0);
}

TEST(ObstacleGuard, NeverLetsADistanceInTheMarginShrink) {
  // Oracle: the distance a moment later.
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> share(-1.0, 1.0);
  const ObstacleGuardConfig config = anyEcho();
  const ObstacleGuard asked = guard(config);
  const Polygon padded = padPolygon(shippedFootprint(), config.margin_m);
  const auto depth = [](const Eigen::Vector2d& p) {
    return std::max({p.x() - 0.296, -0.527 - p.x(), std::abs(p.y()) - 0.296});
  };
  int nearer = 0;
  int away = 0;
  while (nearer + away < 2000) {
    const Eigen::Vector2d p(-0.1155 + 0.5 * share(random), 0.4 * share(random));
    const Scan scan = scanOf(p);
    const Eigen::Vector2d echo = scan.echo(0);
    if (!isInside(padded, echo) || depth(echo) <= 0.001) continue;
    const Twist2d twist{0.3 * share(random), 0.5 * share(random)};
    constexpr double kMoment_s = 1e-5;
    const Pose2d pose = moveAlongArc({}, twist.linear_m_s * kMoment_s, twist.angular_rad_s * kMoment_s);
    const double change_m_s = (depth(transform(inverse(pose), echo)) - depth(echo)) / kMoment_s;
    if (std::abs(change_m_s) < 1e-4) continue;  // the moment is too long to tell
    const GuardVerdict verdict = asked.check(twist, scan);
    EXPECT_EQ(verdict.speed_factor == 0.0, change_m_s < 0.0) << echo.transpose() << ", " << change_m_s;
    ++(change_m_s < 0.0 ? nearer : away);
  }
  EXPECT_GT(nearer, 300);
  EXPECT_GT(away, 300);
}

TEST(ObstacleGuard, LeavesOutTheRobotItself) {
  const ObstacleGuard asked = guard(anyEcho());
  EXPECT_EQ(asked.check({0.5, 0.0}, scanOf({0.29, 0.0})).speed_factor, 1.0);
  EXPECT_EQ(asked.check({0.0, 0.5}, scanOf({0.1, 0.2})).speed_factor, 1.0);
  // Driven over since the scan is no part of the robot.
  EXPECT_EQ(asked.check({0.5, 0.0}, scanOf({0.35, 0.0}), {0.1, 0.0, 0.0}).speed_factor, 0.0);
  EXPECT_EQ(asked.check({-0.1, 0.0}, scanOf({0.35, 0.0}), {0.1, 0.0, 0.0}).speed_factor, 1.0);
}

TEST(ObstacleGuard, KnowsHowFarTheBaseHasComeSinceTheScan) {
  const ObstacleGuard asked = guard(anyEcho());
  const Eigen::Vector2d p(1.4, 0.1);
  const Pose2d T_scan_base{0.3, -0.1, 0.2};
  const Eigen::Vector2d p_now = transform(inverse(T_scan_base), p);
  const GuardVerdict moved_verdict = asked.check({0.5, 0.1}, scanOf(p), T_scan_base);
  const GuardVerdict still_verdict = asked.check({0.5, 0.1}, scanOf(p_now));
  ASSERT_TRUE(moved_verdict.obstacle_base.has_value());
  EXPECT_NEAR(moved_verdict.free_m, still_verdict.free_m, 1e-6);
  EXPECT_NEAR((*moved_verdict.obstacle_base - p_now).norm(), 0.0, 1e-6);
}

TEST(ObstacleGuard, TakesNoSpeckForAnObstacle) {
  ObstacleGuardConfig config;
  ASSERT_EQ(config.min_echoes, 2);
  const ObstacleGuard asked = guard(config);
  std::mt19937_64 random(4);
  const PolygonWorld wall = {box(2.5, 0.0, 0.2, 4.0)};
  Scan scan = PlantScanner{}.scan(wall, {}, &random);
  const double wall_m = asked.check({0.5, 0.0}, scan).free_m;
  EXPECT_NEAR(wall_m, 2.4 - 0.296 - 0.04, 1e-3);
  const std::size_t middle = scan.ranges_m.size() / 2;
  scan.ranges_m[middle] = 0.5F;  // dust
  EXPECT_NEAR(asked.check({0.5, 0.0}, scan).free_m, wall_m, 1e-3);
  scan.ranges_m[middle + 1] = 0.52F;  // a stick
  EXPECT_NEAR(asked.check({0.5, 0.0}, scan).free_m, 0.244 + 0.52 - 0.336, 1e-3);
  // Two specks that are no neighbours.
  scan.ranges_m[middle + 1] = scan.ranges_m[middle - 1];
  scan.ranges_m[middle + 2] = 0.5F;
  EXPECT_NEAR(asked.check({0.5, 0.0}, scan).free_m, wall_m, 1e-3);
  // A masked beam (0) and one that came to nothing do not count as free either way.
  scan.ranges_m.assign(scan.ranges_m.size(), 0.0F);
  scan.ranges_m[3] = std::numeric_limits<float>::quiet_NaN();
  scan.ranges_m[4] = std::numeric_limits<float>::infinity();
  EXPECT_EQ(asked.check({0.5, 0.0}, scan).speed_factor, 1.0);
}

TEST(ObstacleGuard, PassesWallsBeside) {
  // A lane with 6 cm on either side is driven at full speed, also as the scanner's noise of 10 mm shows it.
  const PolygonWorld lane = {box(2.0, 0.356 + 0.1, 12.0, 0.2), box(2.0, -0.356 - 0.1, 12.0, 0.2)};
  std::mt19937_64 random(5);
  EXPECT_EQ(guard().check({0.8, 0.0}, PlantScanner{}.scan(lane, {}, &random)).speed_factor, 1.0);
  const PlantScanner noisy{0.01};
  double sum = 0.0;
  int stops = 0;
  constexpr int kScans = 400;
  for (int i = 0; i < kScans; ++i) {
    const GuardVerdict verdict = guard().check({0.8, 0.0}, noisy.scan(lane, {}, &random));
    sum += verdict.speed_factor;
    stops += verdict.speed_factor == 0.0 ? 1 : 0;
  }
  RecordProperty("share_of_speed", std::to_string(sum / kScans));
  EXPECT_GT(sum / kScans, 0.9);
  EXPECT_EQ(stops, 0);
  // And a gap that is too narrow is not entered.
  const PolygonWorld gap = {box(2.0, 0.326 + 0.1, 2.0, 0.2), box(2.0, -0.326 - 0.1, 2.0, 0.2)};
  EXPECT_NEAR(guard().check({0.8, 0.0}, PlantScanner{}.scan(gap, {}, &random)).free_m, 1.0 - 0.336,
              0.02);  // two beams, 0.5 degrees apart
}

/// Drives as told but for the guard, and tells the smallest gap between what is in front and the world.
struct Drive {
  double smallest_gap_m{kInfinity};
  double driven_m{0.0};
};

Drive driveAtRandom(const PolygonWorld& world, std::uint64_t seed, double min_radius_m) {
  // The stated latency: a scan is up to 80 ms old when the next comes, a command is 40 ms on its way and the drives
  // answer with 50 ms; the control runs at 50 Hz.
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> share(-1.0, 1.0);
  const ObstacleGuard asked = guard();
  const MotionLimits limits = shippedLimits();
  PlantConfig plant_config;
  Plant plant(plant_config, {});
  const Polygon front = frontOf(shippedFootprint(), 0.244);
  Drive drive;
  Twist2d wanted;
  Twist2d command;
  Scan scan;
  for (int tick = 0; tick < 50 * 12; ++tick) {
    if (tick % 4 == 0) scan = PlantScanner{0.005}.scan(world, plant.poseMap(), &random);
    if (tick % 100 == 0) {
      wanted.linear_m_s = 0.5 * limits.forward_m_s * (1.2 + 0.8 * share(random));
      wanted.angular_rad_s = std::min(limits.turn_rad_s, wanted.linear_m_s / min_radius_m) * share(random);
    }
    // As soon as an arc is safe it may be taken: limits of acceleration bend it, so it is asked about what comes of it.
    const auto towards = [&](double factor) {
      const auto step = [](double from, double to, double most) { return from + std::clamp(to - from, -most, most); };
      return Twist2d{step(command.linear_m_s, factor * wanted.linear_m_s, limits.linear_m_s2 * 0.02),
                     step(command.angular_rad_s, factor * wanted.angular_rad_s, limits.turn_rad_s2 * 0.02)};
    };
    Twist2d next = towards(guard().check(wanted, scan).speed_factor);
    if (asked.check(next, scan).speed_factor < 1.0) {
      // Brakes along the arc of the command before.
      const double time_s = std::max(std::abs(command.linear_m_s) / limits.linear_m_s2,
                                     std::abs(command.angular_rad_s) / limits.turn_rad_s2);
      const double left = time_s > 0.02 ? 1.0 - 0.02 / time_s : 0.0;
      next = {left * command.linear_m_s, left * command.angular_rad_s};
    }
    command = next;
    const Pose2d before = plant.poseMap();
    plant.step(command, 0.02);
    drive.driven_m += (plant.poseMap().position() - before.position()).norm();
    drive.smallest_gap_m = std::min(drive.smallest_gap_m, gap(world, moved(front, plant.poseMap())));
  }
  return drive;
}

TEST(ObstacleGuard, NeverTouchesWhatIsInFront) {
  double driven_m = 0.0;
  int came_near = 0;
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    std::mt19937_64 random(1000 + seed);
    std::uniform_real_distribution<double> place(-5.0, 5.0);
    std::uniform_real_distribution<double> size(0.1, 0.8);
    PolygonWorld world;
    while (world.size() < 18) {
      const Polygon obstacle = box(place(random), place(random), size(random), size(random), place(random));
      if (gap(obstacle, padPolygon(shippedFootprint(), 0.3)) > 0.0) world.push_back(obstacle);
    }
    // Arcs of at least 0.5 m: then all that the front can reach has been seen before, see README of the guard's limits.
    const Drive drive = driveAtRandom(world, seed, 0.5);
    EXPECT_GT(drive.smallest_gap_m, 0.0) << "world " << seed;
    driven_m += drive.driven_m;
    came_near += drive.smallest_gap_m < 0.15;
  }
  EXPECT_GT(driven_m, 40.0);
  EXPECT_GT(came_near, 15);
  RecordProperty("came_near", came_near);
  RecordProperty("driven_m", std::to_string(driven_m));
}

TEST(ObstacleGuard, RefusesWhatItCannotJudge) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const ObstacleGuard asked = guard();
  EXPECT_THROW(asked.check({nan, 0.0}, Scan{}), std::invalid_argument);
  EXPECT_THROW(asked.check({0.1, 0.0}, Scan{}, {nan, 0.0, 0.0}), std::invalid_argument);
  EXPECT_THROW(asked.check({0.1, 0.0}, {{0.1, 0.0}, {-0.1, 0.0}}, Scan{}), std::invalid_argument);
  EXPECT_THROW(asked.check({0.1, 0.0}, {{0.1, 0.0}, {0.0, 0.5}}, Scan{}), std::invalid_argument);
  EXPECT_THROW(asked.check({0.1, 0.0}, {{nan, 0.0}}, Scan{}), std::invalid_argument);

  ObstacleGuardConfig config;
  config.margin_m = -1.0;
  config.min_echoes = 0;
  EXPECT_THAT(
      messageOf<std::invalid_argument>([&] { guard(config); }),
      AllOf(HasSubstr("margin_m = -1 m, must be in [0.001, 1] m"), HasSubstr("min_echoes = 0, must be in [1, 20]")));
  config = {};
  config.look_ahead_m = 2.0;  // from 0.8 m/s it takes 2.49 m
  config.look_ahead_rad = 0.5;
  EXPECT_TRUE(interactive_mapping::problemsOf(config).empty());
  EXPECT_THAT(config.problemsFor(shippedLimits()), ElementsAre(HasSubstr("look_ahead_m = 2 m, must be in [2.48571, "),
                                                               HasSubstr("look_ahead_rad = 0.5 rad, must be in [")));
  EXPECT_THROW(guard(config), std::invalid_argument);
  config.look_ahead_m = 2.49;
  EXPECT_THROW(guard(config), std::invalid_argument);
  config.look_ahead_rad = 0.6;  // it takes 0.58 rad
  EXPECT_NO_THROW(guard(config));
  // Impossible values are reported by themselves, and have no stopping distance.
  config.look_ahead_m = 2.0;
  config.braking_share = 0.0;
  EXPECT_TRUE(config.problemsFor(shippedLimits()).empty());
}

}  // namespace
}  // namespace base_navigation
