// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/base_navigator.h"

#include <cmath>
#include <deque>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>

#include <gmock/gmock.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

#include "base_navigation/grid_fusion.h"
#include "support/plant.h"

namespace base_navigation {
namespace {

using test_support::messageOf;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;

constexpr double kDt_s = 0.02;

/// A room of 10 m x 8 m about the origin, seen throughout, in which polygons stand.
std::shared_ptr<const NavigationGrid> gridOf(const PolygonWorld& world) {
  auto grid = std::make_shared<NavigationGrid>();
  grid->origin_m = {-5.0, -4.0};
  grid->width = 200;
  grid->height = 160;
  grid->state.assign(static_cast<std::size_t>(grid->width) * grid->height, SpaceState::kFree);
  const double size_m = grid->cell_size_m;
  for (const Polygon& polygon : world) {
    Eigen::Vector2d low = polygon[0];
    Eigen::Vector2d high = polygon[0];
    for (const Eigen::Vector2d& corner : polygon) {
      low = low.cwiseMin(corner);
      high = high.cwiseMax(corner);
    }
    const Eigen::Vector2i first = grid->cellOf(low).cwiseMax(1) - Eigen::Vector2i::Ones();
    const Eigen::Vector2i last = grid->cellOf(high) + Eigen::Vector2i::Ones();
    for (int row = first.y(); row <= std::min(last.y(), grid->height - 1); ++row) {
      for (int column = first.x(); column <= std::min(last.x(), grid->width - 1); ++column) {
        const Eigen::Vector2d center = grid->centerOf(column, row);
        const Polygon cell = box(center.x(), center.y(), size_m, size_m);
        if (gap(cell, polygon) <= 0.0) grid->state[grid->index(column, row)] = SpaceState::kOccupied;
      }
    }
  }
  return grid;
}

PolygonWorld room() {
  return {box(5.1, 0.0, 0.2, 8.4), box(-5.1, 0.0, 0.2, 8.4), box(0.0, 4.1, 10.4, 0.2), box(0.0, -4.1, 10.4, 0.2)};
}

/// The base in its world: everything that the navigator gets, and what can go wrong with it.
class Bench {
 public:
  explicit Bench(const Pose2d& start = {}, const BaseNavigatorConfig& config = {}, const PlantConfig& plant = {},
                 std::uint64_t seed = 1)
      : navigator_(config, BasePlannerConfig{}, PathFollowerConfig{}, ObstacleGuardConfig{}, shippedLimits(),
                   shippedFootprint()),
        plant_(plant, start),
        random_(seed) {
    seeInGrid();
  }

  /// The grid knows what stands there now.
  void seeInGrid() {
    grid_ = gridOf(world_);
    input_.grid = grid_;
  }

  const NavigationOutput& step() {
    now_s_ += kDt_s;
    input_.now_s = now_s_;
    if (has_odometry_) {
      input_.T_odom_base = compose(odometry_jump_, plant_.poseOdom());
      input_.odometry_twist = plant_.wheels();
      input_.odometry_stamp_s = now_s_ + odometry_ahead_s_;
    }
    if (pose_every_ > 1 || pose_late_ > 0) {
      localise();
    } else if (has_pose_) {
      input_.T_map_base = compose(pose_jump_, plant_.localized(&random_));
      input_.pose_stamp_s = now_s_;
    }
    if (has_scan_ && tick_ % 4 == 0) {
      input_.scan = std::make_shared<Scan>(PlantScanner{scan_noise_m_, 191}.scan(world_, plant_.poseMap(), &random_));
      input_.scan_stamp_s = now_s_;
    }
    if (fusion_) fuse();
    if (has_grid_ && tick_ % 25 == 0) input_.grid_stamp_s = now_s_;
    if (has_heartbeat_) input_.heartbeat_stamp_s = now_s_;
    ++tick_;
    const Twist2d before = output_.command;
    output_ = navigator_.step(input_);
    num_jumps_ += output_.has_jumped ? 1 : 0;
    if (fusion_ && output_.has_jumped) fusion_->forget();
    // Whatever happens, the command keeps to the limits, and brakes no harder than the test allows.
    const MotionLimits limits = shippedLimits();
    const bool slows = std::abs(output_.command.linear_m_s) <= std::abs(before.linear_m_s) &&
                       std::abs(output_.command.angular_rad_s) <= std::abs(before.angular_rad_s);
    const double share = slows ? braking_m_s2_ / limits.linear_m_s2 : 1.0;
    EXPECT_LE(std::abs(output_.command.linear_m_s - before.linear_m_s), share * limits.linear_m_s2 * kDt_s + 1e-9);
    EXPECT_LE(std::abs(output_.command.angular_rad_s - before.angular_rad_s),
              share * limits.turn_rad_s2 * kDt_s + 1e-9);
    phases_.insert(output_.phase);
    if (output_.ended) {
      EXPECT_FALSE(status_.has_value()) << "ended twice";
      status_ = output_.ended;
      message_ = output_.message;
      EXPECT_EQ(output_.command.linear_m_s, 0.0);
      EXPECT_EQ(output_.command.angular_rad_s, 0.0);
    }
    plant_.step(output_.command, kDt_s);
    const Polygon body = moved(shippedFootprint(), plant_.poseMap());
    if (plant_.wheels().linear_m_s > 1e-3 || judge_always_) {
      smallest_gap_m_ = std::min(smallest_gap_m_, gap(world_, body));
    }
    return output_;
  }

  /// Steps until the goal has ended, or the condition holds; false: neither by then.
  bool run(double longest_s, const std::function<bool()>& until = {}) {
    for (double t = 0.0; t < longest_s; t += kDt_s) {
      step();
      if (until ? until() : status_.has_value()) return true;
    }
    return false;
  }
  bool runUntilFast(double linear_m_s = 0.3) {
    return run(30.0, [this, linear_m_s] { return plant_.wheels().linear_m_s > linear_m_s; });
  }

  /// As a localisation and the node do it: map to odom comes every so many steps and late, and goes with each odometry.
  void localise() {
    if (has_pose_ && tick_ % pose_every_ == 0) {
      const Pose2d T_map_base = compose(pose_jump_, plant_.localized(&random_));
      localisations_.push_back({now_s_, compose(T_map_base, inverse(input_.T_odom_base))});
    }
    const double known_s = now_s_ - pose_late_ * kDt_s + 1e-9;
    while (localisations_.size() > 1 && localisations_[1].first <= known_s) localisations_.pop_front();
    if (localisations_.empty() || localisations_.front().first > known_s) return;
    input_.T_map_base = compose(localisations_.front().second, input_.T_odom_base);
    input_.pose_stamp_s = localisations_.front().first;
  }

  /// The grid from scans and track, as in the node.
  void fuse() {
    if (input_.scan_stamp_s == now_s_) fusion_->addScan(*input_.scan, input_.T_map_base, now_s_);
    fusion_->addFootprint(input_.T_map_base);
    input_.grid = fusion_->build(input_.T_map_base, now_s_);
  }

