// SPDX-License-Identifier: BSD-3-Clause
// What can go wrong while the base drives: people in the way, slipping wheels, sensors that fall silent, goals that cannot
// be reached. It never touches anything (NavigationTest looks after each test), stops, and says why.
#include <algorithm>
#include <limits>

#include <std_srvs/Trigger.h>

#include "navigation_world.h"
#include "simulated_world/obstacle.h"

namespace integration_tests {
namespace {

using simulated_world::kObstacleRadius_m;

// The tests drive to and fro between two places on open ground, which the scanner sees from where the robot begins.
const Pose2d kWest{-1.8, 1.2, 0.0};
const Pose2d kEast{0.2, 1.2, 0.0};

class NavigationFaults : public NavigationTest {
 protected:
  static Pose2d ahead(double x_m, double y_m = 0.0) { return simulated_world::compose(world->pose, {x_m, y_m, 0.0}); }

  static double speed() { return world->odometry.twist.twist.linear.x; }

  static double distanceTo(const Pose2d& place) {
    return std::hypot(world->pose.x_m - place.x_m, world->pose.y_m - place.y_m);
  }

  /// To the west end, looking east: who is there already stays.
  static void beginInTheWest() {
    if (distanceTo(kWest) < 0.05 && std::abs(std::remainder(world->pose.yaw_rad, 2.0 * M_PI)) < 0.1) return;
    const NavigationOutcome outcome = world->drive(kWest, 120.0);
    ASSERT_EQ(static_cast<int>(outcome.status), static_cast<int>(NavigationOutcome::SUCCESS)) << outcome.message;
  }

  /// On the way east, at 0.3 m/s.
  static void beginToDriveEast() {
    beginInTheWest();
    if (HasFatalFailure()) return;
    world->send(kEast);
    ASSERT_TRUE(world->goOn(30.0, [] { return speed() > 0.3; })) << world->state.reason;
  }

