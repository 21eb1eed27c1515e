// SPDX-License-Identifier: BSD-3-Clause
// The node alone, on open ground, with odometry, scan and map from here: what it tells while it does not know where the
// robot is, and what its services answer once it does. How it drives is tested in the simulated world.
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <geometry_msgs/Twist.h>
#include <gmock/gmock.h>
#include <interactive_mapping_common_ros/testing/tuning.h>
#include <interactive_mapping_msgs/NavigationOutcome.h>
#include <interactive_mapping_msgs/NavigationState.h>
#include <map_msgs/OccupancyGridUpdate.h>
#include <move_base_msgs/MoveBaseAction.h>
#include <nav_msgs/GetPlan.h>
#include <nav_msgs/OccupancyGrid.h>
#include <nav_msgs/Odometry.h>
#include <neo_msgs/EmergencyStopState.h>
#include <ros/ros.h>
#include <sensor_msgs/LaserScan.h>
#include <std_msgs/Bool.h>
#include <std_msgs/Header.h>
#include <tf2_ros/static_transform_broadcaster.h>

namespace base_navigation_ros {
namespace {

using interactive_mapping_msgs::NavigationOutcome;
using interactive_mapping_msgs::NavigationState;

constexpr double kAtMost_s = 20.0;  // wall time for what takes a fraction of it: the machine may be busy
constexpr double kX_m = 0.5;        // where the robot stands

class BaseNavigationNode : public testing::Test {
 protected:
  BaseNavigationNode() {
    odometry_publisher_ = nh_.advertise<nav_msgs::Odometry>("odom", 5);
    scan_publisher_ = nh_.advertise<sensor_msgs::LaserScan>("scan", 5);
    ground_publisher_ = nh_.advertise<nav_msgs::OccupancyGrid>("map/ground", 5);
    heartbeat_publisher_ = nh_.advertise<std_msgs::Header>("heartbeat", 5);
    relay_publisher_ = nh_.advertise<neo_msgs::EmergencyStopState>("emergency_stop_state", 5);
    stop_publisher_ = nh_.advertise<std_msgs::Bool>("base_stop", 5);
    goal_publisher_ = nh_.advertise<move_base_msgs::MoveBaseActionGoal>("move_base/goal", 5);
    subscribers_ = {
        nh_.subscribe<NavigationOutcome>(
            "base_navigation/outcome", 10,
            [this](const NavigationOutcome::ConstPtr& message) { outcomes_.push_back(*message); }),
        nh_.subscribe<nav_msgs::OccupancyGrid>(
            "base_navigation/grid", 10, [this](const nav_msgs::OccupancyGrid::ConstPtr& message) { grid_ = *message; }),
        nh_.subscribe<NavigationState>("base_navigation/state", 10, [this](const NavigationState::ConstPtr& message) {
          states_.insert(message->header.stamp);
          state_ = *message;
        })};
    geometry_msgs::TransformStamped scanner;
    scanner.header.frame_id = "base_link";
    scanner.child_frame_id = "scanner";
    scanner.transform.translation.x = 0.244;
    scanner.transform.rotation.w = 1.0;
    tf_.sendTransform(scanner);
    localise(0.0);
  }

  /// Odometry's origin in the map, from now on.
  void localise(double x_m) {
    geometry_msgs::TransformStamped localisation;
    localisation.header.frame_id = "map";
    localisation.child_frame_id = "odom";
    localisation.transform.translation.x = x_m;
    localisation.transform.rotation.w = 1.0;
    tf_.sendTransform(localisation);
  }

  /// Goes on, with data of a robot that stands if there is to be any, until the condition holds; false: never did.
  bool waitUntil(const std::function<bool()>& condition) {
    const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(kAtMost_s);
    for (ros::WallRate rate(20.0); ros::ok() && ros::WallTime::now() < end; rate.sleep()) {
      if (has_data_) publishData();
      ros::spinOnce();
      if (condition()) return true;
    }
    return false;
  }