  BaseNavigator navigator_;
  Plant plant_;
  std::mt19937_64 random_;
  PolygonWorld world_{room()};
  std::shared_ptr<const NavigationGrid> grid_;
  NavigationInput input_;
  NavigationOutput output_;
  std::optional<NavigationStatus> status_;
  std::string message_;
  std::set<NavigationPhase> phases_;
  bool has_odometry_{true};
  bool has_pose_{true};
  bool has_scan_{true};
  bool has_grid_{true};
  bool has_heartbeat_{true};
  bool judge_always_{false};
  double braking_m_s2_{shippedLimits().linear_m_s2};
  double odometry_ahead_s_{0.0};
  double scan_noise_m_{0.0};
  Pose2d pose_jump_;
  Pose2d odometry_jump_;
  int pose_every_{1};                                    // so many steps a localisation, ...
  int pose_late_{0};                                     // ... known so many steps later
  std::deque<std::pair<double, Pose2d>> localisations_;  // stamp and T_map_odom: the one that is known, and the next
  std::unique_ptr<GridFusion> fusion_;                   // none: the grid knows the world
  int num_jumps_{0};
  double now_s_{100.0};
  double smallest_gap_m_{std::numeric_limits<double>::infinity()};
  int tick_{0};
};

void expectAt(const Bench& bench, const Pose2d& goal, double off_m = 0.02, double off_rad = 0.03) {
  EXPECT_LE((bench.plant_.poseMap().position() - goal.position()).norm(), off_m);
  EXPECT_LE(std::abs(wrapAngle(bench.plant_.poseMap().yaw_rad - goal.yaw_rad)), off_rad);
}

TEST(BaseNavigator, DrivesToGoalsAndStands) {
  for (const Pose2d& goal : {Pose2d{2.0, 1.0, 0.5}, Pose2d{-2.0, -1.5, 3.0}, Pose2d{0.5, -2.0, -1.57}}) {
    Bench bench;
    bench.world_.push_back(box(1.0, 0.0, 0.3, 1.0));
    bench.seeInGrid();
    bench.navigator_.setGoal(goal);
    EXPECT_TRUE(bench.navigator_.isActive());
    ASSERT_TRUE(bench.run(120.0)) << bench.output_.reason;
    EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
    expectAt(bench, goal);
    EXPECT_GT(bench.smallest_gap_m_, 0.0);
    EXPECT_LT(std::abs(bench.plant_.wheels().linear_m_s), 0.01);  // as odometry's noise allows to tell
    EXPECT_FALSE(bench.navigator_.isActive());
    bench.step();
    EXPECT_EQ(bench.output_.phase, NavigationPhase::kIdle);
  }
}

TEST(BaseNavigator, IsChargedForThePlan) {
  BaseNavigatorConfig config;
  config.plan_cost_s = 1.0;
  Bench bench({}, config);
  bench.navigator_.setGoal({2.0, 0.0, 0.0});
  ASSERT_TRUE(bench.run(10.0, [&] { return bench.output_.command.linear_m_s > 0.0; }));
  EXPECT_NEAR(bench.now_s_ - 100.0, 1.0, 0.1);
  EXPECT_EQ(bench.navigator_.numPlans(), 1u);
}

TEST(BaseNavigator, SaysWhyAGoalCannotBeReached) {
  struct Case {
    PolygonWorld more;
    Pose2d goal;
    std::vector<NavigationStatus> expected;
  };
  // A chamber of four walls about (3, 2).
  const PolygonWorld chamber = {box(3.0, 3.2, 2.6, 0.2), box(3.0, 0.8, 2.6, 0.2), box(4.2, 2.0, 0.2, 2.6),
                                box(1.8, 2.0, 0.2, 2.6)};
  const std::vector<Case> cases = {
      {{box(2.0, 0.0, 0.3, 0.3)}, {2.0, 0.0, 0.0}, {NavigationStatus::kGoalOccupied}},
      {{}, {8.0, 0.0, 0.0}, {NavigationStatus::kGoalUnknown}},
      {{box(-0.4, 0.3, 0.1, 0.1)}, {2.0, 0.0, 0.0}, {NavigationStatus::kStartBlocked}},
      {chamber, {3.2, 2.0, 0.0}, {NavigationStatus::kNoPath}},
      {{box(2.0 - 0.527 - 0.1, 0.0, 0.1, 0.7)}, {2.0, 0.0, 0.0}, {NavigationStatus::kNoApproach}},
  };
  for (const Case& one : cases) {
    Bench bench;
    for (const Polygon& polygon : one.more) bench.world_.push_back(polygon);
    bench.seeInGrid();
    bench.navigator_.setGoal(one.goal);
    ASSERT_TRUE(bench.run(5.0)) << toString(one.expected[0]);
    EXPECT_EQ(*bench.status_, one.expected[0]) << toString(*bench.status_) << ": " << bench.message_;
    EXPECT_FALSE(bench.message_.empty());
    EXPECT_NEAR((bench.plant_.poseMap().position()).norm(), 0.0, 1e-9);
  }
}

struct Stale {
  const char* name;
  bool Bench::*has;
  NavigationStatus status;
  double noticed_s;  // after it vanished, at most
};
const Stale kStale[] = {
    {"odometry", &Bench::has_odometry_, NavigationStatus::kStaleOdometry, 0.3},
    {"pose", &Bench::has_pose_, NavigationStatus::kStalePose, 0.6},
    {"scan", &Bench::has_scan_, NavigationStatus::kStaleScan, 0.5},
    {"map", &Bench::has_grid_, NavigationStatus::kStaleGrid, 10.1},
    {"heartbeat", &Bench::has_heartbeat_, NavigationStatus::kStaleHeartbeat, 0.6},
};

BaseNavigatorConfig withHeartbeat() {
  BaseNavigatorConfig config;
  config.max_heartbeat_age_s = 0.5;
  return config;
}

TEST(BaseNavigator, WaitsForWhatIsMissingFromTheStartAndGivesUp) {
  for (const Stale& one : kStale) {
    Bench bench({}, withHeartbeat());
    bench.*one.has = false;
    if (one.has == &Bench::has_grid_) bench.input_.grid.reset();
    bench.navigator_.setGoal({2.0, 0.0, 0.0});
    ASSERT_TRUE(bench.run(10.0)) << one.name;
    EXPECT_EQ(*bench.status_, one.status) << bench.message_;
    EXPECT_NEAR(bench.now_s_ - 100.0, BaseNavigatorConfig{}.stale_patience_s, 0.2);
    EXPECT_THAT(bench.message_, HasSubstr(std::string("no ") + one.name));
    EXPECT_THAT(bench.message_, HasSubstr(" has come yet"));
    EXPECT_NEAR(bench.plant_.poseMap().x_m, 0.0, 1e-9);
  }
}

TEST(BaseNavigator, BrakesWhenDataVanishesAndGivesUp) {
  for (const Stale& one : kStale) {
    Bench bench({-3.0, 0.0, 0.0}, withHeartbeat());
    bench.navigator_.setGoal({4.0, 0.0, 0.0});
    ASSERT_TRUE(bench.runUntilFast());
    bench.*one.has = false;
    if (one.has == &Bench::has_heartbeat_) bench.braking_m_s2_ = shippedLimits().stop_m_s2;
    const double vanished_s = bench.now_s_;
    ASSERT_TRUE(bench.run(12.0, [&] { return bench.output_.phase == NavigationPhase::kWaitingForData; })) << one.name;
    EXPECT_LE(bench.now_s_ - vanished_s, one.noticed_s + (one.has == &Bench::has_grid_ ? 0.5 : 0.0));
    EXPECT_THAT(bench.output_.reason, HasSubstr(one.name));
    // At once, and all the way.
    double before_m_s = bench.output_.command.linear_m_s;
    while (before_m_s > 0.0) {
      bench.step();
      EXPECT_LT(bench.output_.command.linear_m_s, before_m_s);
      before_m_s = bench.output_.command.linear_m_s;
    }
    ASSERT_TRUE(bench.run(12.0)) << one.name;
    EXPECT_EQ(*bench.status_, one.status) << bench.message_;
    EXPECT_THAT(bench.message_, HasSubstr("after waiting"));
    EXPECT_LT(std::abs(bench.plant_.wheels().linear_m_s), 0.01);  // as odometry's noise allows to tell
  }
}

TEST(BaseNavigator, DrivesWithoutAHeartbeatUnlessOneIsAskedFor) {
  Bench bench;
  bench.has_heartbeat_ = false;
  bench.navigator_.setGoal({1.0, 0.0, 0.0});
  ASSERT_TRUE(bench.run(60.0));
  EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
}

TEST(BaseNavigator, SendsZerosForAWhileAfterOdometryIsGoneAndThenIsIdle) {
  constexpr double kStandPatience_s = 5.0;  // as the navigator has it
  for (const bool comes_back : {false, true}) {
    Bench bench({-3.0, 0.0, 0.0});
    bench.navigator_.setGoal({4.0, 0.0, 0.0});
    ASSERT_TRUE(bench.runUntilFast());
    bench.has_odometry_ = false;
    ASSERT_TRUE(bench.run(12.0));
    ASSERT_EQ(*bench.status_, NavigationStatus::kStaleOdometry);
    EXPECT_EQ(bench.output_.phase, NavigationPhase::kBraking) << "nobody knows whether it stands";
    EXPECT_FALSE(bench.navigator_.isActive());
    const double ended_s = bench.now_s_;
    const auto isIdle = [&] {
      EXPECT_EQ(bench.output_.command.linear_m_s, 0.0);
      EXPECT_EQ(bench.output_.command.angular_rad_s, 0.0);
      return bench.output_.phase == NavigationPhase::kIdle;
    };
    ASSERT_FALSE(bench.run(2.0, isIdle));
    EXPECT_EQ(bench.output_.phase, NavigationPhase::kBraking);
    EXPECT_THAT(bench.output_.reason, HasSubstr("without odometry"));
    bench.has_odometry_ = comes_back;
    ASSERT_TRUE(bench.run(10.0, isIdle));
    // Odometry that tells of a base that stands ends it at once.
    EXPECT_NEAR(bench.now_s_ - ended_s, comes_back ? 2.0 + kDt_s : kStandPatience_s, 2.0 * kDt_s);
    EXPECT_EQ(bench.output_.reason, "");
    EXPECT_FALSE(bench.run(20.0, [&] { return bench.output_.phase != NavigationPhase::kIdle; })) << "and stays idle";
  }
}

TEST(BaseNavigator, GoesOnWhenDataIsBackInTime) {
  for (const Stale& one : kStale) {
    Bench bench({-3.0, 0.0, 0.0}, withHeartbeat());
    bench.navigator_.setGoal({4.0, 0.0, 0.0});
    ASSERT_TRUE(bench.runUntilFast());
    bench.*one.has = false;
    if (one.has == &Bench::has_heartbeat_) bench.braking_m_s2_ = shippedLimits().stop_m_s2;
    ASSERT_TRUE(bench.run(12.0, [&] { return bench.output_.phase == NavigationPhase::kWaitingForData; })) << one.name;
    bench.run(1.5, [] { return false; });
    bench.*one.has = true;
    ASSERT_TRUE(bench.run(60.0)) << one.name;
    EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << one.name << ": " << bench.message_;
    expectAt(bench, {4.0, 0.0, 0.0});
    EXPECT_EQ(bench.navigator_.numPlans(), 2u) << one.name;  // the plan, and its end: the way was still good
  }
}

TEST(BaseNavigator, SaysWhatIsWrongWithInputThatComes) {
  const std::pair<std::string NavigationInput::*, bool Bench::*> inputs[] = {
      {&NavigationInput::odometry_problem, &Bench::has_odometry_},
      {&NavigationInput::scan_problem, &Bench::has_scan_},
      {&NavigationInput::grid_problem, &Bench::has_grid_}};
  for (const auto& [problem, has] : inputs) {
    Bench bench;
    bench.*has = false;
    if (has == &Bench::has_grid_) bench.input_.grid.reset();
    bench.input_.*problem = "its frame is 'x', must be 'y'";
    bench.navigator_.setGoal({2.0, 0.0, 0.0});
    ASSERT_TRUE(bench.run(10.0));
    EXPECT_EQ(*bench.status_, NavigationStatus::kBadInput) << toString(*bench.status_);
    EXPECT_THAT(bench.message_, HasSubstr("its frame is 'x', must be 'y'"));
  }
  // A single bad message among good ones is no reason.
  Bench bench;
  bench.input_.scan_problem = "only 3 of 191 beams report a range";
  bench.navigator_.setGoal({1.0, 0.0, 0.0});
  ASSERT_TRUE(bench.run(60.0));
  EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
}

TEST(BaseNavigator, DrivesOnAGridThatComesOnce) {
  for (const double max_age_s : {10.0, 0.0}) {
    BaseNavigatorConfig config;
    config.max_grid_age_s = max_age_s;
    Bench bench({-1.0, 0.0, 0.0}, config);
    bench.has_grid_ = false;
    bench.input_.grid_stamp_s = 0.0;  // when a map server began
    bench.navigator_.setGoal({1.0, 0.0, 0.0});
    ASSERT_TRUE(bench.run(60.0));
    EXPECT_EQ(*bench.status_, max_age_s == 0.0 ? NavigationStatus::kSuccess : NavigationStatus::kStaleGrid)
        << bench.message_;
  }
}

/// Driving at 0.4 m/s to a goal 3 m away, and stopped by the base itself, which lets go after a while.
std::unique_ptr<Bench> drivenAndStopped(BaseStop stop, double duration_s) {
  auto made = std::make_unique<Bench>(Pose2d{-1.5, 0.0, 0.0});
  Bench& bench = *made;
  bench.input_.stop = BaseStop::kNone;
  bench.navigator_.setGoal({1.5, 0.0, 0.0});
  EXPECT_TRUE(bench.runUntilFast(0.4));
  bench.input_.stop = stop;
  bench.braking_m_s2_ = std::numeric_limits<double>::infinity();  // the base does that by itself
  for (double t = 0.0; t < duration_s; t += kDt_s) {
    bench.step();
    EXPECT_EQ(bench.output_.command.linear_m_s, 0.0) << "after " << t << " s";
    EXPECT_EQ(bench.output_.command.angular_rad_s, 0.0);
    if (bench.navigator_.isActive()) {
      EXPECT_THAT(bench.output_.reason, HasSubstr("the base is stopped"));
    }
  }
  bench.input_.stop = BaseStop::kNone;
  bench.braking_m_s2_ = shippedLimits().linear_m_s2;
  return made;
}

TEST(BaseNavigator, GoesOnAfterAStopOfTheBasesScanner) {
  for (const double duration_s : {2.0, 10.0}) {
    const auto made = drivenAndStopped(BaseStop::kScanner, duration_s);
    Bench& bench = *made;
    EXPECT_THAT(bench.output_.reason, HasSubstr("safety scanner"));
    ASSERT_FALSE(bench.status_) << bench.message_;
    ASSERT_TRUE(bench.run(60.0));
    EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
    expectAt(bench, {1.5, 0.0, 0.0});
    EXPECT_EQ(bench.navigator_.numPlans(), 2u) << "the plan, and its end: the way was still good";
  }
}

TEST(BaseNavigator, EndsAfterALongStopOfTheBasesScanner) {
  const auto made = drivenAndStopped(BaseStop::kScanner, BaseNavigatorConfig().scanner_patience_s + 1.0);
  const Bench& bench = *made;
  ASSERT_TRUE(bench.status_);
  EXPECT_EQ(*bench.status_, NavigationStatus::kBaseStopped);
  EXPECT_THAT(bench.message_, HasSubstr("safety scanner's field, for 30.0 s"));
}

TEST(BaseNavigator, NothingMovesByItselfAfterAButton) {
  for (const auto& [stop, text] :
       {std::pair(BaseStop::kButton, "emergency button"), std::pair(BaseStop::kSignal, "stop input")}) {
    for (const double duration_s : {0.5, 10.0}) {
      const auto made = drivenAndStopped(stop, duration_s);
      Bench& bench = *made;
      ASSERT_TRUE(bench.status_);
      EXPECT_EQ(*bench.status_, NavigationStatus::kBaseStopped);
      EXPECT_THAT(bench.message_, HasSubstr(text));
      const double stopped_m = bench.plant_.poseMap().x_m;
      EXPECT_FALSE(bench.run(5.0, [&] { return bench.output_.command.linear_m_s != 0.0; }));
      EXPECT_NEAR(bench.plant_.poseMap().x_m, stopped_m, 1e-3);
      // A new goal is a person's word.
      bench.status_.reset();
      bench.navigator_.setGoal({1.5, 0.0, 0.0});
      ASSERT_TRUE(bench.run(60.0));
      EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
    }
  }
}

TEST(BaseNavigator, AButtonBetweenGoalsRefusesTheNextOneOnce) {
  Bench bench;
  const auto press = [&](std::optional<BaseStop> before) {
    for (const auto& stop : {before, std::optional(BaseStop::kButton), std::optional(BaseStop::kNone)}) {
      bench.input_.stop = stop;
      bench.run(0.5, [] { return false; });
    }
  };
  const auto drive = [&] {
    bench.status_.reset();
    bench.navigator_.setGoal({0.5, 0.0, 0.0});
    EXPECT_TRUE(bench.run(60.0));
    return bench.status_.value_or(NavigationStatus::kStuck);
  };
  press(std::nullopt);
  EXPECT_EQ(drive(), NavigationStatus::kSuccess) << "pressed when the robot was started: " << bench.message_;
  press(BaseStop::kNone);
  EXPECT_EQ(drive(), NavigationStatus::kBaseStopped);
  EXPECT_THAT(bench.message_, HasSubstr("before this goal"));
  EXPECT_EQ(drive(), NavigationStatus::kSuccess) << bench.message_;
  // Still pressed: each one.
  bench.input_.stop = BaseStop::kButton;
  EXPECT_EQ(drive(), NavigationStatus::kBaseStopped);
  EXPECT_EQ(drive(), NavigationStatus::kBaseStopped);
  bench.input_.stop = BaseStop::kNone;
  EXPECT_EQ(drive(), NavigationStatus::kSuccess) << bench.message_;
}

TEST(BaseNavigator, StopsSoonWhenSomebodyAsksForIt) {
  // 0.5 m/s: 0.125 m with 1 m/s^2, 0.625 m with the comfortable 0.2 m/s^2. The drives lag by 0.1 s.
  for (const bool is_cancelled : {true, false}) {
    Bench bench({-3.0, 0.0, 0.0}, withHeartbeat());
    bench.navigator_.setGoal({4.0, 0.0, 0.0});
    ASSERT_TRUE(bench.runUntilFast(0.5));
    bench.braking_m_s2_ = shippedLimits().stop_m_s2;
    if (is_cancelled) {
      bench.navigator_.cancel();
    } else {
      bench.has_heartbeat_ = false;
      ASSERT_TRUE(bench.run(2.0, [&] { return bench.output_.phase == NavigationPhase::kWaitingForData; }));
    }
    const double speed_m_s = bench.plant_.wheels().linear_m_s;
    const double asked_m = bench.plant_.poseMap().x_m;
    ASSERT_TRUE(bench.run(10.0));
    EXPECT_EQ(*bench.status_, is_cancelled ? NavigationStatus::kCancelled : NavigationStatus::kStaleHeartbeat);
    EXPECT_LT(bench.plant_.poseMap().x_m - asked_m, 0.5 * speed_m_s * speed_m_s + 0.12 * speed_m_s);
  }
}

TEST(BaseNavigator, BelievesNoStampsThatCannotBe) {
  for (const double ahead_s : {-5.0, 5.0}) {
    Bench bench({-3.0, 0.0, 0.0});
    bench.navigator_.setGoal({4.0, 0.0, 0.0});
    ASSERT_TRUE(bench.runUntilFast());
    bench.odometry_ahead_s_ = ahead_s;
    ASSERT_TRUE(bench.run(10.0));
    EXPECT_EQ(*bench.status_, NavigationStatus::kStaleOdometry) << bench.message_;
    EXPECT_THAT(bench.message_, HasSubstr(ahead_s < 0.0 ? "ran back by" : "ahead of the clock"));
  }
}

TEST(BaseNavigator, PlansAnewWhenTheLocalizationJumps) {
  Bench bench({-3.0, 0.0, 0.0});
  bench.navigator_.setGoal({3.0, 0.0, 0.0});
  ASSERT_TRUE(bench.runUntilFast());
  bench.pose_jump_ = {0.0, 0.5, 0.0};
  bench.step();
  EXPECT_EQ(bench.output_.phase, NavigationPhase::kBraking);
  EXPECT_THAT(bench.output_.reason, HasSubstr("jumped by 0.50 m"));
  ASSERT_TRUE(bench.run(60.0));
  EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
  expectAt(bench, {3.0, -0.5, 0.0});  // where the goal is for a localisation that is 0.5 m off
  EXPECT_GE(bench.navigator_.numPlans(), 2u);
}

struct Drive {
  double duration_s{0.0};
  double fastest_m_s{0.0};
  double slowed_m_s{0.0};  // all that the command was taken back before it came to brake for the end
};

/// Along 7 m.
Drive driveStraight(int pose_every, int pose_late, double odometry_scale) {
  PlantConfig plant;
  plant.odometry_scale = odometry_scale;
  Bench bench({-3.5, 0.0, 0.0}, {}, plant);
  bench.pose_every_ = pose_every;
  bench.pose_late_ = pose_late;
  bench.run(0.5, [] { return false; });
  const double begun_s = bench.now_s_;
  bench.navigator_.setGoal({3.5, 0.0, 0.0});
  Drive drive;
  double before_m_s = 0.0;
  EXPECT_TRUE(bench.run(120.0, [&] {
    const double command_m_s = bench.output_.command.linear_m_s;
    drive.fastest_m_s = std::max(drive.fastest_m_s, bench.plant_.wheels().linear_m_s);
    if (bench.output_.remaining_m > 2.0) drive.slowed_m_s += std::max(0.0, before_m_s - command_m_s);
    before_m_s = command_m_s;
    return bench.status_.has_value();
  })) << bench.output_.reason;
  EXPECT_EQ(bench.status_.value_or(NavigationStatus::kStuck), NavigationStatus::kSuccess) << bench.message_;
  EXPECT_EQ(bench.navigator_.numPlans(), 2u);  // the plan, and its end
  expectAt(bench, {3.5, 0.0, 0.0});
  drive.duration_s = bench.now_s_ - begun_s;
  return drive;
}

TEST(BaseNavigator, IsNoSlowerWithALocalisationThatIsSeldomAndLate) {
  for (const double odometry_scale : {1.0, 1.01}) {
    const Drive ideal = driveStraight(1, 0, odometry_scale);
    for (const auto& [every, late] : {std::pair(5, 0), std::pair(5, 5), std::pair(10, 5)}) {  // 10 Hz and 5 Hz, 0.1 s
      SCOPED_TRACE(std::to_string(every) + " " + std::to_string(late) + " " + std::to_string(odometry_scale));
      const Drive drive = driveStraight(every, late, odometry_scale);
      // Exact odometry carries an exact pose: the same drive, but that its end waits for a localisation. Wrong by 1 %,
      // it is off by 2 mm at most, 0.3 s after a localisation: 4 % of what the reference waits for.
      const double within = odometry_scale == 1.0 ? 1e-6 : 0.01;
      EXPECT_NEAR(drive.duration_s, ideal.duration_s, every * kDt_s + within * ideal.duration_s);
      EXPECT_NEAR(drive.fastest_m_s, ideal.fastest_m_s, within);
      EXPECT_NEAR(drive.slowed_m_s, ideal.slowed_m_s, odometry_scale == 1.0 ? 1e-6 : 0.1);
    }
  }
}

TEST(BaseNavigator, NoticesThatASeldomLocalisationHasDied) {
  Bench bench({-3.0, 0.0, 0.0});
  bench.pose_every_ = 5;
  bench.pose_late_ = 5;
  bench.navigator_.setGoal({4.0, 0.0, 0.0});
  ASSERT_TRUE(bench.runUntilFast());
  bench.has_pose_ = false;  // odometry goes on
  const double died_s = bench.now_s_;
  ASSERT_TRUE(bench.run(12.0, [&] { return bench.output_.phase == NavigationPhase::kWaitingForData; }));
  EXPECT_LE(bench.now_s_ - died_s, BaseNavigatorConfig{}.max_pose_age_s + 2.0 * kDt_s);
  ASSERT_TRUE(bench.run(12.0));
  EXPECT_EQ(*bench.status_, NavigationStatus::kStalePose) << bench.message_;
}

TEST(BaseNavigator, NoticesSlippingWithALocalisationThatIsSeldomAndLate) {
  for (const int every : {5, 10}) {
    Bench bench({-3.0, 0.0, 0.0});
    bench.pose_every_ = every;
    bench.pose_late_ = 5;
    bench.navigator_.setGoal({4.0, 0.0, 0.0});
    ASSERT_TRUE(bench.runUntilFast());
    bench.plant_.config().slip = 1.0;
    ASSERT_TRUE(bench.run(30.0)) << bench.output_.reason;
    EXPECT_EQ(*bench.status_, NavigationStatus::kStuck) << bench.message_;
    EXPECT_THAT(bench.message_, HasSubstr("the localisation reports"));
  }
}

TEST(BaseNavigator, StopsAtOnceWhenOdometryJumps) {
  for (const int every : {1, 5}) {
    for (const Pose2d& odometry_jump : {Pose2d{1.0, 0.0, 0.0}, Pose2d{0.0, 0.0, 0.5}}) {
      Bench bench({-3.0, 0.0, 0.0});
      bench.pose_every_ = every;
      bench.navigator_.setGoal({3.0, 0.0, 0.0});
      ASSERT_TRUE(bench.runUntilFast());
      EXPECT_EQ(bench.num_jumps_, 0);
      bench.odometry_jump_ = odometry_jump;
      bench.step();
      EXPECT_EQ(bench.output_.phase, NavigationPhase::kBraking);
      EXPECT_THAT(bench.output_.reason, HasSubstr("odometry has jumped by"));
      EXPECT_TRUE(bench.output_.has_jumped);
      ASSERT_TRUE(bench.run(60.0));
      EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
      expectAt(bench, {3.0, 0.0, 0.0});
    }
  }
}

TEST(BaseNavigator, TellsOfJumpsWhateverItDoes) {
  // Less than a jump: the localisation corrects itself.
  Bench bench({-3.0, 0.0, 0.0});
  bench.run(0.5, [] { return false; });
  bench.pose_jump_ = {0.0, 0.2, 0.1};
  bench.run(0.5, [] { return false; });
  EXPECT_EQ(bench.num_jumps_, 0);
  // While idle.
  bench.pose_jump_ = {0.0, -0.5, 0.0};
  bench.step();
  EXPECT_TRUE(bench.output_.has_jumped);
  EXPECT_EQ(bench.output_.phase, NavigationPhase::kIdle);
  bench.run(0.5, [] { return false; });
  EXPECT_EQ(bench.num_jumps_, 1) << "it is told of once";
  // In the step in which a goal begins.
  bench.pose_jump_ = {};
  bench.pose_jump_.yaw_rad = 0.3;
  bench.navigator_.setGoal({2.0, 0.0, 0.0});
  bench.step();
  EXPECT_TRUE(bench.output_.has_jumped);
  // Under way.
  ASSERT_TRUE(bench.runUntilFast());
  EXPECT_EQ(bench.num_jumps_, 2);
  bench.pose_jump_ = {};
  bench.step();
  EXPECT_TRUE(bench.output_.has_jumped);
  // While odometry is away.
  bench.has_odometry_ = false;
  bench.run(1.0, [] { return false; });
  bench.num_jumps_ = 0;
  bench.pose_jump_ = {0.0, 0.5, 0.0};
  bench.step();
  EXPECT_TRUE(bench.output_.has_jumped);
  // Twice at one time: nothing new.
  EXPECT_FALSE(bench.navigator_.step(bench.input_).has_jumped);
}

TEST(BaseNavigator, WaitsAfterAJumpForWhatTheScannerSeesThen) {
  Bench bench;
  bench.run(0.5, [] { return false; });
  bench.pose_jump_ = {1.0, 0.0, 0.0};
  bench.has_scan_ = false;  // for less than max_scan_age_s
  bench.step();
  bench.navigator_.setGoal({3.0, 0.0, 0.0});
  bench.run(0.2, [] { return false; });
  EXPECT_EQ(bench.navigator_.numPlans(), 0u);
  EXPECT_EQ(bench.output_.phase, NavigationPhase::kPlanning);
  EXPECT_THAT(bench.output_.reason, HasSubstr("scan"));
  bench.has_scan_ = true;
  bench.run(0.1, [] { return false; });
  EXPECT_EQ(bench.navigator_.numPlans(), 1u);
  ASSERT_TRUE(bench.run(60.0));
  EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
}

// A wrong pose at the start, put right while the base stands, and in the same step a goal begins.
TEST(BaseNavigator, ForgetsOnAJumpWhatWasSeenWithTheWrongPoseAndDrivesOn) {
  Bench bench({-3.0, 0.0, 0.0});
  bench.fusion_ = std::make_unique<GridFusion>(GridFusionConfig(), shippedFootprint());
  bench.pose_jump_ = {0.0, 0.0, M_PI};  // believed at (3, 0), looking at the origin
  bench.run(1.0, [] { return false; });
  const Eigen::Vector2d unseen(2.0, 0.0);  // 0.7 m beyond what the scanner frees from (-3, 0)
  const auto at = [&] {
    const Eigen::Vector2i cell = bench.input_.grid->cellOf(unseen);
    return bench.input_.grid->at(cell.x(), cell.y());
  };
  ASSERT_EQ(at(), SpaceState::kFree);
  bench.pose_jump_ = {};
  bench.navigator_.setGoal({0.3, 0.5, 0.3});
  bench.step();
  // From here on as a grid that has known nothing before.
  GridFusion anew(GridFusionConfig(), shippedFootprint());
  for (int i = 0; i < 10; ++i) {
    bench.step();
    const Pose2d& T_map_base = bench.input_.T_map_base;
    if (bench.input_.scan_stamp_s == bench.now_s_) anew.addScan(*bench.input_.scan, T_map_base, bench.now_s_);
    anew.addFootprint(T_map_base);
    const auto expected = anew.build(T_map_base, bench.now_s_);
    ASSERT_EQ(bench.input_.grid->origin_m, expected->origin_m);
    ASSERT_TRUE(bench.input_.grid->state == expected->state) << "step " << i;
  }
  EXPECT_EQ(at(), SpaceState::kUnknown);
  ASSERT_TRUE(bench.run(60.0)) << bench.output_.reason;
  EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
  expectAt(bench, {0.3, 0.5, 0.3});
  EXPECT_EQ(bench.num_jumps_, 1);
}

TEST(BaseNavigator, PlansAnewWhenTheWayIsNotFreeAnyMore) {
  Bench bench({-3.0, 0.0, 0.0});
  bench.navigator_.setGoal({4.0, 0.0, 0.0});
  ASSERT_TRUE(bench.runUntilFast(0.5));
  const std::uint64_t plans = bench.navigator_.numPlans();
  bench.world_.push_back(box(-2.0, -2.5, 0.5, 0.5));  // elsewhere
  bench.seeInGrid();
  bench.run(0.5, [] { return false; });
  EXPECT_EQ(bench.navigator_.numPlans(), plans);
  EXPECT_EQ(bench.output_.phase, NavigationPhase::kDriving);
  bench.world_.push_back(box(2.5, 0.0, 0.3, 0.6));
  bench.seeInGrid();
  bench.step();
  EXPECT_EQ(bench.output_.phase, NavigationPhase::kBraking);
  EXPECT_THAT(bench.output_.reason, HasSubstr("occupied"));
  ASSERT_TRUE(bench.run(90.0));
  EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
  EXPECT_GT(bench.navigator_.numPlans(), plans);
  EXPECT_GT(bench.smallest_gap_m_, 0.0);
}

TEST(BaseNavigator, StopsForTheScannerAndGoesOnWhenItsObstacleGoes) {
  Bench bench({-3.0, 0.0, 0.0});
  bench.navigator_.setGoal({4.0, 0.0, 0.0});
  ASSERT_TRUE(bench.runUntilFast(0.5));
  const double x_m = bench.plant_.poseMap().x_m;
  bench.world_.push_back(box(x_m + 2.2, 0.0, 0.3, 0.3));
  ASSERT_TRUE(bench.run(20.0, [&] { return bench.output_.phase == NavigationPhase::kBlocked; }));
  EXPECT_THAT(bench.output_.reason, HasSubstr("obstacle at"));
  EXPECT_TRUE(bench.output_.guard.obstacle_base.has_value());
  bench.run(1.0, [] { return false; });
  // Near to it, not on it: margin 4 cm, and speeds below 1 cm/s count as blocked.
  EXPECT_GT(bench.smallest_gap_m_, 0.03);
  EXPECT_LT(bench.smallest_gap_m_, 0.1);
  bench.world_.pop_back();
  ASSERT_TRUE(bench.run(60.0));
  EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
  EXPECT_EQ(bench.navigator_.numPlans(), 2u);
}

TEST(BaseNavigator, TakesFromTheScansDistancesWhatHasBeenDrivenSince) {
  Bench bench({-4.0, 0.0, 0.0});
  bench.navigator_.setGoal({4.0, 0.0, 0.0});
  ASSERT_TRUE(bench.runUntilFast(0.5));
  // Within the guard's look, and farther than what makes it slow down.
  bench.world_.push_back(box(bench.plant_.poseMap().x_m + 0.296 + 0.04 + 2.5 + 0.15, 0.0, 0.3, 0.6));
  ASSERT_TRUE(bench.run(1.0, [&] { return bench.output_.guard.obstacle_base.has_value(); }));
  bench.has_scan_ = false;  // for less than max_scan_age_s
  double before_m = bench.plant_.poseMap().x_m;
  bench.step();
  const double obstacle_m = before_m + bench.output_.guard.free_m;
  for (int i = 0; i < 12; ++i) {
    before_m = bench.plant_.poseMap().x_m;
    bench.step();
    ASSERT_EQ(bench.output_.phase, NavigationPhase::kDriving);
    EXPECT_NEAR(before_m + bench.output_.guard.free_m, obstacle_m, 0.002);  // driven: 10 mm in each step
  }
}

TEST(BaseNavigator, OtherLimitsHoldFromTheNextPlanOn) {
  MotionLimits slow = shippedLimits();
  slow.forward_m_s = 0.25 * slow.forward_m_s;
  Bench bench({-1.5, 0.0, 0.0});
  bench.navigator_.setGoal({1.5, 0.0, 0.0});
  ASSERT_TRUE(bench.runUntilFast(0.4));
  bench.navigator_.retune(ObstacleGuardConfig{}, slow);
  double path_m_s = 0.0;
  ASSERT_TRUE(bench.run(30.0, [&] {
    path_m_s = std::max(path_m_s, bench.output_.command.linear_m_s);
    return bench.status_.has_value();
  }));
  EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
  EXPECT_GT(path_m_s, 0.4) << "the path in progress keeps its speed";
  for (const double share : {0.25, 1.0}) {
    MotionLimits limits = shippedLimits();
    limits.forward_m_s = share * limits.forward_m_s;
    bench.navigator_.retune(ObstacleGuardConfig{}, limits);
    bench.status_.reset();
    bench.navigator_.setGoal({share < 1.0 ? 3.5 : -1.5, 0.0, share < 1.0 ? 0.0 : 3.14});
    double most_m_s = 0.0;
    ASSERT_TRUE(bench.run(60.0, [&] {
      most_m_s = std::max(most_m_s, bench.output_.command.linear_m_s);
      return bench.status_.has_value();
    }));
    EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
    EXPECT_LE(most_m_s, limits.forward_m_s + 1e-9);
    EXPECT_GT(most_m_s, 0.8 * limits.forward_m_s) << "reserve and rounding leave nine tenths";
  }
}

TEST(BaseNavigator, AnotherMarginOfTheGuardHoldsFromTheNextStepOn) {
  for (const double margin_m : {0.04, 0.3}) {
    Bench bench({-3.0, 0.0, 0.0});
    bench.navigator_.setGoal({3.0, 0.0, 0.0});
    ASSERT_TRUE(bench.runUntilFast(0.5));
    ObstacleGuardConfig guard;
    guard.margin_m = margin_m;
    bench.navigator_.retune(guard, shippedLimits());
    bench.world_.push_back(box(bench.plant_.poseMap().x_m + 2.7, 0.0, 0.3, 3.0));  // the grid does not know it
    ASSERT_TRUE(bench.run(20.0, [&] { return bench.output_.phase == NavigationPhase::kBlocked; }));
    // It stops before the margin, but creeps up to it: within the centimetre below which the guard calls it blocked.
    EXPECT_GE(bench.smallest_gap_m_, margin_m - 0.002);
    EXPECT_LE(bench.smallest_gap_m_, margin_m + 0.02);
  }
}

TEST(BaseNavigator, ImpossibleChangesAreRefusedAndChangeNothing) {
  Bench bench({-3.0, 0.0, 0.0});
  ObstacleGuardConfig guard;
  guard.margin_m = 2.0;
  EXPECT_THROW(bench.navigator_.retune(guard, shippedLimits()), std::invalid_argument);
  MotionLimits too_fast = shippedLimits();
  too_fast.forward_m_s = 5.0;  // cannot stop within the guard's look_ahead_m
  EXPECT_THROW(bench.navigator_.retune(ObstacleGuardConfig{}, too_fast), std::invalid_argument);
  bench.navigator_.setGoal({-1.0, 0.0, 0.0});
  ASSERT_TRUE(bench.run(30.0));
  EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
}

TEST(BaseNavigator, GoesRoundAnObstacleThatStays) {
  Bench bench({-3.0, 0.0, 0.0});
  bench.navigator_.setGoal({4.0, 0.0, 0.0});
  ASSERT_TRUE(bench.runUntilFast(0.5));
  bench.world_.push_back(box(bench.plant_.poseMap().x_m + 2.2, 0.0, 0.3, 0.3));
  ASSERT_TRUE(bench.run(20.0, [&] { return bench.output_.phase == NavigationPhase::kBlocked; }));
  const double blocked_s = bench.now_s_;
  const std::uint64_t plans = bench.navigator_.numPlans();
  bench.seeInGrid();
  bench.input_.grid = bench.grid_;
  ASSERT_TRUE(bench.run(20.0, [&] { return bench.navigator_.numPlans() > plans; }));
  EXPECT_LE(bench.now_s_ - blocked_s, BaseNavigatorConfig{}.blocked_patience_s + 0.2);
  ASSERT_TRUE(bench.run(120.0));
  EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
  EXPECT_GT(bench.smallest_gap_m_, 0.0);
}

TEST(BaseNavigator, GivesUpBeforeAnObstacleThatTheGridNeverSees) {
  BaseNavigatorConfig config;
  config.max_plans = 3;
  Bench bench({-3.0, 0.0, 0.0}, config);
  bench.navigator_.setGoal({4.0, 0.0, 0.0});
  ASSERT_TRUE(bench.runUntilFast(0.5));
  bench.world_.push_back(box(bench.plant_.poseMap().x_m + 2.2, 0.0, 0.3, 3.0));
  ASSERT_TRUE(bench.run(120.0));
  EXPECT_EQ(*bench.status_, NavigationStatus::kObstacle) << bench.message_;
  EXPECT_THAT(bench.message_, HasSubstr("planned 3 times, may be 3"));
  EXPECT_GT(bench.smallest_gap_m_, 0.0);
}

TEST(BaseNavigator, EndsAfterTooManyPlans) {
  BaseNavigatorConfig config;
  config.max_plans = 2;
  Bench bench({-3.0, 0.0, 0.0}, config);
  bench.navigator_.setGoal({3.0, 0.0, 0.0});
  for (int i = 0; i < 3 && !bench.status_; ++i) {
    const std::uint64_t plans = bench.navigator_.numPlans();
    bench.run(20.0, [&] {
      return bench.status_ || (bench.navigator_.numPlans() > plans && bench.plant_.wheels().linear_m_s > 0.2);
    });
    bench.pose_jump_.y_m += 0.4;
  }
  ASSERT_TRUE(bench.status_ || bench.run(20.0));
  EXPECT_EQ(*bench.status_, NavigationStatus::kTooManyPlans) << bench.message_;
  EXPECT_THAT(bench.message_, HasSubstr("jumped"));
}

TEST(BaseNavigator, NoticesThatTheBaseDoesNotMove) {
  // Slipping from the start and under way, and wheels that do not turn.
  for (const bool is_at_start : {true, false}) {
    Bench bench({-3.0, 0.0, 0.0});
    bench.navigator_.setGoal({4.0, 0.0, 0.0});
    if (!is_at_start) {
      ASSERT_TRUE(bench.runUntilFast());
    }
    bench.plant_.config().slip = 1.0;
    ASSERT_TRUE(bench.run(30.0)) << bench.output_.reason;
    EXPECT_EQ(*bench.status_, NavigationStatus::kStuck) << bench.message_;
    EXPECT_THAT(bench.message_, HasSubstr("the wheels slip"));
    EXPECT_THAT(bench.message_, HasSubstr("the localisation reports"));
  }
  Bench bench;
  bench.navigator_.setGoal({3.0, 0.0, 0.0});
  bench.plant_.config().max_linear_m_s2 = 0.0;  // motors off
  bench.plant_.config().max_turn_rad_s2 = 0.0;
  ASSERT_TRUE(bench.run(30.0)) << bench.output_.reason;
  EXPECT_EQ(*bench.status_, NavigationStatus::kStuck) << bench.message_;
  EXPECT_THAT(bench.message_, HasSubstr("odometry reports"));
}

TEST(BaseNavigator, WaitsForABaseThatDoesNotStandWhenTold) {
  Bench bench;
  bench.plant_.config().max_linear_m_s2 = 2.4;
  for (int i = 0; i < 50; ++i) bench.plant_.step({0.3, 0.0}, kDt_s);
  bench.plant_.config().max_linear_m_s2 = 0.0;  // rolls on
  bench.navigator_.setGoal({3.0, 0.0, 0.0});
  ASSERT_TRUE(bench.run(30.0));
  EXPECT_EQ(*bench.status_, NavigationStatus::kStuck) << bench.message_;
  EXPECT_THAT(bench.message_, HasSubstr("after the command to stop"));
}

TEST(BaseNavigator, TriesAMissedGoalOnceMore) {
  // Pushed aside when it arrives; the second time it is left alone, or not.
  for (const int pushes : {1, 5}) {
    Bench bench({-1.0, 0.0, 0.0});
    bench.navigator_.setGoal({2.0, 0.0, 0.0});
    int pushed = 0;
    std::uint64_t pushed_plan = 0;  // once on each way
    for (double t = 0.0; t < 150.0 && !bench.status_; t += kDt_s) {
      bench.step();
      const bool is_near = bench.navigator_.isActive() && bench.output_.remaining_m < 0.008 &&
                           bench.output_.phase == NavigationPhase::kDriving;
      if (is_near && bench.navigator_.numPlans() != pushed_plan && pushed < pushes) {
        pushed_plan = bench.navigator_.numPlans();
        bench.plant_.place(compose(bench.plant_.poseMap(), {0.0, 0.06, 0.0}));
        ++pushed;
      }
    }
    ASSERT_TRUE(bench.status_) << bench.output_.reason;
    if (pushes == 1) {
      EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
      expectAt(bench, {2.0, 0.0, 0.0});
    } else {
      EXPECT_EQ(*bench.status_, NavigationStatus::kGoalMissed) << bench.message_;
      EXPECT_EQ(pushed, 2);
      EXPECT_THAT(bench.message_, HasSubstr("may be 0.020 m"));
    }
  }
}

TEST(BaseNavigator, BrakesWhenCancelled) {
  Bench bench({-3.0, 0.0, 0.0});
  bench.navigator_.setGoal({4.0, 0.0, 0.0});
  ASSERT_TRUE(bench.runUntilFast(0.5));
  bench.braking_m_s2_ = shippedLimits().stop_m_s2;
  bench.navigator_.cancel();
  bench.step();
  EXPECT_EQ(bench.output_.phase, NavigationPhase::kBraking);
  EXPECT_FALSE(bench.status_);
  ASSERT_TRUE(bench.run(10.0));
  EXPECT_EQ(*bench.status_, NavigationStatus::kCancelled);
  EXPECT_LT(std::abs(bench.plant_.wheels().linear_m_s), 0.01);  // as odometry's noise allows to tell
  // Before it has begun, and while it is planned.
  Bench standing;
  standing.navigator_.cancel();
  EXPECT_FALSE(standing.navigator_.isActive());
  standing.navigator_.setGoal({2.0, 0.0, 0.0});
  standing.navigator_.cancel();
  ASSERT_TRUE(standing.run(2.0));
  EXPECT_EQ(*standing.status_, NavigationStatus::kCancelled);
  Bench planning;
  planning.navigator_.setGoal({2.0, 2.0, 0.0});
  planning.step();  // sources are fresh
  EXPECT_EQ(planning.navigator_.numPlans(), 1u);
}

TEST(BaseNavigator, EndsAPlanThatIsCancelled) {
  Bench bench;
  bench.step();
  NavigationInput input = bench.input_;
  input.now_s += kDt_s;
  input.odometry_stamp_s += kDt_s;
  bench.navigator_.setGoal({2.0, 2.0, 0.0});
  NavigationOutput output = bench.navigator_.step(input, [] { return true; });
  for (int i = 0; i < 10 && !output.ended; ++i) {
    input.now_s += kDt_s;
    input.odometry_stamp_s += kDt_s;
    output = bench.navigator_.step(input, [] { return true; });
  }
  ASSERT_TRUE(output.ended);
  EXPECT_EQ(*output.ended, NavigationStatus::kCancelled);
}

TEST(BaseNavigator, TakesANewGoalUnderWay) {
  Bench bench({-3.0, 0.0, 0.0});
  bench.navigator_.setGoal({4.0, 0.0, 0.0});
  ASSERT_TRUE(bench.runUntilFast(0.5));
  bench.navigator_.setGoal({-2.0, 2.0, 1.57});
  bench.step();
  EXPECT_EQ(bench.output_.phase, NavigationPhase::kBraking);
  ASSERT_TRUE(bench.run(120.0));
  EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
  expectAt(bench, {-2.0, 2.0, 1.57});
}

TEST(BaseNavigator, BearsNoiseOfLocalizationAndDriftOfOdometry) {
  PlantConfig plant;
  plant.localization_noise_m = 0.01;
  plant.localization_noise_rad = 0.5 * M_PI / 180.0;
  plant.odometry_scale = 1.01;
  plant.odometry_turn_scale = 0.98;
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    Bench bench({}, {}, plant, seed);
    bench.scan_noise_m_ = 0.01;
    bench.navigator_.setGoal({2.0, 1.5, 0.7});
    ASSERT_TRUE(bench.run(120.0));
    EXPECT_EQ(*bench.status_, NavigationStatus::kSuccess) << bench.message_;
    expectAt(bench, {2.0, 1.5, 0.7}, 0.03, 3.0 * M_PI / 180.0);  // as of drives in the simulated world
  }
}

TEST(BaseNavigator, AlwaysEndsAndTouchesNothingInFront) {
  std::set<NavigationStatus> seen;
  int reached = 0;
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> share(0.0, 1.0);
    PlantConfig plant;
    plant.localization_noise_m = 0.005;
    plant.localization_noise_rad = 0.004;
    BaseNavigatorConfig config;
    config.max_plans = 3;
    Bench bench({-3.5, -2.0 + 4.0 * share(random), 6.28 * share(random)}, config, plant, seed);
    bench.scan_noise_m_ = 0.005;
    const Pose2d goal{3.0, -2.0 + 4.0 * share(random), 6.28 * share(random)};
    for (int i = 0; i < 4; ++i) {
      const Polygon one = box(-1.5 + 3.0 * share(random), -3.0 + 6.0 * share(random), 0.2 + 0.5 * share(random), 0.3,
                              6.28 * share(random));
      bench.world_.push_back(one);
    }
    bench.seeInGrid();
    bench.navigator_.setGoal(goal);
    double appears_s = bench.now_s_ + 3.0 + 10.0 * share(random);
    const double fault_s = bench.now_s_ + 5.0 + 30.0 * share(random);
    const int fault = static_cast<int>(8.0 * share(random));
    double seen_s = std::numeric_limits<double>::infinity();
    while (!bench.status_ && bench.now_s_ < 400.0) {
      bench.step();
      if (bench.now_s_ >= appears_s && bench.plant_.wheels().linear_m_s > 0.05) {
        // Across the way, no nearer than what the base can stop in front of.
        const double v = bench.plant_.wheels().linear_m_s;
        const double ahead_m = 0.296 + 0.04 + v * 0.25 + v * v / (2.0 * 0.7 * 0.2) + 0.15 + 0.3 * share(random);
        const Pose2d at = compose(bench.plant_.poseMap(), {ahead_m + 0.1, 0.3 * share(random) - 0.15, 0.0});
        bench.world_.push_back(box(at.x_m, at.y_m, 0.2, 0.3, at.yaw_rad));
        seen_s = bench.now_s_ + 2.0 * share(random);
        appears_s = std::numeric_limits<double>::infinity();
      }
      if (bench.now_s_ >= seen_s) {
        bench.seeInGrid();
        seen_s = std::numeric_limits<double>::infinity();
      }
      const bool is_faulty = bench.now_s_ >= fault_s;
      bench.has_odometry_ = !(is_faulty && fault == 0);
      bench.has_pose_ = !(is_faulty && fault == 1 && bench.now_s_ < fault_s + 1.5);
      bench.has_scan_ = !(is_faulty && fault == 2);
      if (is_faulty && fault == 3) bench.plant_.config().slip = 1.0;
      if (is_faulty && fault == 4) bench.pose_jump_ = {0.0, 0.0, 0.3};
    }
    ASSERT_TRUE(bench.status_.has_value()) << "world " << seed << ": " << bench.output_.reason;
    EXPECT_TRUE(fault == 4 || bench.smallest_gap_m_ > 0.0)
        << "world " << seed << ", fault " << fault << ", " << bench.smallest_gap_m_;
    seen.insert(*bench.status_);
    reached += *bench.status_ == NavigationStatus::kSuccess;
  }
  EXPECT_GT(reached, 20);
  EXPECT_GE(seen.size(), 4u);
  RecordProperty("reached", reached);
}

TEST(BaseNavigator, RefusesWhatIsNoGoalAndNoConfiguration) {
  Bench bench;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(bench.navigator_.setGoal({nan, 0.0, 0.0}), std::invalid_argument);
  EXPECT_FALSE(bench.navigator_.isActive());
  NavigationInput input;
  input.now_s = nan;
  EXPECT_THROW(bench.navigator_.step(input), std::invalid_argument);
  BaseNavigatorConfig config;
  config.max_plans = 0;
  config.stuck_s = 0.1;
  EXPECT_THAT(
      messageOf<std::invalid_argument>([&] {
        BaseNavigator(config, BasePlannerConfig{}, PathFollowerConfig{}, ObstacleGuardConfig{}, shippedLimits(),
                      shippedFootprint());
      }),
      AllOf(HasSubstr("max_plans = 0, must be in [1, 1000]"), HasSubstr("stuck_s = 0.1 s, must be in [1, 60] s")));
}

}  // namespace
}  // namespace base_navigation