  static void expectStands() { EXPECT_LT(world->drivenInHalfASecond(), 0.001); }
};

TEST_F(NavigationFaults, ArrivesThoughOdometryDrifts) {
  // Somewhere else first, so that errors add up on some metres of way and some turns.
  const Pose2d start = world->pose;
  const auto odometryOf = [](const nav_msgs::Odometry& odometry) {
    const auto& p = odometry.pose.pose;
    return Pose2d{p.position.x, p.position.y, 2.0 * std::atan2(p.orientation.z, p.orientation.w)};
  };
  const Pose2d odometry_start = odometryOf(world->odometry);
  expectOutcome(world->drive({-1.0, -1.2, 1.0}, 120.0), NavigationOutcome::SUCCESS);
  expectOutcome(world->drive(kWest, 120.0), NavigationOutcome::SUCCESS);
  expectStands();
  expectAt(kWest);
  const Pose2d by_truth = simulated_world::compose(simulated_world::inverse(start), world->pose);
  const Pose2d by_wheels =
      simulated_world::compose(simulated_world::inverse(odometry_start), odometryOf(world->odometry));
  EXPECT_GT(std::hypot(by_truth.x_m - by_wheels.x_m, by_truth.y_m - by_wheels.y_m), 0.03)
      << "farther off than what is allowed: by odometry alone it would not have come there";
}

// 0.9 m before the front of a base at 0.45 m/s, which takes 0.5 m and a scan to stop within its limits.
TEST_F(NavigationFaults, ArrivesWithoutTouchingAPersonWhoLeaves) {
  beginInTheWest();
  ASSERT_FALSE(HasFatalFailure());
  world->send({1.2, 1.2, 0.0});
  ASSERT_TRUE(world->goOn(30.0, [] { return speed() > 0.45; })) << world->state.reason;
  const Pose2d person = ahead(kFront_m + 0.9 + kObstacleRadius_m);
  ASSERT_EQ(world->injectObstacle(person.x_m, person.y_m, 4.0), "");
  double nearest_m = std::numeric_limits<double>::infinity();
  const auto watch = [&] {
    if (has(world->incidents, "fault obstacle is over")) return;
    nearest_m = std::min(nearest_m, distanceTo(person) - kFront_m - kObstacleRadius_m);
  };
  // It takes more than 2 s to stop, and waits 3 s before it gives up: by then they have gone. A way round is right, too.
  expectOutcome(world->finish(120.0, watch), NavigationOutcome::SUCCESS);
  EXPECT_GT(nearest_m, 0.0);
  expectAt({1.2, 1.2, 0.0});
}

TEST_F(NavigationFaults, DrivesRoundAPersonWhoStays) {
  beginInTheWest();
  ASSERT_FALSE(HasFatalFailure());
  world->send({1.7, 1.2, 0.0});
  ASSERT_TRUE(world->goOn(30.0, [] { return speed() > 0.45; })) << world->state.reason;
  const Pose2d person = ahead(kFront_m + 0.9 + kObstacleRadius_m);
  ASSERT_EQ(world->injectObstacle(person.x_m, person.y_m, 90.0), "");
  const NavigationOutcome outcome = world->finish(85.0);
  expectOutcome(outcome, NavigationOutcome::SUCCESS);
  EXPECT_GE(outcome.plans, 2U) << "the first way led through the person";
  expectAt({1.7, 1.2, 0.0});
  // Until they have gone.
  EXPECT_TRUE(world->goOn(90.0, [] { return has(world->incidents, "fault obstacle is over"); }));
}

TEST_F(NavigationFaults, SpinningWheelsAreStuck) {
  beginToDriveEast();
  ASSERT_FALSE(HasFatalFailure());
  world->inject("wheel_slip", 30.0, 1.0, 1.0);
  expectOutcome(world->finish(29.0), NavigationOutcome::STUCK);
  expectStands();
  EXPECT_TRUE(world->goOn(40.0, [] { return has(world->incidents, "fault wheel_slip is over"); }));
}

TEST_F(NavigationFaults, OneSlippingWheelIsStuckOrOvercome) {
  beginToDriveEast();
  ASSERT_FALSE(HasFatalFailure());
  world->inject("wheel_slip", 200.0, 0.9, 0.0);
  const NavigationOutcome outcome = world->finish(199.0);
  if (outcome.status == NavigationOutcome::SUCCESS) {
    expectAt(kEast);
  } else if (outcome.status != NavigationOutcome::TOO_MANY_PLANS) {  // off its way again and again
    expectOutcome(outcome, NavigationOutcome::STUCK);
  }
  expectStands();
  EXPECT_TRUE(world->goOn(220.0, [] { return has(world->incidents, "fault wheel_slip is over"); }));
}

TEST_F(NavigationFaults, StopsWithoutScanner) {
  beginToDriveEast();
  ASSERT_FALSE(HasFatalFailure());
  const ros::Time lost = world->now();
  world->inject("scanner_gone", 15.0);
  // 0.4 s until the last scan is too old, and 0.5 m/s braked with 0.2 m/s^2.
  EXPECT_TRUE(world->goOn(4.0, [] { return speed() == 0.0; }));
  expectOutcome(world->finish(14.0), NavigationOutcome::STALE_SCAN);
  EXPECT_GT((world->now() - lost).toSec(), 2.0) << "it had patience";
  expectStands();
  EXPECT_TRUE(world->goOn(20.0, [] { return has(world->incidents, "fault scanner_gone is over"); }));
}

TEST_F(NavigationFaults, GoesOnAfterAShortSilenceOfTheScanner) {
  beginToDriveEast();
  ASSERT_FALSE(HasFatalFailure());
  world->inject("scanner_gone", 1.2);
  EXPECT_TRUE(world->goOn(5.0, [] { return world->state.phase == NavigationState::WAITING_FOR_DATA; }));
  expectOutcome(world->finish(60.0), NavigationOutcome::SUCCESS);
  expectAt(kEast);
}

TEST_F(NavigationFaults, StopsWithoutOdometry) {
  beginToDriveEast();
  ASSERT_FALSE(HasFatalFailure());
  world->inject("odometry_gone", 15.0);
  world->is_odometry_gone = true;
  expectOutcome(world->finish(14.0), NavigationOutcome::STALE_ODOMETRY);
  expectStands();
  EXPECT_TRUE(world->goOn(20.0, [] { return has(world->incidents, "fault odometry_gone is over"); }));
  world->is_odometry_gone = false;
  world->goOn(1.0);
}

TEST_F(NavigationFaults, StopsWithoutLocalisation) {
  beginToDriveEast();
  ASSERT_FALSE(HasFatalFailure());
  world->inject("localisation_gone", 8.0);
  world->is_localisation_gone = true;
  EXPECT_TRUE(world->goOn(5.0, [] { return speed() == 0.0; }));
  expectOutcome(world->finish(7.0), NavigationOutcome::STALE_POSE);
  expectStands();
  EXPECT_TRUE(world->goOn(20.0, [] { return has(world->incidents, "fault localisation_gone is over"); }));
  world->is_localisation_gone = false;
  world->goOn(1.0);
}

TEST_F(NavigationFaults, CancelledItStands) {
  beginToDriveEast();
  ASSERT_FALSE(HasFatalFailure());
  world->cancel();
  // Braked with stop_m_per_s2 of the base profile, 1 m/s^2, after a step and the lag of the drives.
  const double before_m_s = speed();
  const Pose2d asked = world->pose;
  expectOutcome(world->finish(before_m_s / 1.0 + 1.0), NavigationOutcome::CANCELLED);
  EXPECT_LT(distanceTo(asked), 0.5 * before_m_s * before_m_s / 1.0 + 0.1 * before_m_s);
  EXPECT_LT(std::abs(speed()), 0.01);
  expectStands();
}

/// Until the fault is over the base stands and is told to.
void waitForTheEndOf(NavigationWorld* world, const std::string& fault) {
  world->goOn(0.1);  // the stop has been heard
  EXPECT_TRUE(world->goOn(
      20.0, [&] { return has(world->incidents, "fault " + fault + " is over"); },
      [&] {
        EXPECT_EQ(world->state.command.linear.x, 0.0);
        EXPECT_EQ(world->state.command.angular.z, 0.0);
      }));
}

TEST_F(NavigationFaults, GoesOnWhenTheBasesScannerLetsItGo) {
  for (const double duration_s : {2.0, 10.0}) {
    beginToDriveEast();
    ASSERT_FALSE(HasFatalFailure());
    world->incidents.clear();
    ASSERT_EQ(world->inject("base_scanner", duration_s), "");
    EXPECT_TRUE(world->goOn(1.0, [] { return world->state.phase == NavigationState::BLOCKED; }));
    EXPECT_NE(world->state.reason.find("safety scanner"), std::string::npos) << world->state.reason;
    waitForTheEndOf(world, "base_scanner");
    expectOutcome(world->finish(60.0), NavigationOutcome::SUCCESS);
    expectAt(kEast);
  }
}

TEST_F(NavigationFaults, NothingMovesAfterTheBasesButton) {
  for (const double duration_s : {2.0, 10.0}) {
    beginToDriveEast();
    ASSERT_FALSE(HasFatalFailure());
    world->incidents.clear();
    ASSERT_EQ(world->inject("base_button", duration_s), "");
    const NavigationOutcome outcome = world->finish(1.5);
    expectOutcome(outcome, NavigationOutcome::BASE_STOPPED);
    EXPECT_NE(outcome.message.find("emergency button"), std::string::npos) << outcome.message;
    waitForTheEndOf(world, "base_button");
    const Pose2d released = world->pose;
    world->goOn(3.0);
    EXPECT_LT(distanceTo(released), 0.001);
    expectOutcome(world->drive(kEast, 60.0), NavigationOutcome::SUCCESS);
  }
}

TEST_F(NavigationFaults, SaysWhyAGoalCannotBe) {
  beginInTheWest();
  ASSERT_FALSE(HasFatalFailure());
  const ros::Time before = world->now();
  // The brick lies at the map's origin, its near face 0.15 m before that.
  const NavigationOutcome on_brick = world->drive({-0.15, 0.0, 0.0}, 10.0);
  expectOutcome(on_brick, NavigationOutcome::GOAL_OCCUPIED);
  EXPECT_NE(on_brick.message, "");
  expectOutcome(world->drive({30.0, 0.0, 0.0}, 10.0), NavigationOutcome::GOAL_UNKNOWN);
  world->send(kEast, "no_such_frame");
  expectOutcome(world->finish(10.0), NavigationOutcome::BAD_GOAL);
  EXPECT_LT((world->now() - before).toSec(), 10.0);
  expectStands();
  expectAt(kWest);
}

// Four people shoulder to shoulder, so near that the scanner sees past them only between the inner two and beside the
// outer ones. What it sees between them is free ground to which no known-free way leads.
TEST_F(NavigationFaults, NoWayLeadsThroughPeople) {
  beginInTheWest();
  ASSERT_FALSE(HasFatalFailure());
  constexpr double kScanner_m = 0.244;  // before base_link
  constexpr double kAway_m = 0.75;
  for (const double bearing_deg : {-60.0, -29.0, 29.0, 60.0}) {
    const Pose2d person =
        ahead(kScanner_m + kAway_m * std::cos(bearing_deg * kDegree), kAway_m * std::sin(bearing_deg * kDegree));
    ASSERT_EQ(world->injectObstacle(person.x_m, person.y_m, 12.0), "");
  }
  std_srvs::Trigger forget;
  ASSERT_TRUE(call("/base_navigation/forget_scans", forget));
  world->goOn(1.0);  // some scans
  // They hide all but 13.5 degrees to either side: at 2.1 m, where the rear of the goal's footprint is, +-0.5 m.
  expectOutcome(world->drive(ahead(kScanner_m + 2.1 + 0.527), 10.0), NavigationOutcome::NO_PATH);
  EXPECT_TRUE(world->goOn(20.0, [] { return has(world->incidents, "fault obstacle is over"); }));
  world->goOn(1.0);
}

// Last: whoever comes after would begin with a localisation that jumps back.
TEST_F(NavigationFaults, ArrivesAfterTheLocalisationJumped) {
  beginToDriveEast();
  ASSERT_FALSE(HasFatalFailure());
  world->inject("localisation_jump", 0.0, -0.4, 0.1);
  bool has_stopped = false;
  const NavigationOutcome outcome =
      world->finish(90.0, [&] { has_stopped = has_stopped || world->state.phase != NavigationState::DRIVING; });
  expectOutcome(outcome, NavigationOutcome::SUCCESS);
  EXPECT_TRUE(has_stopped) << "it noticed";
  expectAt(kEast);  // where it takes itself to be: nothing in this world could tell it better
}

}  // namespace
}  // namespace integration_tests
