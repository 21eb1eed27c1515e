// SPDX-License-Identifier: BSD-3-Clause
// What the tests of node base_navigation in the simulated world share. The world goes on only while a test lets it: each
// odometry waits for the test's answer, so that faults begin, goals are sent and poses are read at a known step.
#pragma once

#include <cmath>
#include <deque>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include <actionlib/client/action_client.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <interactive_mapping_common_ros/testing/waiting.h>
#include <interactive_mapping_msgs/NavigationOutcome.h>
#include <interactive_mapping_msgs/NavigationState.h>
#include <move_base_msgs/MoveBaseAction.h>
#include <nav_msgs/Odometry.h>
#include <std_msgs/Header.h>
#include <std_msgs/String.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>
#include <visualization_msgs/MarkerArray.h>

#include "simulated_world/InjectFault.h"
#include "simulated_world/JudgeState.h"
#include "simulated_world/differential_drive.h"

namespace integration_tests {

using node_tests::call;
using node_tests::has;
using node_tests::waitUntil;

using interactive_mapping_msgs::NavigationOutcome;
using interactive_mapping_msgs::NavigationState;
using simulated_world::Pose2d;

// Of mp700_ur5e_description/config/base_profile.yaml.
constexpr double kFront_m = 0.296;
constexpr double kDegree = M_PI / 180.0;
// Wall time that a busy machine may take for what the simulated time limits, which is the one that tells.
constexpr double kWall_s = 300.0;
// Simulated time until the navigation has all its inputs: where the scanner sits comes by the wall clock, and the
// simulated one runs a hundred times as fast.
constexpr double kStart_s = 2000.0;

inline Pose2d planar(const geometry_msgs::Vector3& position, const geometry_msgs::Quaternion& q) {
  return {position.x, position.y, 2.0 * std::atan2(q.z, q.w)};
}

class NavigationWorld {
 public:
  NavigationWorld() : listener_(tf_, nh_, false), client_("/move_base") {
    odometry_ = nh_.subscribe<nav_msgs::Odometry>(
        "/odom", 100, [this](const nav_msgs::Odometry::ConstPtr& message) { steps_.push_back(*message); });
    subscribers_.push_back(nh_.subscribe<NavigationState>(
        "/base_navigation/state", 100, [this](const NavigationState::ConstPtr& message) { state = *message; }));
    subscribers_.push_back(nh_.subscribe<NavigationOutcome>(
        "/base_navigation/outcome", 100,
        [this](const NavigationOutcome::ConstPtr& message) { outcomes_.push_back(*message); }));
    subscribers_.push_back(nh_.subscribe<simulated_world::JudgeState>(
        "/simulated_world/judge", 100,
        [this](const simulated_world::JudgeState::ConstPtr& message) { judge = *message; }));
    subscribers_.push_back(nh_.subscribe<std_msgs::String>(
        "/simulated_world/incidents", 100,
        [this](const std_msgs::String::ConstPtr& message) { incidents += message->data + "\n"; }));
    subscribers_.push_back(nh_.subscribe<diagnostic_msgs::DiagnosticArray>(
        "/diagnostics", 100, [this](const diagnostic_msgs::DiagnosticArray::ConstPtr& message) {
          for (const auto& status : message->status) {
            if (status.name == "base_navigation: inputs") has_inputs_ = status.level == status.OK;
          }
        }));
    subscribers_.push_back(nh_.subscribe<visualization_msgs::MarkerArray>(
        "/simulated_world/truth", 10, [this](const visualization_msgs::MarkerArray::ConstPtr& message) {
          for (const auto& marker : message->markers) {
            if (marker.ns == "bricks") bricks[marker.id] = marker;
          }
        }));
  }