  void publishData() {
    const ros::Time now = ros::Time::now();
    // Stamps of scan and ground are none of odometry's.
    const ros::Time between = now - ros::Duration(0.001);
    nav_msgs::Odometry odometry;
    odometry.header.stamp = now;
    odometry.header.frame_id = odom_frame_;
    odometry.child_frame_id = slash_ + "base_link";
    odometry.pose.pose.position.x = kX_m;
    odometry.pose.pose.orientation.w = 1.0;
    sensor_msgs::LaserScan scan;
    scan.header.stamp = between + ros::Duration(scan_ahead_s_);
    scan.header.frame_id = scan_frame_;
    scan.angle_min = -1.6F;
    scan.angle_increment = 0.02F;
    scan.range_min = 0.01F;
    scan.range_max = 29.0F;
    scan.ranges.assign(161, 4.5F);
    nav_msgs::OccupancyGrid ground;
    ground.header.stamp = between;
    ground.header.frame_id = map_frame_;
    ground.info.resolution = 0.05F;
    ground.info.width = ground.info.height = 160;
    ground.info.origin.position.x = ground.info.origin.position.y = -4.0;
    ground.info.origin.orientation.w = 1.0;
    ground.data.assign(160 * 160, 0);
    if (has_ground_) ground_publisher_.publish(ground);
    scan_publisher_.publish(scan);
    odometry_publisher_.publish(odometry);
    if (has_heartbeat_) heartbeat_publisher_.publish(odometry.header);
    odometry_stamps_.insert(now);
  }

  NavigationOutcome outcomeOf(const std::string& frame, double x_m) {
    EXPECT_TRUE(waitUntil([this] { return goal_publisher_.getNumSubscribers() > 0 && !states_.empty(); }));
    move_base_msgs::MoveBaseActionGoal goal;
    static int number = 0;  // the server remembers ids for a while
    goal.goal_id.id = "goal " + std::to_string(++number) + " " + frame + " " + std::to_string(x_m);
    goal.goal.target_pose.header.frame_id = frame;
    goal.goal.target_pose.pose.position.x = x_m;
    goal.goal.target_pose.pose.orientation.w = 1.0;
    goal_publisher_.publish(goal);
    NavigationOutcome found;
    found.status = NavigationOutcome::NUM_STATUS;
    EXPECT_TRUE(waitUntil([&] {
      for (const NavigationOutcome& outcome : outcomes_) {
        if (outcome.goal_id == goal.goal_id.id) found = outcome;
      }
      return found.status != NavigationOutcome::NUM_STATUS;
    })) << goal.goal_id.id;
    return found;
  }

  bool waitForGrid() {
    return waitUntil([this] { return !grid_.data.empty(); });
  }

  /// Of the cell of ~grid on the x axis; -1, unknown, outside.
  int valueAt(double x_m) const {
    const auto cell = [this](double p_m, double origin_m) {
      return static_cast<int>(std::floor((p_m - origin_m) / grid_.info.resolution));
    };
    const int column = cell(x_m, grid_.info.origin.position.x);
    const int row = cell(0.025, grid_.info.origin.position.y);
    const int width = static_cast<int>(grid_.info.width);
    const bool is_inside = column >= 0 && row >= 0 && column < width && row < static_cast<int>(grid_.info.height);
    return is_inside ? grid_.data[static_cast<std::size_t>(row * width + column)] : -1;
  }

  static nav_msgs::GetPlan planTo(double x_m, double tolerance_m) {
    nav_msgs::GetPlan plan;
    plan.request.goal.header.frame_id = "map";
    plan.request.goal.pose.position.x = x_m;
    plan.request.goal.pose.orientation.w = 1.0;
    plan.request.tolerance = static_cast<float>(tolerance_m);
    return plan;
  }