  /// Begins the world's time, which waits for whoever answers the steps. False if a node does not come up.
  bool begin() {
    const bool is_connected = waitUntil(
        [this] {
          return odometry_.getNumPublishers() > 0 && client_.isServerConnected() && judge.bricks_total > 0 &&
                 !bricks.empty();
        },
        60.0);
    answer_ = nh_.advertise<std_msgs::Header>("/navigation_test/step", 100, true);
    // Steps from before tf's connection are never localised: they are answered, and that is all.
    return is_connected && waitUntil([this] {
             for (; !steps_.empty() && !isLocalised(steps_.front().header.stamp); steps_.pop_front()) {
               answer_.publish(steps_.front().header);
             }
             return !steps_.empty();
           }) &&
           goOn(kStart_s, [this] { return !state.header.stamp.isZero() && has_inputs_; });
  }

  /// Lets the world go on until the condition holds, which is asked after each step, or `at_most_s` of simulated time have
  /// passed: then false. `each_step` is called before. The world stands still between two calls.
  bool goOn(double at_most_s, const std::function<bool()>& condition, const std::function<void()>& each_step = {}) {
    const ros::Time end = now() + ros::Duration(at_most_s);
    bool holds = false;
    bool is_late = false;
    const auto ask = [&] {
      if (each_step) each_step();
      // The clock comes by a thread of its own: what was sent before `end` is there by then, but not yet called.
      if (is_odometry_gone && now() >= end) ros::getGlobalCallbackQueue()->callAvailable();
      holds = condition();
      is_late = !holds && now() >= end;
      return holds || is_late;
    };
    release();
    const bool has_ended = waitUntil(
        [&] {
          while (!steps_.empty() && isLocalised(steps_.front().header.stamp)) {
            takeStep();
            if (ask()) return true;
            release();
          }
          // Without odometry the clock does not wait for anybody.
          return steps_.empty() && is_odometry_gone && ask();
        },
        kWall_s);
    EXPECT_TRUE(has_ended) << "the world stands still at " << now();
    return holds;
  }

  void goOn(double duration_s) {
    goOn(duration_s, [] { return false; });
  }

  /// Drives there and returns what became of it; status NUM_STATUS if nothing did within `at_most_s`.
  NavigationOutcome drive(const Pose2d& goal_map, double at_most_s, const std::function<void()>& each_step = {}) {
    send(goal_map);
    return finish(at_most_s, each_step);
  }

  void send(const Pose2d& goal_map, const std::string& frame = "map") {
    move_base_msgs::MoveBaseGoal goal;
    goal.target_pose.header.frame_id = frame;
    goal.target_pose.pose.position.x = goal_map.x_m;
    goal.target_pose.pose.position.y = goal_map.y_m;
    goal.target_pose.pose.orientation.z = std::sin(0.5 * goal_map.yaw_rad);
    goal.target_pose.pose.orientation.w = std::cos(0.5 * goal_map.yaw_rad);
    outcomes_.clear();
    goal_ = client_.sendGoal(goal);
    // The world stands still until the goal is there, so that the next step begins it in every run.
    EXPECT_TRUE(waitUntil([this] { return goal_.getCommState() != actionlib::CommState::WAITING_FOR_GOAL_ACK; }))
        << "nobody takes the goal";
  }

  NavigationOutcome finish(double at_most_s, const std::function<void()>& each_step = {}) {
    NavigationOutcome none;
    none.status = NavigationOutcome::NUM_STATUS;
    none.message = "no outcome";
    return goOn(
               at_most_s, [this] { return !outcomes_.empty(); }, each_step)
               ? outcomes_.front()
               : none;
  }

  void cancel() { goal_.cancel(); }

  /// What a test that failed has left open must not spoil the next one.
  void abandon() {
    if (goal_.isExpired() || goal_.getCommState() == actionlib::CommState::DONE) return;
    goal_.cancel();
    EXPECT_TRUE(goOn(20.0, [this] { return goal_.getCommState() == actionlib::CommState::DONE; }));
  }

  std::string inject(const std::string& kind, double duration_s = 0.0, double value = 0.0, double value2 = 0.0) {
    simulated_world::InjectFault fault;
    fault.request.kind = kind;
    fault.request.duration_s = duration_s;
    fault.request.value = value;
    fault.request.value2 = value2;
    return inject(fault);
  }

  /// Somebody stands there.
  std::string injectObstacle(double x_m, double y_m, double duration_s) {
    simulated_world::InjectFault fault;
    fault.request.kind = "obstacle";
    fault.request.duration_s = duration_s;
    fault.request.pose.position.x = x_m;
    fault.request.pose.position.y = y_m;
    fault.request.pose.orientation.w = 1.0;
    return inject(fault);
  }

  /// Of the base in half a second, by the judge.
  double drivenInHalfASecond() {
    goOn(0.6);
    const double before_m = judge.distance_m;
    goOn(0.6);
    return judge.distance_m - before_m;
  }

  ros::Time now() const { return ros::Time::now(); }

  // As of the last step.
  Pose2d pose;  ///< of the base by tf: the truth unless the localisation is at fault
  nav_msgs::Odometry odometry;
  NavigationState state;
  simulated_world::JudgeState judge;
  std::string incidents;
  std::map<int, visualization_msgs::Marker> bricks;

  // Set by a test that makes it so.
  bool is_odometry_gone{false};
  bool is_localisation_gone{false};

 private:
  using Client = actionlib::ActionClient<move_base_msgs::MoveBaseAction>;

  static std::string inject(simulated_world::InjectFault& fault) {
    EXPECT_TRUE(call("/simulated_world/inject_fault", fault));
    return fault.response.success ? "" : fault.response.message;
  }

  bool isLocalised(const ros::Time& stamp) const {
    return is_localisation_gone || tf_.canTransform("map", "base_link", stamp);
  }

  void takeStep() {
    odometry = steps_.front();
    steps_.pop_front();
    unanswered_ = odometry.header;
    if (!is_localisation_gone) {
      const auto T = tf_.lookupTransform("map", "base_link", odometry.header.stamp).transform;
      pose = planar(T.translation, T.rotation);
    }
  }

  void release() {
    if (unanswered_.stamp.isZero()) return;
    answer_.publish(unanswered_);
    unanswered_ = std_msgs::Header();
  }

  ros::NodeHandle nh_;
  tf2_ros::Buffer tf_;
  tf2_ros::TransformListener listener_;
  ros::Subscriber odometry_;
  std::vector<ros::Subscriber> subscribers_;
  ros::Publisher answer_;
  Client client_;
  Client::GoalHandle goal_;
  std::deque<nav_msgs::Odometry> steps_;
  std::deque<NavigationOutcome> outcomes_;
  std_msgs::Header unanswered_;
  bool has_inputs_{false};  // says the navigation itself
};

/// One world for all tests of a program, in the order in which they are written: each begins where the one before ended.
class NavigationTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    world = new NavigationWorld;
    is_ready = world->begin();
  }
  static void TearDownTestSuite() {
    delete world;
    world = nullptr;
  }
  void SetUp() override {
    ASSERT_TRUE(is_ready) << "simulated world and base_navigation do not come up";
    world->incidents.clear();
    collisions_before_ = world->judge.collisions;
  }
  void TearDown() override {
    if (!is_ready) return;
    world->abandon();
    world->goOn(0.6);  // until the judge has told
    EXPECT_EQ(world->judge.collisions, collisions_before_) << world->incidents;
  }

  /// With its text, which tells the reason when it is another. `status` is one of NavigationOutcome's.
  static void expectOutcome(const NavigationOutcome& outcome, int status) {
    EXPECT_EQ(static_cast<int>(outcome.status), status) << outcome.message << "\n" << world->incidents;
  }

  static void expectAt(const Pose2d& expected) {
    // Within 3 cm and 3 degrees: the bound of docs/results/base_navigation.md.
    EXPECT_LT(std::hypot(world->pose.x_m - expected.x_m, world->pose.y_m - expected.y_m), 0.03)
        << "at (" << world->pose.x_m << ", " << world->pose.y_m << ") m";
    EXPECT_LT(std::abs(std::remainder(world->pose.yaw_rad - expected.yaw_rad, 2.0 * M_PI)), 3.0 * kDegree)
        << "at " << world->pose.yaw_rad << " rad";
  }

  static inline NavigationWorld* world = nullptr;
  static inline bool is_ready = false;

 private:
  int collisions_before_{0};
};

}  // namespace integration_tests