  ros::NodeHandle nh_;
  ros::Publisher odometry_publisher_, scan_publisher_, ground_publisher_, goal_publisher_, heartbeat_publisher_,
      relay_publisher_, stop_publisher_;
  tf2_ros::StaticTransformBroadcaster tf_;
  std::vector<ros::Subscriber> subscribers_;
  std::vector<NavigationOutcome> outcomes_;
  std::set<ros::Time> states_;
  std::set<ros::Time> odometry_stamps_;
  NavigationState state_;
  nav_msgs::OccupancyGrid grid_;
  std::string slash_, odom_frame_{"odom"}, scan_frame_{"scanner"}, map_frame_{"map"};
  double scan_ahead_s_{0.0};
  bool has_data_{true};
  bool has_ground_{true};
  bool has_heartbeat_{true};
};

// The first test: afterwards the node knows.
TEST_F(BaseNavigationNode, TellsNoPlaceWhileItKnowsNone) {
  has_data_ = false;
  const NavigationOutcome stale = outcomeOf("map", 1.5);
  EXPECT_EQ(static_cast<int>(stale.status), static_cast<int>(NavigationOutcome::STALE_ODOMETRY)) << stale.message;
  EXPECT_TRUE(std::isnan(stale.base.position.x) && std::isnan(stale.base.position.y));
  EXPECT_TRUE(std::isnan(stale.base.orientation.w));
  EXPECT_EQ(stale.goal.position.x, 1.5);
  const NavigationOutcome bad = outcomeOf("nowhere", 1.5);
  EXPECT_EQ(static_cast<int>(bad.status), static_cast<int>(NavigationOutcome::BAD_GOAL)) << bad.message;
  EXPECT_TRUE(std::isnan(bad.goal.position.x)) << "nobody knows where in the map that is";
  EXPECT_TRUE(std::isnan(bad.base.position.x));
  nav_msgs::GetPlan plan = planTo(1.5, 0.0);
  EXPECT_FALSE(ros::service::call("base_navigation/make_plan", plan));
}

TEST_F(BaseNavigationNode, TellsWhereItStandsOnceItKnows) {
  ASSERT_TRUE(waitForGrid());
  const NavigationOutcome outcome = outcomeOf("map", kX_m);
  EXPECT_EQ(static_cast<int>(outcome.status), static_cast<int>(NavigationOutcome::SUCCESS)) << outcome.message;
  EXPECT_NEAR(outcome.base.position.x, kX_m, 1e-9);
  EXPECT_NEAR(outcome.base.orientation.w, 1.0, 1e-9);
}

TEST_F(BaseNavigationNode, GridHasTheStampOfAnOdometry) {
  // A step of the watchdog, where odometry is late on a busy machine, has another.
  EXPECT_TRUE(waitUntil([this] { return odometry_stamps_.count(grid_.header.stamp) > 0; })) << grid_.header.stamp;
  EXPECT_EQ(grid_.header.frame_id, "map");
  EXPECT_EQ(valueAt(kX_m + 1.0), 0);
}

TEST_F(BaseNavigationNode, PlansTellApartNoWayAndNothingToDrive) {
  ASSERT_TRUE(waitForGrid());
  nav_msgs::GetPlan there = planTo(kX_m, 0.0);
  ASSERT_TRUE(ros::service::call("base_navigation/make_plan", there));
  ASSERT_EQ(there.response.plan.poses.size(), 1U);
  EXPECT_NEAR(there.response.plan.poses[0].pose.position.x, kX_m, 1e-9);
  EXPECT_EQ(there.response.plan.poses[0].header.frame_id, "map");
  nav_msgs::GetPlan ahead = planTo(kX_m + 1.0, 0.0);
  ASSERT_TRUE(ros::service::call("base_navigation/make_plan", ahead));
  ASSERT_GT(ahead.response.plan.poses.size(), 10U);  // one every 5 cm
  EXPECT_NEAR(ahead.response.plan.poses.back().pose.position.x, kX_m + 1.0, 1e-3);
  // Beyond what is known: no tolerance makes it another goal.
  nav_msgs::GetPlan beyond = planTo(20.0, 100.0);
  ASSERT_TRUE(ros::service::call("base_navigation/make_plan", beyond));
  EXPECT_TRUE(beyond.response.plan.poses.empty());
  nav_msgs::GetPlan tolerant = planTo(kX_m + 1.0, 5.0);
  ASSERT_TRUE(ros::service::call("base_navigation/make_plan", tolerant));
  EXPECT_EQ(tolerant.response.plan.poses.size(), ahead.response.plan.poses.size());
}

TEST_F(BaseNavigationNode, StandsWithoutTheHeartbeatOfItsMaster) {
  ASSERT_TRUE(waitForGrid());
  has_heartbeat_ = false;
  const NavigationOutcome outcome = outcomeOf("map", kX_m + 1.0);
  EXPECT_EQ(static_cast<int>(outcome.status), static_cast<int>(NavigationOutcome::STALE_HEARTBEAT)) << outcome.message;
  EXPECT_THAT(outcome.message, testing::HasSubstr("heartbeat is"));
  EXPECT_NEAR(outcome.base.position.x, kX_m, 1e-9);
}

TEST_F(BaseNavigationNode, TakesFramesWithALeadingSlash) {
  slash_ = "/";
  for (std::string* frame : {&odom_frame_, &scan_frame_, &map_frame_}) frame->insert(0, slash_);
  // As long as anything said before may be used, and longer than that.
  const ros::Time begun = ros::Time::now();
  ASSERT_TRUE(waitUntil([&] { return state_.header.stamp > begun + ros::Duration(1.0); }));
  ASSERT_TRUE(waitForGrid());
  NavigationOutcome outcome = outcomeOf("/map", kX_m);
  EXPECT_EQ(static_cast<int>(outcome.status), static_cast<int>(NavigationOutcome::SUCCESS)) << outcome.message;
  outcome = outcomeOf("/odom", kX_m);
  EXPECT_EQ(static_cast<int>(outcome.status), static_cast<int>(NavigationOutcome::SUCCESS)) << outcome.message;
  nav_msgs::GetPlan plan = planTo(kX_m + 1.0, 0.0);
  plan.request.goal.header.frame_id = "/map";
  ASSERT_TRUE(ros::service::call("base_navigation/make_plan", plan));
  EXPECT_GT(plan.response.plan.poses.size(), 10U);
}

TEST_F(BaseNavigationNode, NamesAWrongFrameAndNotItsAge) {
  ASSERT_TRUE(waitForGrid());
  for (std::string* frame : {&odom_frame_, &scan_frame_}) {
    const std::string before = *frame;
    *frame = "nowhere";
    const NavigationOutcome outcome = outcomeOf("map", frame == &odom_frame_ ? 1.2 : 1.3);
    EXPECT_EQ(static_cast<int>(outcome.status), static_cast<int>(NavigationOutcome::BAD_INPUT)) << outcome.message;
    EXPECT_THAT(outcome.message, testing::HasSubstr("'nowhere'"));
    *frame = before;
  }
  // The map's may be 10 s old before it is missed: told by then by the diagnostics alone.
}

TEST_F(BaseNavigationNode, DoesNotTakeAScanForNewAtTheTimeThatAWrongClockGaveIt) {
  ASSERT_TRUE(waitForGrid());
  scan_ahead_s_ = 1.0;
  const NavigationOutcome outcome = outcomeOf("map", 1.4);
  EXPECT_EQ(static_cast<int>(outcome.status), static_cast<int>(NavigationOutcome::BAD_INPUT)) << outcome.message;
  EXPECT_THAT(outcome.message, testing::HasSubstr("s ahead of ROS time, must be at most 0.2 s"));
}

TEST_F(BaseNavigationNode, OffersSpeedAndMarginToChangeWhileItRuns) {
  const std::string server = "/base_navigation/tune";
  const std::map<std::string, std::pair<double, double>> ranges{{"guard_margin_m", {0.001, 1.0}},
                                                                {"speed_share", {0.05, 1.0}}};
  EXPECT_EQ(node_tests::liveFieldsOf(server), ranges);
  const std::map<std::string, double> shipped{{"guard_margin_m", 0.04}, {"speed_share", 1.0}};
  EXPECT_EQ(node_tests::askForNumbers(server, {}), shipped);
  // What the guard would not let pass is not planned: refused as a whole.
  EXPECT_EQ(node_tests::askForNumbers(server, {{"guard_margin_m", 0.06}, {"speed_share", 0.5}}), shipped);
  EXPECT_EQ(node_tests::askForNumbers(server, {{"speed_share", 0.04}}), shipped);
  EXPECT_EQ(node_tests::askForNumbers(server, {{"speed_share", 0.05}}), shipped) << "5 mm/s backwards";
  EXPECT_EQ(node_tests::askForNumbers(server, {{"guard_margin_m", 0.05}}).at("guard_margin_m"), 0.05);
  EXPECT_EQ(node_tests::askForNumbers(server, shipped), shipped);
}

TEST_F(BaseNavigationNode, ASmallerShareOfSpeedHoldsForTheNextGoal) {
  ASSERT_TRUE(waitForGrid());
  double most_m_s = 0.0;
  const ros::Subscriber commands = nh_.subscribe<geometry_msgs::Twist>(
      "cmd_vel", 100,
      [&](const geometry_msgs::Twist::ConstPtr& command) { most_m_s = std::max(most_m_s, command->linear.x); });
  ASSERT_TRUE(waitUntil([&] { return commands.getNumPublishers() > 0; }));
  node_tests::tune("/base_navigation/tune", "{speed_share: 0.12}");
  outcomeOf("map", kX_m + 1.0);  // in vain: this robot does not move
  EXPECT_GT(most_m_s, 0.03);
  EXPECT_LE(most_m_s, 0.12 * 0.8 + 1e-9) << "of the 0.8 m/s of the profile";
  node_tests::tune("/base_navigation/tune", "{speed_share: 1.0}");
  outcomeOf("map", kX_m + 1.0);
  EXPECT_GT(most_m_s, 0.1);
}

TEST_F(BaseNavigationNode, HearsTheBasesOwnStops) {
  ASSERT_TRUE(waitForGrid());
  ASSERT_TRUE(waitUntil(
      [this] { return relay_publisher_.getNumSubscribers() > 0 && stop_publisher_.getNumSubscribers() > 0; }));
  neo_msgs::EmergencyStopState relay;
  const auto tell = [&](bool is_button, bool is_scanner, int state) {
    relay.emergency_button_stop = is_button;
    relay.scanner_stop = is_scanner;
    relay.emergency_state = static_cast<std::int16_t>(state);
    relay_publisher_.publish(relay);
    const ros::Time told = ros::Time::now();
    // Two more steps: it has been heard.
    EXPECT_TRUE(waitUntil([&] { return state_.header.stamp > told + ros::Duration(0.2); }));
  };
  tell(false, false, relay.EMFREE);
  NavigationOutcome outcome = outcomeOf("map", kX_m);
  EXPECT_EQ(static_cast<int>(outcome.status), static_cast<int>(NavigationOutcome::SUCCESS)) << outcome.message;
  tell(true, false, relay.EMSTOP);
  outcome = outcomeOf("map", kX_m + 0.6);
  EXPECT_EQ(static_cast<int>(outcome.status), static_cast<int>(NavigationOutcome::BASE_STOPPED)) << outcome.message;
  EXPECT_THAT(outcome.message, testing::HasSubstr("emergency button is pressed"));
  tell(false, false, relay.EMCONFIRMED);  // not yet free
  outcome = outcomeOf("map", kX_m + 0.7);
  EXPECT_EQ(static_cast<int>(outcome.status), static_cast<int>(NavigationOutcome::BASE_STOPPED)) << outcome.message;
  tell(false, false, relay.EMFREE);
  outcome = outcomeOf("map", kX_m);
  EXPECT_EQ(static_cast<int>(outcome.status), static_cast<int>(NavigationOutcome::SUCCESS)) << outcome.message;
  // The scanner's: it waits, and is cancelled waiting.
  tell(false, true, relay.EMSTOP);
  move_base_msgs::MoveBaseActionGoal goal;
  goal.goal_id.id = "waits";
  goal.goal.target_pose.header.frame_id = "map";
  goal.goal.target_pose.pose.position.x = kX_m + 0.8;
  goal.goal.target_pose.pose.orientation.w = 1.0;
  goal_publisher_.publish(goal);
  EXPECT_TRUE(waitUntil([this] {
    return state_.phase == NavigationState::BLOCKED && state_.reason.find("safety scanner") != std::string::npos;
  })) << state_.reason;
  tell(false, false, relay.EMFREE);
  EXPECT_TRUE(waitUntil([this] { return state_.command.linear.x > 0.0; })) << "goes on";
  std_msgs::Bool stop;
  stop.data = 1;
  stop_publisher_.publish(stop);
  NavigationOutcome stopped;
  EXPECT_TRUE(waitUntil([&] {
    stopped = outcomes_.empty() ? NavigationOutcome() : outcomes_.back();
    return stopped.goal_id == "waits";
  }));
  EXPECT_EQ(static_cast<int>(stopped.status), static_cast<int>(NavigationOutcome::BASE_STOPPED)) << stopped.message;
  EXPECT_THAT(stopped.message, testing::HasSubstr("stop input"));
  stop.data = 0;
  stop_publisher_.publish(stop);
}

// Another node, whose grid comes once, with a stamp of long ago.
TEST_F(BaseNavigationNode, StaticDrivesOnALatchedGrid) {
  has_ground_ = false;
  nav_msgs::OccupancyGrid ground;
  ground.header.frame_id = "map";
  ground.info.resolution = 0.05F;
  ground.info.width = ground.info.height = 160;
  ground.info.origin.position.x = ground.info.origin.position.y = -4.0;
  ground.info.origin.orientation.w = 1.0;
  ground.data.assign(160 * 160, 40);  // a costmap's inflation
  ros::Publisher latched = nh_.advertise<nav_msgs::OccupancyGrid>("map/ground", 1, true);
  latched.publish(ground);
  ASSERT_TRUE(waitForGrid());
  const NavigationOutcome outcome = outcomeOf("map", kX_m);
  EXPECT_EQ(static_cast<int>(outcome.status), static_cast<int>(NavigationOutcome::SUCCESS)) << outcome.message;
  constexpr double kBehind_m = -1.975;  // which no scanner sees
  EXPECT_TRUE(waitUntil([this] { return valueAt(kBehind_m) == 0; }));
  ros::Publisher updates = nh_.advertise<map_msgs::OccupancyGridUpdate>("map/ground_updates", 1, true);
  map_msgs::OccupancyGridUpdate update;
  update.header.frame_id = "map";
  update.x = 40;
  update.y = 80;
  update.width = update.height = 1;
  update.data = {100};
  updates.publish(update);
  EXPECT_TRUE(waitUntil([this] { return valueAt(kBehind_m) == 100; }));

  // One that cannot be used was meant to replace it.
  nav_msgs::OccupancyGrid elsewhere = ground;
  elsewhere.header.frame_id = "nowhere";
  latched.publish(elsewhere);
  NavigationOutcome refused;
  const auto ends = [&](std::uint8_t status) {
    refused = outcomeOf("map", kX_m);
    return refused.status == status;
  };
  EXPECT_TRUE(waitUntil([&] { return ends(NavigationOutcome::BAD_INPUT); })) << refused.message;
  EXPECT_THAT(refused.message, testing::HasSubstr("'nowhere'"));
  latched.publish(ground);
  EXPECT_TRUE(waitUntil([&] { return ends(NavigationOutcome::SUCCESS); })) << refused.message;
}

// Beyond the map's ground, free as far as the scanner has looked across it. The last test: it puts the pose right again.
TEST_F(BaseNavigationNode, ForgetsWhatItSawWithAPoseThatWasWrong) {
  constexpr double kAhead_m = 4.6;  // the map ends at 4, the scanner frees up to 4.74
  ASSERT_TRUE(waitUntil([this] { return valueAt(kAhead_m) == 0; }));
  localise(-0.2);  // less than a jump
  nav_msgs::GetPlan there = planTo(kX_m - 0.2, 0.0);
  ASSERT_TRUE(waitUntil([&] {  // where it stands: a plan of one pose
    return ros::service::call("base_navigation/make_plan", there) && there.response.plan.poses.size() == 1;
  }));
  const ros::Time moved = ros::Time::now();
  ASSERT_TRUE(waitUntil([&] { return grid_.header.stamp > moved + ros::Duration(1.0); }));  // grids of 2 Hz
  EXPECT_EQ(valueAt(kAhead_m), 0) << "seen before, and no longer in the scanner's range";
  localise(-1.0);
  EXPECT_TRUE(waitUntil([this] { return valueAt(kAhead_m) == -1; }));
  // And it knows enough to go on.
  const NavigationOutcome outcome = outcomeOf("map", kX_m - 1.0);
  EXPECT_EQ(static_cast<int>(outcome.status), static_cast<int>(NavigationOutcome::SUCCESS)) << outcome.message;
  EXPECT_NEAR(outcome.base.position.x, kX_m - 1.0, 1e-9);
  nav_msgs::GetPlan plan = planTo(kX_m, 0.0);
  ASSERT_TRUE(ros::service::call("base_navigation/make_plan", plan));
  EXPECT_GT(plan.response.plan.poses.size(), 10U);
  localise(0.0);
  EXPECT_TRUE(waitUntil([this] { return valueAt(kAhead_m) == 0; }));
}

}  // namespace
}  // namespace base_navigation_ros
